"""How often a comparison of independent races is right on this machine: an hour or more, so no test runs it.

    python tests/bench/power_of_comparison.py FOLDER [--pairs 6] [OPTIONS OF THE RACE]

Beside the default field races a solver of one's own that can be made to wait. Compared are pairs of races in which nothing
changed, pairs in which it takes 1.5 times as long, and, with the repeats that the pairs without a change recommend for it, pairs in
which it takes 1.2 times as long. What is raced already is not raced again, so that an interrupted measurement is carried on.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import slowed_solver

from bench.comparison.compare import RunComparison, compare_runs
from bench.comparison.lines import CHANGES
from bench.store import Run


def race(folder: Path, factor: float, repeats: int, number: int, words: list[str]) -> Run:
    """A race with the solver that waits, or what is there of it."""
    name = f"slowed{factor:g}-repeats{repeats}-{number}"
    if not (folder / name / "report.md").is_file():
        file = slowed_solver.write(folder / f"solver-{factor:g}", factor)
        subprocess.run([sys.executable, "-m", "bench", "race", *words, "--solver", str(file), "--repeats", str(repeats),
                        "--out", str(folder), "--name", name], check=True, stdout=subprocess.DEVNULL)
    return Run.open(folder / name)


def pair(folder: Path, number: int, factor: float, repeats: int, words: list[str]) -> RunComparison:
    """Two races, the second with the solver slowed by a factor; says what is found. A first race is the first of every factor."""
    second = race(folder, factor, repeats, 2 * number + 1, words)
    found = compare_runs(race(folder, 1.0, repeats, 2 * number, words), second)
    lines = found.times.lines
    own, others = lines[lines.solver == "slowed"], lines[lines.solver != "slowed"]
    false = others if factor != 1.0 else lines
    print(f"{second.path.name}: "
          + "; ".join(f"{line.timed} {line.ratio:.2f} ({line.ratio_low:.2f} to {line.ratio_high:.2f}), {line.finding}, could have shown "
                      f"{line.shown:.2f}" for line in own.itertuples())
          + f"; false lines {false.finding.isin(CHANGES).sum()} of {len(false)}", flush=True)
    return found


def main() -> None:
    """Race and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=6)
    asked, words = parser.parse_known_args()
    same = [pair(asked.folder, i, 1.0, 1, words) for i in range(asked.pairs)]
    half = [pair(asked.folder, i, 1.5, 1, words) for i in range(asked.pairs)]
    repeats = max(int(each.times.lines[each.times.lines.solver == "slowed"].repeats.min()) for each in same)
    fifth = [pair(asked.folder, i, 1.2, repeats, words) for i in range(asked.pairs)]
    changed = [each.times.lines.finding.isin(CHANGES) for each in same]
    print(f"Nothing changed: {sum(map(sum, changed))} of {sum(map(len, changed))} lines differ.")
    for text, pairs in (("1.5 times, default effort", half), (f"1.2 times, {repeats} repeats", fifth)):
        lines = [each.times.lines for each in pairs]
        hits = sum(((line.solver == "slowed") & (line.finding == "slower")).any() for line in lines)
        print(f"{text}: found in {hits} of {len(pairs)} pairs.")


if __name__ == "__main__":
    main()
