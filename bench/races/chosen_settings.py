"""Which setting a solver has in a stream or a loop: the one that stands for a tier in the table of a one-shot race.

That is a run of the user's, or the accuracy of the reference run, which is shipped with the package. A solver that the table does not know, one
of a file and one whose ladder has changed since take their tightest setting, and are said to be untested; so do those that do not
reach the tier there, and are said not to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

import pandas as pd

from bench.derived.tier_settings import tier_settings
from bench.passed import columns
from bench.passed.race_error import RaceError
from bench.passed.task import Setting, settings_of, tightest
from bench.races.oneshot.rows import ONESHOT
from bench.store import Run
from solvers import Tier
from solvers.registry import Described

SHIPPED = "reference_rows.parquet"
NAMES = ("problem_set", "problem", "scaling", "solver", "lane", "setting", "rung", "is_default", "start", "repeat", "host", "status")
FIGURES = ("cost_gap", "violation", "timed_gap", "stage_excess", "noise_um")
ACCURACY = columns.schema((*NAMES, *FIGURES))
"""What is shipped of the rows."""
UNTESTED, NOT_REACHED = "untested", "not reached"


@dataclass(frozen=True)
class Choice:
    """A setting with the tiers that it stands for, and on what grounds."""

    setting: Setting
    tiers: tuple[Tier, ...]
    basis: str


def table_of(run: str) -> tuple[pd.DataFrame, str]:
    """The settings for each tier by a run, or by the reference run for "", and the name of that run."""
    if run:
        opened = Run.open(Path(run))
        if (race := opened.settings.get("race", "oneshot")) != "oneshot":
            raise RaceError(f"{run} is a {race} race, and settings are taken from a one-shot race")
        return tier_settings(opened.rows(ONESHOT)), opened.path.name
    with as_file(files("bench.races") / SHIPPED) as path:
        return tier_settings(columns.read(path, ACCURACY)), "reference"


def choices(solver: Described, tiers: Sequence[Tier], table: pd.DataFrame, name: str) -> list[Choice]:
    """The settings of a solver for these tiers, each once."""
    known = {setting.text: setting for setting in settings_of(solver)}
    mine = table[(table.scaling == "scaled") & (table.solver == solver.name) & (table.lane == str(solver.lane))].set_index("tier").setting
    found: dict[Setting, Choice] = {}
    for tier in tiers:
        text = "" if tier is Tier.DEFAULT else str(mine.get(str(tier), UNTESTED))
        if tier is Tier.DEFAULT:
            setting, basis = next(setting for setting in known.values() if setting.is_default), "default"
        elif text in known:
            setting, basis = known[text], name
        else:
            setting, basis = tightest(solver), UNTESTED if text else NOT_REACHED
        before = found.get(setting)
        found[setting] = Choice(setting, (*(before.tiers if before else ()), tier), basis)
    return list(found.values())
