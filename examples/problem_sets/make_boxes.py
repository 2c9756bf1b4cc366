"""Make the stored programs of the problem set `boxes` from other sets, or publish the whole set.

python examples/problem_sets/make_boxes.py                  # writes bench/problems/boxes/identification.npz again
python examples/problem_sets/make_boxes.py --out boxes      # writes boxes.npz, a QPS file and a certificate each

boxes.npz has, for each program, NAME/P, NAME/q, NAME/lb, NAME/ub, the optimum NAME/x and its value NAME/value, rounded.
"""

import argparse
import json
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.problem_files.npz import packed_program
from bench.problems import make
from bench.problems.boxes import DATA, EACH, Boxes
from piezo_model.atomic_file import replacing, write_text
from piezo_model.identification_problem import Scaling
from solvers.certificate_document import document

SOURCES: dict[str, tuple[Scaling, ...]] = {
    "paper": ("scaled",),
    "measured": ("scaled", "raw"),
    "orders": ("scaled", "raw"),
    "excitation": ("scaled",),
}
"""Sets and scalings of the stored programs, in this order, of at most 60 variables."""
LARGEST = 60


def stored() -> dict[str, Problem]:
    """EACH programs from identification by name."""
    found = {
        f"{problem.set_name}-{problem.name}-{scaling}": problem.forms[scaling].qp
        for name, scalings in SOURCES.items()
        for problem in make(name).problems()
        for scaling in scalings
        if problem.d <= LARGEST
    }
    return dict(islice(found.items(), EACH))


def as_qps(name: str, qp: Problem) -> str:
    """A program with bounds as QPS, with every digit of its doubles."""
    rows = [f"NAME {name}", "ROWS", " N cost", "COLUMNS"]
    rows += [f" x{i} cost {float(entry)!r}" for i, entry in enumerate(qp.q)]
    rows += ["RHS", "BOUNDS"]
    for i, (low, high) in enumerate(zip(qp.lb, qp.ub, strict=True)):
        rows.append(f" LO b x{i} {float(low)!r}" if np.isfinite(low) else f" MI b x{i}")
        rows += [f" UP b x{i} {float(high)!r}"] if np.isfinite(high) else []
    rows.append("QUADOBJ")
    lower = zip(*np.nonzero(np.tril(qp.P)), strict=True)
    rows += [f" x{j} x{i} {float(qp.P[i, j])!r}" for i, j in lower]
    return "\n".join([*rows, "ENDATA", ""])


def publish(folder: Path) -> None:
    """Write the set with its certificates."""
    folder.mkdir(parents=True)
    arrays: dict[str, Any] = {}
    for problem in Boxes().problems():
        form = problem.forms["raw"]
        write_text(folder / f"{problem.name}.qps", as_qps(problem.name, form.qp))
        write_text(folder / f"{problem.name}.json", json.dumps(document(form.qp, form.certificate)))
        arrays |= packed_program(form.qp, f"{problem.name}/")
        arrays[f"{problem.name}/x"] = np.array(form.certificate.x)
        arrays[f"{problem.name}/value"] = np.array(form.certificate.value_rounded)
    np.savez_compressed(folder / "boxes.npz", **arrays)
    write_text(folder / "LICENSE", "CC BY 4.0, https://creativecommons.org/licenses/by/4.0/\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="new folder for the published set")
    if out := parser.parse_args().out:
        publish(out)
    else:
        programs = {
            key: array for name, qp in stored().items() for key, array in packed_program(qp, f"{name}/").items()
        }
        with replacing(DATA) as temporary:
            np.savez_compressed(temporary, **programs)
