"""All figures of the experiment from the runs that they share, and the page that puts them together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bench.experiment import (
    actuators,
    boundary,
    cycles,
    elementary_operators,
    feedback,
    loops,
    page,
    push_pull,
    robustness,
    staircases,
)
from bench.experiment.style import Exhibit
from bench.rig import trial
from bench.rig.rig import AXES, Rig
from piezo_model.atomic_file import write_text

PAGE = "experiment.md"


@dataclass(frozen=True)
class Experiment:
    """What an experiment gave: its page, the verdict and the exhibits on it."""

    page: Path
    verdict: str
    exhibits: tuple[Exhibit, ...]


def run(folder: Path, rig: Rig, progress: Callable[[str, int, int], None] = lambda what, done, total: None,
        situations: int = 20) -> Experiment:
    """Make the experiment and write its page and figures into a folder, which is made if it is not there; OSError where it cannot be.

    So many ``situations`` are drawn at random, besides the rig.
    """
    folder.mkdir(parents=True, exist_ok=True)
    disturbed = situations // 4 + 1
    total, done = len(push_pull.CASES) + len(actuators.CASES) + situations + disturbed + 5, 0

    def say(what: str) -> None:
        nonlocal done
        progress(what, done, total)
        done += 1

    say("straight line")
    straight = trial.straight(rig)
    say("best straight line with hindsight")
    hindsight = trial.best_straight(rig)
    say("self-learning compensation")
    learned = trial.learned(rig)
    say("a drifting stage")
    by_cycle = cycles.exhibit(straight, hindsight, learned)

    def rows(cases: Iterable[actuators.Case | push_pull.Case]) -> pd.DataFrame:
        def row(case: actuators.Case | push_pull.Case) -> dict[str, Any]:
            say(str(case))
            return case.row(rig)

        return pd.DataFrame([row(case) for case in cases])

    def drawn(count: int, what: str, of_seed: Callable[[int], Iterable[dict[str, Any]]]) -> pd.DataFrame:
        found: list[dict[str, Any]] = []
        for seed in range(robustness.FIRST_SEED, robustness.FIRST_SEED + count):
            say(f"{what}, situation {seed}")
            found += of_seed(seed)
        return pd.DataFrame(found)

    exhibits = (*(staircases.exhibit(i, straight, hindsight, learned) for i in range(len(AXES))),
                loops.exhibit(straight, learned), by_cycle, actuators.exhibit(rows(actuators.CASES)),
                push_pull.exhibit(rows(push_pull.CASES)),
                robustness.exhibit(drawn(situations, "learning", robustness.rows)),
                feedback.exhibit(drawn(disturbed, "feedback", feedback.rows)), elementary_operators.exhibit(), boundary.exhibit(learned))
    say("figures")
    for exhibit in exhibits:
        exhibit.write(folder)
    sentence = page.verdict(straight, hindsight, learned)
    write_text(folder / PAGE, page.render(rig, sentence, exhibits))
    return Experiment(folder / PAGE, sentence, exhibits)
