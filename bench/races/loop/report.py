"""The report of a closed-loop race: whether the accuracy of the solver changes the tracking error."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from bench.derived.pictures import ranked
from bench.messages.columns import Column, combined, root_mean_square, worst
from bench.messages.task import PAPERS_SETTING
from bench.races.chosen_settings import definition, tier_label
from bench.races.kind import Kind
from bench.races.loop.race import LOOP, LoopRace, LoopSettings
from bench.report.report import GREY, LEAST_GAP, Axis, Figure, Mark, Plot, Report, Table, side_by_side, what_went_wrong
from bench.report.words import OURS_NOTE, format_distinct, gap, joined, marked, number, settings_label, whole
from bench.stage.setup import RANGE_UM
from bench.store import Run

NOTICED = 1.1
"""Smallest ratio to the least error that counts as a difference."""
EXACT = 1e-6
"""Largest cost gap of an exact solution."""
GROUP = ["problem", "solver", "lane", "tier", "settings"]
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


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per stage, solver and settings, by tracking error; failures are left out."""
    table = combined(rows[(rows.window >= 0) & (rows.window == rows.window.max())], LOOP.columns, GROUP)
    table["label"] = [
        f"{marked(line.solver)}, {settings_label(line.settings) or tier_label(line.tier, line.basis)}"
        for _, line in table.iterrows()
    ]
    return table.sort_values(["problem", "rms_percent"], ascending=[False, True], ignore_index=True)


def verdict(table: pd.DataFrame) -> list[str]:
    """The least tracking error, the accuracy that it needs, and the error of the paper's method."""
    stages = [(problem, part.reset_index(drop=True)) for problem, part in _learned(table)]
    if not stages:
        return ["No solver learned weights that the loop used."]
    near, far, paper = list[str](), list[str](), list[str]()
    for problem, part in stages:
        inside = part.rms_percent <= NOTICED * part.rms_percent.min()
        near.append(
            f"on the {problem} stage {inside.sum()} of {len(part)} learners are within "
            f"{100 * (NOTICED - 1):.0f} % of the least error, "
            f"{_nm(part.rms_um[0])} nm RMS, with cost gaps up to {gap(part[inside].cost_gap.max())} (a "
            f"straight line in place of a model leaves {_nm(part.straight_rms_percent[0] / 100.0 * RANGE_UM)} nm)"
        )
        if not inside.all():
            far.append(f"{gap(part[~inside].cost_gap.min())} on the {problem} stage")
        paper += [
            f"{_nm(line.rms_um)} nm on the {problem} stage, {number(line.rms_percent / part.rms_percent.min())} "
            f"times the least, at a cost gap of {gap(line.cost_gap)}"
            for _, line in part[part.settings == PAPERS_SETTING].iterrows()
        ]
    sentence = "; ".join(near)
    return [
        f"{sentence[0].upper()}{sentence[1:]}.",
        *([f"The paper's method with its 15 200 steps reaches {'; '.join(paper)}."] if paper else []),
        *([f"Learners farther away have cost gaps of at least {joined(far)}."] if far else []),
    ]


def _learned(table: pd.DataFrame) -> Iterator[tuple[object, pd.DataFrame]]:
    """Each stage with its learners whose weights were used."""
    return iter(table[table.cost_gap.notna()].groupby("problem", sort=False))


def notes(table: pd.DataFrame) -> Iterator[str]:
    """Errors and times to learn of the exact learners that were refused no more often than the best one."""
    for problem, learned in _learned(table):
        exact = learned[(learned.cost_gap <= EXACT) & (learned.refused <= learned.refused.head(1).max())]
        if len(exact) > 1:
            least, most = format_distinct(1e3 * exact.rms_um.min(), 1e3 * exact.rms_um.max())
            yield (
                f"On the {problem} stage the {len(exact)} learners with a cost gap of at most {EXACT:g} leave "
                + (f"{least} nm" if least == most else f"{least} to {most} nm")
                + f" and take {exact.learn_samples.min():.0f} to {exact.learn_samples.max():.0f} samples to learn."
            )


def _nm(um: float) -> str:
    return number(1e3 * um)


def report(run: Run, settings: LoopSettings) -> Report:
    """The report of a finished run."""
    rows = run.rows(LOOP)
    table = summary(rows)
    by_window = rows[rows.window >= 0].groupby([*GROUP, "window"]).rms_percent.agg(root_mean_square).unstack()
    points = table[table.cost_gap.notna()].assign(front=table.settings == PAPERS_SETTING)
    return Report(
        verdict(table),
        ranking(table),
        table,
        notes=list(notes(table)),
        definitions=(*DEFINITIONS, definition(settings.settings_run)),
        tables=[
            Table.of(
                "Every learner on each stage, last window",
                table,
                LOOP.columns,
                3,
                filters=("stage", "lane", "status"),
            ),
            Table.of(
                "RMS error in each window, % of range",
                table[[*GROUP, "label"]].join(by_window, on=GROUP),
                (
                    Column("problem", heading="stage"),
                    Column("label", heading="solver"),
                    *(
                        Column(window, heading=str(1 + int(window)), format="{:.4f}".format)
                        for window in by_window.columns
                    ),
                ),
                2,
            ),
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
                Axis("drawn", "cost gap of the weights in use", log=True, format=".0e"),
            ),
            _against(
                points[points.learn_samples > 0.0],
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
        points.assign(name=points.label, view=view, drawn=np.maximum(points.cost_gap, LEAST_GAP)),
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
    return Figure(name, title, definition, table.drop(columns=["view", "label"]), plots)


def ranking(table: pd.DataFrame) -> Table:
    """Errors of each learner on each stage: the paper's method, then the others by their largest ratio to a stage's
    least error."""
    ratio = table.rms_percent / table.groupby("problem").rms_percent.transform("min")
    learners = table.assign(ratio=ratio, paper=table.settings == PAPERS_SETTING).groupby(["label", "lane"])
    order = (
        learners.agg(paper=("paper", "any"), ratio=("ratio", "max"), samples=("learn_samples", worst))
        .sort_values(["paper", "ratio"], ascending=[False, True], kind="stable")
        .reset_index()
    )
    shown = (Column("rms_um", heading="nm {}", format=_nm), Column("cost_gap", heading="gap {}", format=gap))
    lines, wide = side_by_side(order, table, "problem", shown)
    return Table.of(
        "Tracking error by solver",
        lines,
        (
            Column("label", heading="solver"),
            Column("lane", heading="lane"),
            *wide,
            Column("samples", heading="samples", format=whole),
        ),
        2,
        filters=("lane",),
        note=f"RMS error over the last window in nm; up to {NOTICED:g} times the least on that stage is no "
        f"difference. Gap: (V − V*)/(V* + c) of the weights in use. Samples: time to learn. {OURS_NOTE}",
    )


KIND = Kind("loop", "Closed-loop race", "learning in the loop with a stage", LoopSettings, LoopRace, report)
