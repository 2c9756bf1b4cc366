"""Settings of the solvers in a stream: those chosen for a tier in a one-shot race.

That race is a run of the user's, or the reference run, whose accuracies are shipped with the package. A solver that the
race does not have, or whose ladder has changed since, gets its tightest setting, marked as untested; so does a solver
that does not reach the tier there, marked as not reached. ``make settings RUN=results/reference`` writes the shipped
table.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from bench.derived.measurements import ONESHOT, rows_of
from bench.derived.tiers import tier_settings
from bench.messages import columns
from bench.messages.task import RaceError, Setting, Tier, default_setting, settings_ladder, tightest
from bench.store import Run
from piezo_model.atomic_file import replacing
from solvers.registry import Described

SCALING = "scaled"
"""Scaling of the data in a stream."""
SHIPPED = "reference_rows.parquet"
NAMES = "problem_set problem scaling solver lane setting rung is_default start repeat host status"
FIGURES = "cost_gap violation timed_gap timed_violation stage_excess timed_stage_excess noise_um"
ACCURACY = pa.schema([ONESHOT.arrow.field(name) for name in f"{NAMES} {FIGURES}".split()])
"""Columns of the shipped rows."""
DEFAULT, EACH, REFERENCE = "default", "each", "reference"
UNTESTED, NOT_REACHED = "untested", "not reached"
"""Basis of a setting, if it is not the name of the run in which it was chosen: ``default`` for the solver's defaults,
``untested`` and ``not reached`` for its tightest setting, ``each`` for one of several that all race."""
Choices = Mapping[Setting, Mapping[Tier, str]]
"""Settings with the tiers of each, and the basis of the choice."""


def table_of(run: str) -> tuple[pd.DataFrame, str]:
    """The setting for each tier chosen in a run, by default the reference run, and the name of that run.

    Raises
    ------
    RunError, RaceError
        The run is missing, not finished, or not a one-shot race in scaled data.
    """
    if not run:
        return tier_settings(columns.read(Path(__file__).with_name(SHIPPED), ACCURACY)), REFERENCE
    opened = Run.open(Path(run))
    rows = rows_of(opened)
    if not (rows.scaling == SCALING).any():
        raise RaceError(f"{run}: settings are taken from a race in scaled data, and this one has none")
    return tier_settings(rows), opened.path.name


def choices(solver: Described, tiers: Sequence[Tier], table: pd.DataFrame, name: str) -> Choices:
    """The settings of a solver for these tiers, by the table of the run ``name``."""
    by_text = {setting.text: setting for setting in settings_ladder(solver)}
    of_solver = table[(table.scaling == SCALING) & (table.solver == solver.name) & (table.lane == str(solver.lane))]
    of_tier = of_solver.set_index("tier").setting
    chosen: dict[Setting, dict[Tier, str]] = {}
    for tier in tiers:
        text = of_tier.get(str(tier))
        if tier is Tier.DEFAULT:
            setting, basis = default_setting(solver), DEFAULT
        elif text in by_text:
            setting, basis = by_text[text], name
        else:
            setting, basis = tightest(solver), NOT_REACHED if text == "" else UNTESTED
        chosen.setdefault(setting, {})[tier] = basis
    return chosen


def tier_label(tier: str, basis: str) -> str:
    """A tier in a table, marked if its setting is untested or does not reach it.

    Examples
    --------
    >>> tier_label("high", "reference"), tier_label("high", "untested")
    ('high', 'high, untested')
    """
    return f"{tier}, {basis}" if basis in (UNTESTED, NOT_REACHED) else tier


def definition(run: str) -> str:
    """Explanation of the settings in the report of a race that took them from this run."""
    return (
        f"The setting of a solver is the one that stands for the tier in {run or 'the reference run'}, evaluated "
        "at the constant of these "
        "data. Untested: it does not know this solver, or not with these settings, so the tightest is taken; not "
        "reached: no setting that was measured there reaches the tier, and again the tightest is taken."
    )


def accuracy(rows: pd.DataFrame) -> pd.DataFrame:
    """The shipped rows of a one-shot race: cold answers on scaled data."""
    return rows.loc[(rows.scaling == SCALING) & (rows.start == "cold"), ACCURACY.names].reset_index(drop=True)


def ship(run: Path, path: Path) -> None:
    """Write the shipped table from a finished run."""
    table = pa.Table.from_pandas(accuracy(rows_of(Run.open(run))), ACCURACY, preserve_index=False)
    with replacing(path) as temporary:
        parquet.write_table(table, temporary, compression="zstd")


if __name__ == "__main__":
    ship(Path(sys.argv[1]), Path(__file__).with_name(SHIPPED))
