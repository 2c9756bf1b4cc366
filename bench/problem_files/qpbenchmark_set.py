"""A folder of saved problems as a test set of qpbenchmark: one Python file beside them, which needs nothing of ours.

qpbenchmark loads the class whose name is the file's in title case (S. Caron and others, the package qpbenchmark, class
``TestSet``). Each problem is there once in each scaling.
"""

from __future__ import annotations

from pathlib import Path
from string import Template

from piezo_model.atomic_file import write_text

TEMPLATE = Template('''"""Test set of qpbenchmark: the problem set $set of piezobench, in each scaling.

    qpbenchmark $module.py run

Made by `piezobench problems --set $set --export`; the problems are the NPZ files beside this one, and their field `meta`
holds the certified optima.
"""

from pathlib import Path

import numpy as np
from qpbenchmark import Problem, TestSet
from scipy.sparse import csc_matrix

FIELDS = ("P", "q", "G", "h", "A", "b", "lb", "ub")


def field(arrays, name):
    """A vector or a matrix, dense or in compressed columns; None where the problem has none."""
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
                        yield Problem(*(field(arrays, f"{scaling}/{name}") for name in FIELDS), f"{path.stem}--{scaling}")
''')


def write_test_set(folder: Path, set_name: str, sparse: bool) -> Path:
    """Write the class file of one problem set.

    Parameters
    ----------
    folder : Path
        Where the problems are, as ``<set>--<problem>.npz``.
    sparse : bool
        Whether any matrix is sparse; qpbenchmark then asks sparse solvers only.

    Returns
    -------
    Path
        ``piezobench_<set>.py`` in that folder.
    """
    module = f"piezobench_{set_name}"
    text = TEMPLATE.substitute(set=set_name, module=module, class_name=module.title().replace("_", ""), sparse=sparse)
    path = folder / f"{module}.py"
    write_text(path, text)
    return path
