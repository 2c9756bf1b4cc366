"""The report of a race."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import pandas as pd

from bench.derived import ranking, schedule, summary, verdict
from bench.derived.measurements import NULL_SOLVER, Measurements
from bench.derived.tiers import distance, failed, measured
from bench.messages.columns import Column
from bench.problem_files.miss import Miss
from bench.race_table import COLUMNS
from bench.races.figures import figures
from bench.races.settings import RaceSettings
from bench.report.report import Report, Table
from bench.report.words import OURS_NOTE, gap, joined, marked, number, settings_label
from bench.store import Run, RunError
from solvers.registry import file_digest

MISSES = (
    Column("solver", heading="solver", format=marked),
    Column("lane", heading="lane"),
    Column("name", heading="problem"),
    Column("settings", heading="settings", format=settings_label),
    Column("status", heading="status"),
    *(Column(name, heading=name.replace("_", " "), format=gap) for name in ("cost_gap", "timed_gap", "violation")),
    Column("setup_us", heading="setup, µs", format=number),
    Column("answer_us", heading="µs", format=number),
    Column("message", heading="message"),
)
PROBLEMS = (
    Column("problem_set", heading="problem set"),
    Column("problem", heading="problem"),
    Column("d", heading="unknowns"),
    Column("objective", heading="optimum", format=repr),
    Column("scaling", heading="scaling"),
    Column("V", heading="V*", format=number),
    Column("yardstick", heading="yardstick", format=number),
    Column("optimum", heading="|V*| / cost scale", format=number),
)
SIMD = (
    "Part of our lead is SIMD, since our C is compiled for the processor at hand and the wheels of the others for any. "
    "Measured once, on ten of the programs with 18 unknowns and an AMD EPYC, box_active_set† takes 0.34 times as "
    "long as daqp, both compiled, with AVX-512 (x86-64-v4), 0.38 times with AVX2 (v3) and 0.66 times with SSE4.2 (v2); "
    "daqp built for that processor is not faster than its wheel."
)
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
    "settings: one for all problems, the loosest that meets the tier with a margin of 10 on every one, else of 3, else "
    "of 1; those of the first problem are shown, since tolerances are multiples of a constant of each. A tier "
    "that no setting reaches on every problem is not reached.",
    "leave-one-out: the setting is chosen on the problems that it is judged on. This is the share of them on which the "
    "setting that the others choose is right; – where there are fewer than three problems.",
    "right: on how many problems the first answer and all judged timed ones are as exact as the tier asks. judged: the "
    "fewest timed answers to a problem that were judged. misses, at most: the rate of misses on any problem that they "
    "leave open (95 %); 3 % after 100 answers without a miss.",
    "scaled: P has a unit diagonal; raw: volts and micrometres.",
    "|V*| / cost scale: how much larger the optimal cost V* is than what a gap is divided by. A tolerance relative "
    "to V* is that much looser.",
    "worst gap: the largest cost gap or violation on any problem, of first and judged timed answers.",
    "primal and dual residual: as qpsolvers.Solution defines them, from the solver's own duals, on the worst problem. "
    "Weight error: ‖w − w*‖∞ / ‖w*‖∞. Model error: RMS error on unseen data, per cent of the range, median.",
    "Times are medians over the problems; every solve follows an update with new q, and with new P unless a program "
    "has but one. They are hot, from repeated calls of one solver; interleaved with others, it finds the caches that "
    "those left. A controller with other work in its period lies between the two.",
    "p99 of an answer: of update and solve together, over all hot calls on all problems; – for fewer than 299 calls.",
    "periods: update and solve in sampling periods of the problem's data, or the steps of a method that takes one step "
    "a period.",
    "warm: started from the optimum of the problem before, where problems follow each other; cold: from scratch.",
    "floor: a solver that does nothing: the cost of clock, call and machine.",
    "drift: a reference workload is timed every few seconds; this is how far the median of any fifth of these times is "
    "from the median of all, at most. Moments in which a neighbour slows the core hardly change medians over problems, "
    "and are reported separately.",
    OURS_NOTE,
)


def report(run: Run, race: RaceSettings) -> Report:
    """The report of a finished run."""
    measurements, settings = Measurements.of(run), run.settings
    lines, table, costs = summary.summary(measurements), ranking.ranking(measurements), optima(run, measurements.rows)
    drifted = settings.get("conditions", {}).get("sentinel_drift", 0.0)
    shown = lines.merge(costs.groupby(["problem_set", "scaling"]).optimum.agg(_span).reset_index(), how="left")
    right = shown.right.astype(str) + "/" + shown.problems.astype(str)
    misses = dict(summary.worst_misses(run, measurements, race.keep_misses))
    at_8_khz = schedule.on_schedule(measurements)
    beside, missed = ranking.like_with_like(measurements), summary.misses(measurements)
    versions, every = settings.get("lanes", {}), measured(measurements.all_rows)
    return Report(
        verdict.verdict(measurements, run.machine_of(measurements.rows)["core"], drifted),
        ranking.short_table(table),
        lines,
        figures(measurements),
        terminal=ranking.short_table(table, measurements.own),
        scope=f"{measurements.problems} problem{'s' if measurements.problems != 1 else ''}",
        notes=[
            *verdict.warm_starts(lines),
            *verdict.cold_caches(measurements),
            *schedule.sentences(at_8_khz),
            *remarks(run, measurements, misses),
        ],
        files={f"misses/{name}": miss.save for name, miss in misses.items()},
        # of the scaled rows, if there are any
        failed=failed(every[every.scaling == every.scaling.max()].assign(error=distance), measurements.own),
        definitions=[
            *DEFINITIONS,
            *(
                [
                    f"Every solver ran in {race.repeats} fresh processes: times are medians over these, and "
                    "answer_us_spread in summary.csv is their range over the median."
                ]
                if race.repeats > 1
                else []
            ),
        ],
        tables=[
            Table.of(
                "Every solver at every tier",
                shown.assign(right=right.mask(shown.status == summary.NOTHING, "–")),
                COLUMNS,
                3,
                filters=("problem set", "scaling", "lane", "tier", "start", "status"),
                file="summary.csv",
            ),
            Table.of(
                "Misses of 1e-9",
                missed.assign(name=missed.problem_set + "/" + missed.problem),
                MISSES,
                5,
                filters=("lane", "problem", "status"),
                note="Problems on which a solver is not within 1e-9, at its setting for 1e-9 or the one that is right "
                "on most of them; solvers that are right on none are omitted, except yours. Timed gap: the largest "
                "gap or violation among the timed answers that were judged.",
            ),
            Table.of(
                "Our solver against each other solver",
                beside.assign(version=[versions.get(name, "") for name in beside.other + " (" + beside.lane + ")"]),
                ranking.BESIDE,
                2,
                filters=("lane", "timed", "unknowns"),
                note="Median µs of update and solve to 1e-9 on the problems that both reach it on, by lane and number "
                "of unknowns, the fastest of the others first; a ratio below 1 is in our favour. –: there is "
                f"no such problem. {SIMD}",
            ),
            *(
                [Table.of("On the schedule of 8 kHz", at_8_khz, schedule.COLUMNS, 3, note=schedule.NOTE)]
                if len(at_8_khz)
                else []
            ),
            Table.of(
                "Wrapper overhead",
                ranking.wrapper_share(measurements),
                ranking.WRAPPERS,
                3,
                filters=("lane",),
                note="Median µs of update and solve through a package, over that of the same library in the lane "
                "direct at identical settings, on the problems where both are right to 1e-3.",
            ),
            Table.of(
                "Problems",
                costs,
                PROBLEMS,
                2,
                filters=("problem set", "scaling"),
                note="Optimum: of the objective as its source states it, constant and sense included, in volts squared "
                "for a recording. V*: without the constant, in each scaling.",
            ),
            Table.of(
                "What went wrong",
                summary.failures(every[every.solver != NULL_SOLVER]),
                summary.WRONG,
                8,
                filters=("lane", "scaling", "status"),
            ),
        ],
    )


def remarks(run: Run, measurements: Measurements, misses: Mapping[str, Miss]) -> Iterator[str]:
    """Sentences on solvers that do not repeat their answers and models of recordings, and the lines of
    Python that solve the program of the first miss again."""
    rows = measurements.lanes[~measurements.lanes.repeatable]
    if names := sorted({f"{marked(solver)} ({lane})" for solver, lane in zip(rows.solver, rows.lane, strict=True)}):
        yield f"The same data give other bits when they are solved again with {joined(names)}."
    for note in run.settings.get("models", {}).values():
        if "error_percent" in note:
            yield (
                "The model that identify makes of the first four fifths of the recording has an RMS error of "
                f"{note['error_percent']:.3g} % of the range on held-out data, the last fifth; deploy uses the model "
                f"of the whole recording. {note.get('creep', '')}".rstrip()
            )
        else:
            yield f"There is no model of the recording for deploy, since identify refused it: {note.get('refused', '')}"
    for name, miss in [*misses.items()][:1]:
        version = run.settings.get("lanes", {}).get(f"{miss.solver} ({miss.lane})", "")
        own = "".join(  # a user's own file, unless it has changed since: the version has its digest
            f"import solvers; solvers.add_file({path!r}); "
            for path in run.settings["settings"].get("solver_files", ())
            if Path(path).is_file() and file_digest(Path(path)) in version
        )
        yield (
            f"{len(misses)} missed answer{'s are' if len(misses) > 1 else ' is'} kept in {run.path / 'misses'}, each "
            f"with its program and the proven optimum. To solve the first again: {own}from bench.problem_files.miss "
            f"import Miss; miss = Miss.load({str(run.path / 'misses' / name)!r}); print(miss.gap(miss.x), "
            "miss.gap(miss.solve()))"
        )


def optima(run: Run, rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each problem and scaling: optimal cost ``V``, ``yardstick``, their ratio ``optimum``, and the optimal
    ``objective`` of its source; NaN if the problem's file is missing."""
    problems = rows.drop_duplicates(["problem_set", "problem", "scaling"])[["problem_set", "problem", "d", "scaling"]]
    lines = []
    for line in problems.to_dict("records"):
        line |= dict.fromkeys(("V", "yardstick", "optimum", "objective"), math.nan)
        with suppress(RunError):
            problem = run.problem(line["problem_set"], line["problem"])
            form = problem.forms[line["scaling"]]
            line |= {
                "V": form.certificate.value_rounded,
                "yardstick": form.yardstick,
                "optimum": abs(form.certificate.value_rounded) / form.yardstick,
                "objective": problem.optimum,
            }
        lines.append(line)
    return pd.DataFrame(lines)


def _span(values: pd.Series) -> str:
    low, high = number(float(values.min())), number(float(values.max()))
    return low if low == high else f"{low} to {high}"
