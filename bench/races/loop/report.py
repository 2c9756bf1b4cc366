"""What a closed-loop race says and shows."""

from dataclasses import replace

import numpy as np
import pandas as pd

from bench.derived.pictures import ranked
from bench.races.chosen_settings import definition
from bench.races.loop import figures
from bench.races.loop.race import LOOP, LoopSettings
from bench.races.settings import settings_of
from bench.report.plot import GREY, LEAST_GAP, Axis, Mark, Plot
from bench.report.report import Figure, Report, Table, what_went_wrong
from bench.report.words import OURS_NOTE, gap, number
from bench.store import Run

_POINTS = (Mark("point", colour=GREY, size=30.0, opacity=0.5), Mark("point", "name", where="datum.front", size=80.0))
ID_COLUMNS = ("stage", "solver", "lane", "tier")
DEFINITIONS = (
    "Every solver learns in the same loop on the same stage, with the same reference and noise, in a process of its "
    "own. The drifting stage has actuators whose gain changes.",
    "Cost gap: exact, of the weights taken over last, against the certified optimum of the data that they were "
    "learned from. Weights that explain them worse than the old ones are refused.",
    "Time to learn: from the last sample that was learned from to the decision; weights are that old when they are "
    "taken over.",
    "The paper's method takes one step a sample, here in learning phases of several lengths. What the others take is "
    "measured, so it and the last digits of their errors depend on the machine.",
    OURS_NOTE,
)


def report(run: Run) -> Report:
    """Everything from the rows of a finished run."""
    rows = run.rows(LOOP)
    table = figures.summary(rows)
    found = figures.closed_loop(table)
    headings = (
        "stage",
        "solver",
        "lane",
        "cost gap",
        "RMS, %",
        "RMS, nm",
        "largest, %",
        "largest, nm",
        "time to learn, samples",
        "taken over",
        "refused",
        "status",
    )
    every = [
        [
            line.problem,
            line.label,
            line.lane,
            gap(line.cost_gap),
            f"{line.rms_percent:.4f}",
            f"{1e3 * line.rms_um:.1f}",
            f"{line.max_percent:.3f}",
            f"{1e3 * line.max_um:.0f}",
            _samples(line.learn_samples),
            str(line.hand_overs),
            str(line.refused),
            line.status,
        ]
        for _, line in table.iterrows()
    ]
    return Report(
        figures.verdict(table),
        ranking(table),
        table,
        notes=list(figures.notes(table)),
        definitions=(*DEFINITIONS, definition(settings_of(run, LoopSettings).settings_run)),
        tables=[
            Table("Every learner on each stage, last window", headings, every, 3, ("stage", "lane", "status")),
            _by_window(rows, table),
            what_went_wrong(rows.rename(columns={"problem": "stage"}), (*ID_COLUMNS, "status", "message"), ID_COLUMNS),
        ],
        figures=[
            _against(
                found,
                "loop",
                "Does the stage notice its solver?",
                "RMS error of both axes over the last window against the exact cost gap of the weights in use. Lower "
                "is better; where points lie level, the stage does not notice. Dashed: a straight line in place of a "
                f"model. Gaps below {LEAST_GAP:g} are drawn at that.",
                Axis("drawn", "cost gap of the weights in use", log=True, powers_of_ten=True),
            ),
            _against(
                found[found.learn_samples > 0.0].reset_index(drop=True),
                "loop_time",
                "Does it notice the time to learn?",
                "The same errors against the time that the weights took to learn.",
                Axis("learn_samples", "time to learn, samples", log=True),
            ),
        ],
    )


def _against(found: pd.DataFrame, name: str, title: str, definition: str, x: Axis) -> Figure:
    """Tracking error by stage against a column; a point is a learner, and those with the least errors have colours and
    names."""
    view = "the " + found.problem + " stage"
    table = ranked(
        found.assign(view=view, drawn=np.maximum(found.cost_gap, LEAST_GAP)), found.rms_percent.where(~found.front, 0.0)
    )
    y = Axis("rms_percent", "RMS error, % of range", log=True)
    plots = [
        Plot(
            x,
            replace(y, title=f"{y.title}, {stage}"),
            _POINTS,
            ("name", "cost_gap", "rms_percent", "learn_samples"),
            where=f"problem == '{stage}'",
            rules={"y": float(part.straight_rms_percent.median())},
            height=300,
        )
        for stage, part in table.groupby("problem", sort=False)
    ]
    return Figure(name, title, definition, table.drop(columns="view"), plots)


def ranking(table: pd.DataFrame) -> Table:
    """Errors of each learner on each stage, the paper's method first."""
    stages = list(dict.fromkeys(table.problem))
    rows = [
        [
            label,
            lane,
            *(text for stage in stages for text in (_on(lines[stage]) if stage in lines else ("–",) * 2)),
            _samples(max(float(line.learn_samples) for line in lines.values())),
        ]
        for label, lane, lines in figures.by_learner(table)
    ]
    headings = ("solver", "lane", *(f"{what} {stage}" for stage in stages for what in ("nm", "gap")), "samples")
    return Table(
        "Tracking error by solver",
        headings,
        rows,
        2,
        ("lane",),
        f"RMS error over the last window in nm; up to {figures.NOTICED:g} times the least on that stage counts as "
        f"unnoticed. Gap: (V − V*)/(V* + c) of the weights in use. Samples: time to learn. {OURS_NOTE}",
    )


def _on(line: pd.Series) -> tuple[str, str]:
    """What a learner reaches on a stage."""
    return number(1e3 * line.rms_um), gap(line.cost_gap)


def _by_window(rows: pd.DataFrame, table: pd.DataFrame) -> Table:
    """RMS errors of both axes together in each window, in the order of the summary."""
    errors = figures.by_window(rows)
    lines = [
        [line.problem, line.label, *(f"{value:.4f}" for value in errors.loc[tuple(line[figures.GROUP])])]
        for _, line in table.iterrows()
    ]
    return Table(
        "RMS error in each window, % of range",
        ("stage", "solver", *(str(1 + int(w)) for w in errors.columns)),
        lines,
        2,
    )


def _samples(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "–"
