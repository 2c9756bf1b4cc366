"""Make the stored programs of the problem set `boxes`, or publish the set.

Those from identification are of other sets. The others are drawn in integers, by the one random sequence that Python
guarantees (``random.Random.random``), and hence do not depend on a library or a processor:

- P = L D Lᵀ times a power of two, with L unit lower triangular in {−1, 0, 1} and D powers of two, so P ⪰ 0 exactly;
- q = λ − P x, where x is at a bound or between its bounds and λ has the sign that the bound requires.

Unless q has to be rounded, x is an optimum.

python examples/problem_sets/make_boxes.py                  # writes bench/problems/boxes.npz again
python examples/problem_sets/make_boxes.py --out boxes      # writes boxes.npz, a QPS file and a certificate each

boxes.npz has, for each program, NAME/P, NAME/q, NAME/lb, NAME/ub, the optimum NAME/x and its value NAME/value, rounded.
"""

import argparse
import json
import random
from itertools import islice
from math import log2
from pathlib import Path
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.problem_files.npz import packed_program
from bench.problems import make
from bench.problems.foreign import BOXES, Boxes
from piezo_model.atomic_file import replacing, write_text
from piezo_model.identification_problem import Scaling
from solvers.certificate_document import document

SOURCES: dict[str, tuple[Scaling, ...]] = {
    "paper": ("scaled",),
    "measured": ("scaled", "raw"),
    "orders": ("scaled", "raw"),
    "excitation": ("scaled",),
}
"""Sets and scalings of the programs from identification, in this order, of at most LARGEST variables."""
EACH = 40
"""Number of programs of a kind."""
KINDS = {
    "conditioned": (1e2, 1e14),
    "degenerate": (1e1, 1e6),
    "semidefinite": (1e1, 1e6),
    "scaled": (1e1, 1e8),
}
"""Ratios of the largest to the smallest element of D, for the first and the last program of a kind."""
LARGEST = 60
"""Largest number of variables."""


def from_identification() -> dict[str, Problem]:
    """EACH programs from identification, by name."""
    found = {
        f"{problem.set_name}-{problem.name}-{scaling}": problem.forms[scaling].qp
        for name, scalings in SOURCES.items()
        for problem in make(name).problems()
        for scaling in scalings
        if problem.d <= LARGEST
    }
    return dict(islice(found.items(), EACH))


def drawn(kind: str, i: int) -> Problem:
    """The program ``i`` of a kind, with 1 to LARGEST variables."""
    chance = random.Random(f"{kind} {i}")

    def below(limit: int) -> int:
        return int(chance.random() * limit)

    d = 1 + (LARGEST - 1) * i // (EACH - 1)
    low, high = (log2(ratio) for ratio in KINDS[kind])
    most = round(low + (high - low) * i / (EACH - 1))
    exponents = [0, most, *(below(most + 1) for _ in range(d))][:d]
    D = [0 if kind == "semidefinite" and below(3) == 0 else 1 << e for e in exponents]
    L = [[below(3) - 1 if below(d) < 3 else 0 for _ in range(row)] + [1] for row in range(d)]
    P = [[sum(a * b * c for a, b, c in zip(L[r], L[c], D, strict=False)) for c in range(d)] for r in range(d)]
    lb, ub, x, multipliers = [], [], [], []
    for _ in range(d):
        at, width = below(3), 0 if kind == "degenerate" and below(8) == 0 else 1 + below(4)
        bottom = below(17) - 8
        lb.append(-np.inf if at == 1 and below(4) == 0 else bottom)
        ub.append(np.inf if at == 0 and below(4) == 0 else bottom + width)
        x.append((2 * bottom, 2 * bottom + width, 2 * (bottom + width))[at])  # in halves
        size = 0 if at == 1 or (kind == "degenerate" and below(2) == 0) else 1 + below(9)
        multipliers.append(size if at == 0 else -size)
    q = [2 * each - sum(p * t for p, t in zip(row, x, strict=True)) for row, each in zip(P, multipliers, strict=True)]
    shifts = np.array([below(41) - 20 if kind == "scaled" else 0 for _ in range(d)])
    cost = below(121) - 60 if kind == "scaled" else 0
    return Problem(
        np.ldexp(np.array(P, dtype=np.float64), shifts[:, None] + shifts + cost),
        np.ldexp(np.array(q, dtype=np.float64), shifts - 1 + cost),
        lb=np.ldexp(np.array(lb, dtype=np.float64), -shifts),
        ub=np.ldexp(np.array(ub, dtype=np.float64), -shifts),
    )


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
        of_kinds = {f"{kind}-{i:02d}": drawn(kind, i) for kind in KINDS for i in range(EACH)}
        stored = of_kinds | dict(sorted(from_identification().items()))
        programs = {key: array for name, qp in stored.items() for key, array in packed_program(qp, f"{name}/").items()}
        with replacing(BOXES) as temporary:
            np.savez_compressed(temporary, **programs)
