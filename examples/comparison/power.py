"""Error rates of a comparison, from simulated pairs of runs; takes minutes.

    python examples/comparison/power.py [--pairs 200] [RUN_A RUN_B]

In each pair nothing changed, or one solver lane became slower or faster by a factor of 1.2. The noise is simulated, for
fields from small to that of a default race and machines from quiet to noisy, or taken from two real runs between which
nothing changed. The script prints the share of pairs without a change in which a lane differs (false), of changes that
are found, of changes reported as no difference (silent), and of lanes without a finding (cannot tell).
"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from simulated_pairs import pair, ratios, resampled

from bench.comparison.compare import BLOCK, CANNOT_TELL, SAME, SOLVER_LANE, compare_times, in_common, joinable, levels
from bench.derived.measurements import INTERLEAVED, Measurements
from bench.store import Run
from solvers.arrays import Vector

CHANGE = 1.2


def rates(make: Callable[[np.random.Generator], list[Vector]], pairs: int) -> dict[str, float]:
    """Shares of pairs with false findings, with the change found, with the change missed silently, and of lanes without
    a finding."""
    chance = np.random.default_rng(1)
    counts = dict.fromkeys(("false", "found", "silent", "cannot tell"), 0.0)
    for _ in range(pairs):
        same = compare_times(pair(make(chance)), CHANGE)[0].finding
        counts["false"] += (~same.isin([SAME, CANNOT_TELL])).any()
        counts["cannot tell"] += (same == CANNOT_TELL).mean()
        times, _ = compare_times(pair(make(chance), {"s0": CHANGE ** chance.choice((-1, 1))}), CHANGE)
        finding = times.finding[times.solver == "s0"].item()
        counts["found"] += finding not in (SAME, CANNOT_TELL)
        counts["silent"] += finding == SAME
    return {name: count / pairs for name, count in counts.items()}


def noise_of(a: Run, b: Run) -> list[Vector]:
    """Change of each lane relative to the field on each problem of two runs."""
    found = levels(*in_common([a, b], [joinable(Measurements.of(run)) for run in (a, b)]))
    found = found[found.timed == INTERLEAVED]
    own = (found.level_b - found.level_a).groupby([found[name] for name in [*BLOCK, *SOLVER_LANE]]).median().dropna()
    own -= own.groupby(level=BLOCK).transform("median")
    return [part.to_numpy() for _, part in own.groupby(level=SOLVER_LANE)]


def main() -> None:
    """Simulate and print the rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="*")
    parser.add_argument("--pairs", type=int, default=200)
    options = parser.parse_args()
    kinds: dict[str, Callable[[np.random.Generator], list[Vector]]] = {
        f"{lanes} lanes, {problems} problems, offset {offset}": partial(
            ratios, lanes=lanes, problems=problems, offset=offset
        )
        for lanes, problems in ((68, 36), (68, 12), (40, 18), (10, 6), (5, 3))
        for offset in (0.004, 0.008, 0.015)
    }
    if options.runs:
        own = noise_of(*map(Run.open, options.runs))
        kinds = {" and ".join(path.name for path in options.runs): partial(resampled, own=own)}
    for name, make in kinds.items():
        shares = [f"{outcome} {100.0 * share:.1f} %" for outcome, share in rates(make, options.pairs).items()]
        print(f"{name}: {', '.join(shares)}", flush=True)


if __name__ == "__main__":
    main()
