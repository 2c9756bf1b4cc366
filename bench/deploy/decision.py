"""Choice of a solver by the rule, explained in sentences, and the file of it.

1. Cost gap and violation of the answers to every problem are within the required accuracy, with a margin.
2. No deadline is missed that the machine's floor does not explain (`candidates`).
3. Of the remaining candidates, the one with the lowest p99.9 of the answer's time is chosen. If one of them has too few
   calls for that, p99 decides, or the median.

A deadline that the machine itself misses more often than not is refused, because the run is no evidence for it.
"""

import math
from dataclasses import dataclass

from bench.deploy.actuator_model import ChosenModel
from bench.deploy.candidates import QUANTILES, Candidate, Rule, candidates
from bench.deploy.deployment import Deployment
from bench.report.words import gap, marked, number, solver_lanes
from bench.store import Run, RunError
from bench.timing import percentiles
from piezo_model.learning.settings import EXACT_SOLVERS
from piezo_model.model import HysteresisCreepModel
from solvers import Lane

NAMES = (*(percentiles.name(q) for q in QUANTILES[:-1]), "median")


@dataclass(frozen=True)
class Decision:
    """The chosen candidate and the others."""

    run: Run
    rule: Rule
    chosen: Candidate
    runners_up: tuple[Candidate, ...]
    """The others that qualify, in order."""
    refused: tuple[tuple[Candidate, str], ...]
    """Candidates that do not qualify, with the reason, the nearest first."""
    by: int
    """Index in QUANTILES of the deciding percentile."""

    def sentences(self) -> list[str]:
        """The rule, the choice with its reasons, and the runners-up."""
        it, name = self.chosen, NAMES[self.by]
        here = " and ".join(self.run.machine_names)
        problems = "1 problem" if it.problems == 1 else f"{it.problems} problems"
        fewest, most = it.own_misses
        own = f"{most or 'none'} of them its own"
        if fewest < most:
            own = f"{fewest} to {most} of them its own, which this run cannot narrow down"
        sentences = [
            f"Rule: {self.rule.sentence}",
            f"Chosen: {it.name}: cost gap and violation at most {gap(it.worst)} over {problems}, a "
            f"margin of {it.margin:g}; none of its {it.judged} or more judged answers to a problem misses, so at "
            f"most {100.0 * it.miss_rate:.2g} % do (95 %); {it.missed} of {it.samples} deadlines missed, {own}; {name} "
            f"of an answer {number(it.times_us[self.by])} µs on the machine of the run ({here}).",
            "The compensator learns continuously: in C and in piezobench live with box_active_set, in Python with "
            f"{'it, too' if it.solver in EXACT_SOLVERS else marked(it.solver)}.",
        ]
        if self.by:
            least = next(
                candidate for candidate in (it, *self.runners_up) if math.isnan(candidate.times_us[self.by - 1])
            )
            sentences.append(
                f"Decided by the {name}, the finest percentile that all who qualify support: {NAMES[self.by - 1]} "
                f"needs {percentiles.needed(QUANTILES[self.by - 1])} samples and has {least.calls} for {least.name}."
            )
        sentences += [
            f"Runner-up: {candidate.name}, {name} {number(candidate.times_us[self.by])} µs."
            for candidate in self.runners_up[:3]
        ]
        count = len(self.refused)
        return (
            [*sentences, f"{solver_lanes(count)} do{'' if count != 1 else 'es'} not qualify."] if count else sentences
        )

    def deployment(self, actuator: ChosenModel) -> Deployment[HysteresisCreepModel]:
        """Content of the file; the mode is the one that `docs/learning.md` recommends."""
        return Deployment(
            model=actuator.model,
            solver=self.chosen.solver,
            lane=Lane(self.chosen.lane),
            tier=self.chosen.tier,
            settings=self.chosen.settings,
            mode="continuous",
            x_limits=actuator.model.structure.x_range,
            evidence={
                "run": self.run.path.name,
                "machines": self.run.machines,
                "solver_version": self.run.settings.get("lanes", {}).get(
                    f"{self.chosen.solver} ({self.chosen.lane})", ""
                ),
                "rule": self.rule.sentence,
                "why": self.sentences(),
                "figures": self.chosen.metrics(),
                "runners_up": [candidate.metrics() for candidate in self.runners_up[:3]],
                **actuator.evidence(),
            },
        )


def decide(run: Run, rule: Rule) -> Decision:
    """Apply the rule; RunError if no solver qualifies."""
    verdicts = [(candidate, candidate.failing(rule)) for candidate in candidates(run, rule)]
    qualified, refused = (
        [candidate for candidate, why in verdicts if not why],
        [(candidate, why) for candidate, why in verdicts if why],
    )
    refused.sort(key=lambda pair: (not pair[0].margin, pair[0].own_misses[0] / max(pair[0].samples, 1), pair[0].worst))
    if not qualified:
        raise RunError(
            f"{run.path}: no solver qualifies"
            + (
                f"; the nearest, {refused[0][0].name}, {refused[0][1]}"
                if refused
                else f", none was raced on scaled data in the lanes {', '.join(rule.lanes)}"
            )
        )
    finer = range(len(QUANTILES) - 1)
    by = next((i for i in finer if not any(math.isnan(candidate.times_us[i]) for candidate in qualified)), len(finer))
    chosen, *others = sorted(qualified, key=lambda candidate: (candidate.times_us[by], candidate.name))
    return Decision(run, rule, chosen, tuple(others), tuple(refused), by)
