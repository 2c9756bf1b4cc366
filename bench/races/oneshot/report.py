"""The report of a one-shot race."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import pandas as pd

from bench.derived import anytime, pictures
from bench.derived import summary as summaries
from bench.derived.like_with_like import like_with_like
from bench.derived.measurements import Measurements
from bench.derived.misses import kept, misses
from bench.derived.ranking import ranking, short_table, yardstick
from bench.derived.verdict import below_rounding, notes, verdict
from bench.derived.wrapper_share import wrapper_share
from bench.races.oneshot.figures import figures
from bench.races.oneshot.sessions import drift as drift_of
from bench.races.oneshot.settings import OneshotSettings
from bench.races.settings import settings_of
from bench.report.report import Report, Table
from bench.report.words import OURS_NOTE, gap, joined, marked, number, settings_label
from bench.store import Run, RunError

HEADINGS = {
    "solver": "solver",
    "lane": "lane",
    "tier": "tier",
    "right": "right",
    "worst_cost_gap": "worst cost gap",
    "update_us": "update, µs",
    "solve_us_p50": "solve, µs",
    "answer_us_p99": "p99 of an answer, µs",
    "periods": "periods",
    "status": "status",
    "problem_set": "problem set",
    "scaling": "scaling",
    "start": "start",
    "left_out": "leave-one-out",
    "settings": "settings",
    "optimum": "|V*| / cost scale",
    "worst_primal_residual": "primal residual",
    "worst_dual_residual": "dual residual",
    "worst_weight_error": "weight error",
    "model_error_percent": "model error, %",
    "setup_us": "setup, µs",
    "solve_us_max": "longest solve, µs",
    "interleaved_us": "interleaved, µs",
}
"""Solver, accuracy and times come first, since a screen may cut off the others."""
WRONG = ("solver", "lane", "scaling", "status", "times", "settings", "such as", "message")
BESIDE = ("lane", "timed", "unknowns", "problems", "ours", "µs", "other", "version", "other, µs", "ratio")
MISSES = ("solver", "lane", "problem", "settings", "status", "cost gap", "timed gap", "violation", "µs")
WRAPPERS = ("solver", "lane", "settings", "problems", "µs", "direct, µs", "ratio")
DEFINITIONS = (
    "lane: how the solver is called. kernel: compiled, without Python; direct: the library's own object; qpsolvers "
    "and cvxpy: through these packages, which convert and set up at every call, and that is part of the price. "
    "Compare solvers in one lane.",
    "tier: what an answer must reach, the same for all: a cost gap of 1e-3 (low), 1e-6 (mid), 1e-9 (high) or 1e-12 "
    "(exact), in exact arithmetic, and constraints violated by no more than that, relative to the largest number of "
    "the optimum. stage: a model that errs on unseen data by at most 1 % of the sensor's noise more than the "
    "optimum's. 1e-9 is numerics, stage is engineering.",
    "default: the library's own settings, judged like low. In the lanes qpsolvers and cvxpy these are the defaults "
    "of that package, which are not always the library's: cvxpy asks OSQP for 1e-5.",
    "settings: one for all problems, the loosest that meets the tier ten times over on every one, else three times, "
    "else once; those of the first problem are shown, since tolerances are multiples of a constant of each. A tier "
    "that no setting reaches on every problem is not reached.",
    "leave-one-out: the setting is chosen on the problems that it is judged on. This is the share of them on which the "
    "setting that the others choose is right; – where there are fewer than three problems.",
    "right: on how many problems the answer is as exact as the tier asks.",
    "scaled: P has a unit diagonal; raw: volts and micrometres.",
    "|V*| / cost scale: how much larger the optimal cost V* is than what a gap is divided by. A tolerance relative "
    "to V* is that much looser.",
    "primal and dual residual: as qpsolvers.Solution defines them, from the solver's own duals, on the worst problem. "
    "Weight error: ‖w − w*‖∞ / ‖w*‖∞. Model error: RMS error on unseen data, per cent of the range, median.",
    "Times are medians over the problems; every solve follows an update with new P and q. They are hot, the same "
    "solver again and again; interleaved, it finds the caches that other solvers left. A controller with other work in "
    "its period lies between the two.",
    "p99 of an answer: of update and solve together, over all hot calls on all problems; – where there are fewer than "
    "the 299 it takes.",
    "periods: update and solve in sampling periods of the problem's data, or the steps of a method that takes one step "
    "a period.",
    "warm: started from the optimum of the problem before, where problems follow each other; cold: from nothing.",
    "floor: a solver that does nothing, which is what clock, call and machine cost.",
    "drift: a fixed piece of work is timed every few seconds; this is how far the median of any fifth of these times "
    "is from that of all, at most. Moments in which a neighbour slows the core leave medians over problems alone as "
    "long as they are few, and are counted apart.",
    OURS_NOTE,
)


def report(run: Run) -> Report:
    """The report of a finished run."""
    measurements, settings = Measurements.of(run), run.settings
    summary, table, costs = summaries.summary(measurements), ranking(measurements), optima(run, measurements.rows)
    drift = settings.get("conditions", {}).get("sentinel_drift", 0.0)
    note = yardstick(foreign=bool((costs.c == 0.0).any()), own=not (costs.c == 0.0).all())
    shown = summary.merge(costs.groupby(["problem_set", "scaling"]).optimum.agg(_span).reset_index(), how="left")
    files = {
        f"misses/{name}": miss.save
        for name, miss in kept(run, measurements, settings_of(run, OneshotSettings).keep_misses)
    }
    wrong = [[marked(solver), *others] for solver, *others in summaries.failures(measurements)]
    return Report(
        verdict(measurements, settings["machine"]["core"], drift),
        short_table(table, note),
        summary,
        figures(measurements, summary),
        terminal=short_table(table, note, terminal=True),
        scope=f"{measurements.problems} problem{'s' if measurements.problems != 1 else ''}",
        notes=[
            *below_rounding(costs),
            *notes(measurements, summary),
            *_unrepeatable(measurements),
            *drift_of(run, measurements),
            *_hosts(measurements),
            *_models(run),
            *_reproduction(run, files),
        ],
        files=files,
        definitions=[*DEFINITIONS, *_of_repeats(run)],
        tables=[
            Table(
                "Every solver at every tier",
                [*HEADINGS.values()],
                [[text(row, key) for key in HEADINGS] for _, row in shown.iterrows()],
                3,
                ("problem set", "scaling", "lane", "tier", "start", "status"),
                file="summary.csv",
            ),
            Table(
                "Misses of 1e-9",
                MISSES,
                _missed(measurements),
                5,
                ("lane", "problem", "status"),
                "Problems on which a solver is not within 1e-9, at its setting for 1e-9 or the one that is right on "
                "most of them; solvers that are right on none are left out. Timed gap: the largest gap or violation "
                "among the timed answers that were judged.",
            ),
            Table(
                "Our solver against each other solver",
                BESIDE,
                _beside(measurements, settings.get("field", {})),
                2,
                ("lane", "timed", "unknowns"),
                "Median µs of update and solve to 1e-9, by lane and number of unknowns, the fastest of the others "
                "first; a ratio below 1 is in our favour.",
            ),
            Table(
                "Time by size",
                *_sizes(pictures.time_by_size(measurements)),
                2,
                (),
                "Median µs of update and solve by number of unknowns, where every answer of that size was right to "
                "1e-9: our exact solvers, and the five fastest others each in its fastest lane.",
            ),
            Table(
                "Wrapper overhead",
                WRAPPERS,
                _wrappers(measurements),
                3,
                ("lane",),
                "Median µs of update and solve through a package, over that of the same library in the lane direct at "
                "identical settings, on the problems where both are right to 1e-3.",
            ),
            Table(
                "Problems",
                ("problem set", "problem", "unknowns", "optimum", "scaling", "V*", "yardstick", "|V*| / cost scale"),
                [
                    [
                        row.problem_set,
                        row.problem,
                        str(row.d),
                        repr(float(row.objective)),
                        row.scaling,
                        *(number(value) for value in (row.V, row.yardstick, row.optimum)),
                    ]
                    for _, row in costs.iterrows()
                ],
                2,
                ("problem set", "scaling"),
                "Optimum: of the objective as its source states it, constant and sense included, in volts squared for "
                "a recording. V*: without the constant, in each scaling.",
            ),
            Table("What went wrong", WRONG, wrong, 8, ("lane", "scaling", "status")),
        ],
    )


def anytime_report(run: Run) -> Report:
    """The same report, beginning with the accuracy within sampling periods."""
    whole, gaps = report(run), anytime.anytime(Measurements.of(run))
    *others, first = whole.figures
    return replace(
        whole,
        verdict=[*anytime.sentences(gaps), *whole.verdict],
        table=anytime.accuracy_table(gaps),
        terminal=None,
        figures=[first, *others],
        tables=[*([whole.table] if whole.table else []), *whole.tables],
    )


def _unrepeatable(measurements: Measurements) -> list[str]:
    rows = measurements.field[~measurements.field.repeatable]
    names = sorted({f"{marked(solver)} ({lane})" for solver, lane in zip(rows.solver, rows.lane, strict=True)})
    return [f"The same data do not give the same bits again with {joined(names)}."] if names else []


def _reproduction(run: Run, files: Iterable[str]) -> list[str]:
    """The lines of Python that solve a missed program again; the user's own solver files are registered first."""
    own = run.settings_in_force.get("solver_files", ())
    register = "".join(["import solvers; ", *(f"solvers.add_file({path!r}); " for path in own)]) if own else ""
    return [
        f"{len([*files])} missed answers are kept in {run.path / 'misses'}, each with its program and the proven "
        "optimum. To solve the first again: "
        f"{register}from bench.problem_files.miss import Miss; miss = Miss.load({str(run.path / file)!r}); "
        "print(miss.gap(miss.x), miss.gap(miss.solve()))"
        for file in [*files][:1]
    ]


def _hosts(measurements: Measurements) -> list[str]:
    others = sorted(set(measurements.every.host) - {measurements.host})
    if not others:
        return []
    return [
        f"Times are those of {measurements.host}, where most was measured; accuracy is judged by what "
        f"{', '.join(others)} measured, too."
    ]


def _models(run: Run) -> list[str]:
    """Sentences about the models of recordings: their errors, or the reasons for their absence."""
    return [
        f"The model that identify makes of the first four fifths of the recording errs by {note['error_percent']:.3g} "
        "% of the range (RMS) on the last fifth; deploy takes the one that it makes of the whole recording. "
        f"{note.get('creep', '')}".rstrip()
        if "error_percent" in note
        else f"There is no model of the recording for deploy, since identify refused it: {note.get('refused', '')}"
        for note in run.settings.get("models", {}).values()
    ]


def _beside(measurements: Measurements, versions: Mapping[str, str]) -> list[list[str]]:
    return [
        [
            row["lane"],
            row["timed"],
            str(row["d"]),
            str(row["problems"]),
            row["ours"],
            number(row["ours_us"]),
            row["other"],
            versions.get(f"{row['other']} ({row['lane']})", ""),
            number(row["other_us"]),
            f"{row['ratio']:.2f}" if row["ratio"] >= 0.1 else f"{row['ratio']:.1g}",
        ]
        for row in like_with_like(measurements).to_dict("records")
    ]


def _missed(measurements: Measurements) -> list[list[str]]:
    return [
        [
            marked(row["solver"]),
            row["lane"],
            f"{row['problem_set']}/{row['problem']}",
            settings_label(row["settings"]),
            row["status"],
            *(gap(row[name]) for name in ("cost_gap", "timed_gap", "violation")),
            number(row["answer_us"]),
        ]
        for row in misses(measurements).to_dict("records")
    ]


def _wrappers(measurements: Measurements) -> list[list[str]]:
    return [
        [
            row["solver"],
            row["lane"],
            settings_label(row["settings"]),
            str(row["problems"]),
            *(number(row[name]) for name in ("us", "direct_us", "ratio")),
        ]
        for row in wrapper_share(measurements).to_dict("records")
    ]


def optima(run: Run, rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each problem and scaling: optimal cost ``V``, ``yardstick``, their ratio ``optimum``, and constant
    ``c``, 0 for a program from a file; NaN if the problem's file is missing."""
    problems = rows.drop_duplicates(["problem_set", "problem", "scaling"])[["problem_set", "problem", "d", "scaling"]]
    lines = []
    for line in problems.to_dict("records"):
        try:
            problem = run.problem(line["problem_set"], line["problem"])
            form = problem.forms[line["scaling"]]
        except RunError:
            lines.append(line | dict.fromkeys(("V", "yardstick", "optimum", "c", "objective"), math.nan))
            continue
        value = form.certificate.value_rounded
        lines.append(
            {
                **line,
                "V": value,
                "yardstick": form.yardstick,
                "optimum": abs(value) / form.yardstick,
                "objective": problem.optimum,
                "c": 0.0 if form.cost_unit else form.c,
            }
        )
    return pd.DataFrame(lines)


def text(row: pd.Series, column: str) -> str:
    """One cell of the large table."""
    value = row[column]
    if column == "right":
        return "–" if row.status == summaries.FLOOR else f"{row.right}/{row.problems}"
    if column in ("settings", "solver"):
        return settings_label(str(value)) if column == "settings" else marked(str(value))
    if column == "left_out":
        return "–" if pd.isna(value) else f"{100.0 * value:.0f} %"
    if isinstance(value, float):
        return (
            "–"
            if pd.isna(value)
            else f"{value:.1e}"
            if "gap" in column or "residual" in column or "weight" in column
            else f"{value:.3g}"
        )
    return str(value)


def _of_repeats(run: Run) -> list[str]:
    count = run.settings["settings"].get("repeats", 1)
    return (
        [
            f"Every solver ran in {count} fresh processes: times are medians over these, and answer_us_spread in "
            "summary.csv is their range over the median."
        ]
        if count > 1
        else []
    )


def _span(values: pd.Series) -> str:
    low, high = number(float(values.min())), number(float(values.max()))
    return low if low == high else f"{low} to {high}"


def _sizes(table: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of times by size."""
    lines = table.to_dict("split")["data"] if "time_us" not in table else []
    return ["problems", "solver", *map(str, table.columns[2:])], [[*line[:2], *map(number, line[2:])] for line in lines]
