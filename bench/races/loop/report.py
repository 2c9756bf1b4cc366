"""The report of a closed-loop race."""

from dataclasses import replace

import numpy as np
import pandas as pd

from bench.derived.accuracy import worst
from bench.derived.pictures import ranked
from bench.races.chosen_settings import definition
from bench.races.loop import summary
from bench.races.loop.race import LOOP, LoopSettings
from bench.races.settings import settings_of
from bench.report.plot import GREY, LEAST_GAP, Axis, Mark, Plot
from bench.report.report import Figure, Report, Table, what_went_wrong
from bench.report.words import OURS_NOTE, gap, number
from bench.store import Run

_POINTS = (
    Mark("point", colour=GREY, size=30.0, opacity=0.5),
    Mark("point", "name", where={"front": [True]}, size=80.0),
)
ID_COLUMNS = ("stage", "solver", "lane", "tier")
DEFINITIONS = (
    "Every solver learns in the same loop on the same stage, with the same reference and noise, in a process of its "
    "own. The gains of the drifting stage's actuators change.",
    "Cost gap: exact, of the weights of the last hand-over, against the certified optimum of the data that they were "
    "learned from. Weights with a larger error on these data than the weights in use are refused.",
    "Time to learn: from the last sample of these data to the hand-over; it is the age of the new weights.",
    "The paper's method takes one step per sample, in learning phases of several lengths. The times of the others are "
    "measured, so these times and the last digits of the errors depend on the machine.",
    OURS_NOTE,
)


def report(run: Run) -> Report:
    """The report of a finished run."""
    rows = run.rows(LOOP)
    table = summary.summary(rows)
    points = summary.closed_loop(table)
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
        "hand-overs",
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
        summary.verdict(table),
        ranking(table),
        table,
        notes=list(summary.notes(table)),
        definitions=(*DEFINITIONS, definition(settings_of(run, LoopSettings).settings_run)),
        tables=[
            Table("Every learner on each stage, last window", headings, every, 3, ("stage", "lane", "status")),
            _by_window(rows, table),
            what_went_wrong(rows.rename(columns={"problem": "stage"}), (*ID_COLUMNS, "status", "message"), ID_COLUMNS),
        ],
        figures=[
            _against(
                points,
                "loop",
                "Does the tracking error depend on the solver?",
                "RMS error of both axes over the last window against the exact cost gap of the weights in use. Lower "
                "is better; a level row of points means that the gap makes no difference. Dashed: a straight line "
                f"instead of a model. Gaps below {LEAST_GAP:g} are drawn at that value.",
                Axis("drawn", "cost gap of the weights in use", log=True, powers_of_ten=True),
            ),
            _against(
                points[points.learn_samples > 0.0].reset_index(drop=True),
                "loop_time",
                "Does it depend on the time to learn?",
                "The same errors against the time to learn.",
                Axis("learn_samples", "time to learn, samples", log=True),
            ),
        ],
    )


def _against(points: pd.DataFrame, name: str, title: str, definition: str, x: Axis) -> Figure:
    """Tracking error by stage against a column; a point is a learner, those with the least errors have colours and
    names."""
    view = "the " + points.problem + " stage"
    table = ranked(
        points.assign(view=view, drawn=np.maximum(points.cost_gap, LEAST_GAP)),
        points.rms_percent.where(~points.front, 0.0),
    )
    y = Axis("rms_percent", "RMS error, % of range", log=True)
    plots = [
        Plot(
            x,
            replace(y, title=f"{y.title}, {stage}"),
            _POINTS,
            ("name", "cost_gap", "rms_percent", "learn_samples"),
            where={"problem": [stage]},
            rules={"y": float(part.straight_rms_percent.median())},
            height=300,
        )
        for stage, part in table.groupby("problem", sort=False)
    ]
    return Figure(name, title, definition, table.drop(columns="view"), plots)


def ranking(table: pd.DataFrame) -> Table:
    """Errors of each learner on each stage, the paper's method first."""
    stages, rows = list(dict.fromkeys(table.problem)), []
    for label, lane in summary.learners(table):
        part = table[(table.label == label) & (table.lane == lane)].set_index("problem")
        cells = [(number(1e3 * line.rms_um), gap(line.cost_gap)) for _, line in part.reindex(stages).iterrows()]
        rows.append([label, lane, *(text for cell in cells for text in cell), _samples(worst(part.learn_samples))])
    headings = ("solver", "lane", *(f"{what} {stage}" for stage in stages for what in ("nm", "gap")), "samples")
    return Table(
        "Tracking error by solver",
        headings,
        rows,
        2,
        ("lane",),
        f"RMS error over the last window in nm; up to {summary.NOTICED:g} times the least on that stage is no "
        f"difference. Gap: (V − V*)/(V* + c) of the weights in use. Samples: time to learn. {OURS_NOTE}",
    )


def _by_window(rows: pd.DataFrame, table: pd.DataFrame) -> Table:
    """RMS errors of both axes together in each window, in the order of the summary."""
    windows = rows[rows.window >= 0].groupby([*summary.GROUP, "window"])
    errors = windows.rms_percent.agg(summary.root_mean_square).unstack()
    lines = [
        [line.problem, line.label, *(f"{value:.4f}" for value in errors.loc[tuple(line[summary.GROUP])])]
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
