"""Who keeps the schedule: late answers and response times at 8 kHz, beside those of the null solver.

Late answers come in bouts, since a delay of the machine makes one sample after the other late; so bouts (runs of late
samples) are compared with those of the null solver, the machine itself: their rates have a ratio with a 95 % interval.
A solver is late if the whole interval is above 1, or if it is late at most samples, which are one long bout. If the
machine itself misses too many deadlines, nothing is known.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.derived.measurements import MEASUREMENT, NULL_SOLVER, SCHEDULED, Measurements
from bench.messages.columns import Column, combined
from bench.report.words import marked, number, settings_label, solver_lanes
from bench.timing.percentiles import percentile, rate_ratio
from bench.timing.schedule import PERIOD_NS, PERIOD_US

GROUP = ["scaling", "solver", "lane", "setting"]
TOLERATED = 0.01
"""Largest share of deadlines missed by the machine itself in a run that can tell who keeps the schedule."""
FLOOR_LINE, KEPT, LATE, UNKNOWN = "floor", "kept", "late", "unknown"
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}
COLUMNS = (
    Column("solver", heading="solver", format=marked),
    Column("lane", heading="lane"),
    Column("settings", None, "first", "settings", settings_label),
    Column("schedule", heading="schedule"),
    *(Column(name, heading=f"{name}, µs", format=number) for name in QUANTILES),
    Column("longest", heading="longest, µs", format=number),
    Column("due", None, "sum", "samples"),
    Column("late", None, "sum", "late"),
    Column("bouts", None, "sum", "bouts"),
    Column("beside", heading="times the machine's"),
    Column("scaling", heading="scaling"),
)


def on_schedule(measurements: Measurements) -> pd.DataFrame:
    """COLUMNS and GROUP, one row per solver lane with its setting in one scaling, over all problems: the null solver
    first, then those that keep the schedule, by median response time."""
    rows, times = measurements.all_rows, measurements.raw_times
    rows = rows[(rows.timed == SCHEDULED) & (rows.host == measurements.host)]
    rows = rows[rows.scaling.isin(rows.scaling[rows.solver == NULL_SOLVER])].merge(
        times.loc[times.what == "response", [*MEASUREMENT, "ns"]], on=MEASUREMENT
    )
    table = combined(rows, COLUMNS, GROUP)
    floors = table[table.solver == NULL_SOLVER].set_index("scaling")
    figures = []
    for line, (_, calls) in zip(table.to_dict("records"), rows.groupby(GROUP), strict=True):
        us, floor = np.concatenate([*calls.ns]) / 1e3, floors.loc[line["scaling"]]
        low, high = rate_ratio(line["bouts"], line["due"], int(floor.bouts), int(floor.due))
        known = {name: percentile(us, q) for name, q in QUANTILES.items()}
        is_late, is_busy = low > 1.0 or np.median(us) > PERIOD_US, floor.late > TOLERATED * floor.due
        is_floor = line["solver"] == NULL_SOLVER
        figures.append(
            {
                **known,
                "longest": float(us.max()),
                "beside": "–" if is_floor else f"{number(low)} to {number(high)}",
                "schedule": FLOOR_LINE if is_floor else UNKNOWN if is_busy else LATE if is_late else KEPT,
            }
        )
    table = table.join(pd.DataFrame(figures, columns=[*QUANTILES, "longest", "beside", "schedule"]))
    order = table.schedule.map([FLOOR_LINE, KEPT, UNKNOWN, LATE].index)
    return table.assign(order=order).sort_values(["scaling", "order", "p50"], ignore_index=True).drop(columns="order")


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Which solver lanes keep the schedule, in the scaling with most of them, if the machine permits any."""
    for scaling, lines in table.groupby("scaling", sort=False):
        field, on_time = lines[lines.schedule != FLOOR_LINE], lines[lines.schedule == KEPT]
        floor = lines[lines.schedule == FLOOR_LINE].iloc[0]
        if (field.schedule == UNKNOWN).any():
            yield (
                f"On {scaling} data this run cannot say who keeps the schedule of {1e6 / PERIOD_NS:g} kHz: the machine "
                f"itself misses {100.0 * floor.late / floor.due:.2g} % of the deadlines; it was busy or is too slow."
            )
        elif len(field):
            best = f"; the fastest is {marked(on_time.solver.iloc[0])} ({on_time.lane.iloc[0]})" if len(on_time) else ""
            yield (
                f"On {scaling} data {solver_lanes(len(on_time), len(field), 'keep')} the schedule of "
                f"{1e6 / PERIOD_NS:g} kHz: their bouts of late answers are not shown to be more frequent than the "
                f"machine's own{best}."
            )


NOTE = (
    f"Sample k is due at t₀ + k · {PERIOD_US:g} µs, whatever happened before; a solver that is still busy then "
    "continues with the newest due sample. Response time: from the due time of a sample to the end of the first solve "
    f"that includes it. An answer is late above {PERIOD_US:g} µs, and a bout is a run of late answers. Floor: a solver "
    "that answers at once, the machine itself. A solver is late if the whole 95 % interval of the ratio of the rates "
    "of bouts is above 1, or if its median response is late. Every lane, the kernel's too, is called from Python for "
    "each sample."
)
