"""All figures of the experiment from the runs that they share, and the page that puts them together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.experiment import cycles, loops, page, staircases
from bench.experiment.plots import Exhibit
from bench.passed.progress import Progress, silent
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


def run(folder: Path, rig: Rig, progress: Progress = silent) -> Experiment:
    """Make the experiment and write its page and figures into a folder, which is made if it is not there; OSError where it cannot be."""
    folder.mkdir(parents=True, exist_ok=True)
    progress("straight line", 0, 5)
    straight = trial.straight(rig)
    progress("best straight line with hindsight", 1, 5)
    hindsight = trial.best_straight(rig)
    progress("self-learning compensation", 2, 5)
    learned = trial.learned(rig)
    progress("a drifting stage", 3, 5)
    by_cycle = cycles.exhibit(straight, hindsight, learned)
    progress("figures", 4, 5)
    exhibits = (*(staircases.exhibit(i, straight, hindsight, learned) for i in range(len(AXES))), loops.exhibit(straight, learned), by_cycle)
    for exhibit in exhibits:
        exhibit.write(folder)
    sentence = page.verdict(straight, hindsight, learned)
    write_text(folder / PAGE, page.render(rig, sentence, exhibits))
    return Experiment(folder / PAGE, sentence, exhibits)
