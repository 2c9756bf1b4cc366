"""Test sets of qpbenchmark: read from the class in a Python file, or written beside saved problems.

qpbenchmark loads the class whose name is the file's name in title case without underscores (S. Caron and others, the
package qpbenchmark, class ``TestSet``). It is a user's code, so :func:`read_test_set` is called in a subprocess. A
written test set does not depend on this package and has each problem in each scaling.
"""

import sys
from importlib import import_module
from pathlib import Path
from string import Template

from qpsolvers import Problem

from bench.problem_files.program import QP_FIELDS, check
from piezo_model.atomic_file import write_text

TEMPLATE = Template('''"""Test set of qpbenchmark: the problem set $set of piezobench, in each scaling.

    python $module.py run --author you

puts the results into $module.csv and a report into $module.md, both beside this file.

Made by `piezobench problems --set $set --export`; the problems are the NPZ files beside this one,
and their field `meta`
holds the certified optima.
"""

from pathlib import Path

import numpy as np
from qpbenchmark import Problem, TestSet, benchmark
from scipy.sparse import csc_matrix

FIELDS = ("P", "q", "G", "h", "A", "b", "lb", "ub")


def field(arrays, name):
    """A vector or a matrix, dense or in compressed columns; None if the problem lacks it."""
    if f"{name}/data" in arrays:
        parts = tuple(arrays[f"{name}/{part}"] for part in ("data", "indices", "indptr"))
        return csc_matrix(parts, shape=tuple(arrays[f"{name}/shape"]))
    return arrays[name] if name in arrays else None


class $class_name(TestSet):
    """Every problem in each scaling."""

    @property
    def title(self):
        return "piezobench: $set"

    @property
    def description(self):
        return "The problem set $set of piezobench, each problem as its data are and scaled."

    @property
    def sparse_only(self):
        return $sparse

    def __iter__(self):
        for path in sorted(Path(__file__).parent.glob("$set--*.npz")):
            with np.load(path, allow_pickle=False) as arrays:
                for scaling in ("scaled", "raw"):
                    if f"{scaling}/q" in arrays:
                        fields = (field(arrays, f"{scaling}/{name}") for name in FIELDS)
                        yield Problem(*fields, f"{path.stem}--{scaling}")


if __name__ == "__main__":
    benchmark.main(test_set_path=__file__, results_path=Path(__file__).with_suffix(".csv"))
''')


def read_test_set(path: str) -> list[tuple[str, Problem]]:
    """Names and programs of the test set in a file; ValueError with one sentence if there is none."""
    folder, module = Path(path).parent, Path(path).stem
    name = module.title().replace("_", "")
    sys.path.append(str(folder))  # as qpbenchmark does, for modules beside the file
    try:
        loaded = import_module(module)
        programs = [
            (str(problem.name), Problem(*(getattr(problem, field) for field in QP_FIELDS)))
            for problem in getattr(loaded, name, list)()
        ]
    except Exception as error:  # the user's code may raise anything
        raise ValueError(f"{type(error).__name__}: {error}") from None
    check(hasattr(loaded, name), f"has no class {name}, which qpbenchmark looks for in a file of that name")
    check(programs, "holds no problem")
    return programs


def write_test_set(folder: Path, set_name: str, sparse: bool) -> Path:
    """Write the class file of a problem set, ``piezobench_<set>.py``, into the folder of its problems,
    ``<set>--<problem>.npz``.

    ``sparse`` restricts qpbenchmark to sparse solvers.
    """
    module = f"piezobench_{set_name}"
    text = TEMPLATE.substitute(set=set_name, module=module, class_name=module.title().replace("_", ""), sparse=sparse)
    path = folder / f"{module}.py"
    write_text(path, text)
    return path
