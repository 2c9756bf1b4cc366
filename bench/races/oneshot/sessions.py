"""Solvers that are added to a finished run: what is timed again beside them, and what that says of the machine."""

from collections.abc import Iterator

from bench.derived.measurements import FLOOR, ONESHOT, Measurements
from bench.derived.ranking import PACE, ranking
from bench.messages.task import Tier
from bench.report.words import joined, marked
from bench.store import Anchor, Run
from solvers import find
from solvers.registry import FAMILIES

ANCHORS = 2
"""Number of solver lanes that are timed again, the fastest of the run."""


def anchors(run: Run) -> list[Anchor]:
    """The fastest lanes of different solvers that reach 1e-9 on all problems and are installed."""
    found: dict[str, Anchor] = {}
    for line in ranking(Measurements.of(run)):
        high = line.results.get(Tier.HIGH)
        if high is None or not high.reached or line.partial or line.name == PACE or line.lane in FAMILIES:
            continue
        try:
            find(line.solver, line.lane)
        except KeyError:  # from a file of the user's, whose code a run does not choose
            continue
        found.setdefault(line.solver, {"solver": line.solver, "lane": line.lane, "setting": high.setting})
    return [*found.values()][:ANCHORS]


def drift(run: Run, measurements: Measurements) -> Iterator[str]:
    """For each session a sentence on what the null solver and the anchors took in it, over what they took before."""
    every = run.rows(ONESHOT)
    before = measurements.rows.set_index("task").answer_us
    for number, session in enumerate(run.sessions, 1):
        rows = every[(every.session == number) & (every.timed == "hot")]
        times = []
        for solver, lane in [(FLOOR, ""), *((anchor["solver"], anchor["lane"]) for anchor in session["anchors"])]:
            again = rows[(rows.solver == solver) & (rows.lane.eq(lane) if lane else True)].set_index("task").answer_us
            ratio = (again / before.reindex(again.index)).median()
            times.append(f"{marked(solver)}{lane and f' ({lane})'} {ratio:.2f}")
        added = {*zip(rows.solver, rows.lane, strict=True)} - {(a["solver"], a["lane"]) for a in session["anchors"]}
        names = joined(sorted(f"{marked(solver)} ({lane})" for solver, lane in added if solver != FLOOR))
        yield (
            f"{names} joined later; beside them, what was timed again took this many times as long as before: "
            f"{joined(times)}."
        )
