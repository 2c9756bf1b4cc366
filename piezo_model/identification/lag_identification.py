"""The lag of the sensor, found as the one that leaves the smallest error (5) after a fit, and removed."""

from __future__ import annotations

import numpy as np

from piezo_model.data_basis import DataBasis
from piezo_model.identification.fit_report import Lag
from piezo_model.identification.fitting import IdentificationError, error_percent, optimum
from piezo_model.identification.sensor_lag import HALF_WIDTH, minimise_over_lag, shift_output
from piezo_model.identification.travel import moving_from
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure

LAG_SAMPLES = 100_000
"""Samples that the lag is estimated from: enough for it, and a second of work."""

LONGEST_LAG = 10
"""Samples of lag looked for."""


def estimate_lag(
    recording: Recording, s: ModelStructure, skip: int, solver: str, state: OperatorState, proximal: float, remove: bool
) -> Lag | None:
    """Return the delay of the output with the smallest error (5) left after the fit, over the same samples for all.

    None where the recording is too short for it, or the drive moves at its ends alone.
    """
    x, y = next(recording.chunks(moving_from(recording, skip) + LAG_SAMPLES))
    longest = min(LONGEST_LAG, (x.size - skip) // 20)
    start, stop = max(skip, HALF_WIDTH), x.size - HALF_WIDTH - longest  # the fraction's interpolation needs neighbours
    too_few = stop - start <= s.d
    if too_few or not np.ptp(x[start:stop]):
        if remove:
            why = (
                f"{x.size} samples are too few"
                if too_few
                else ("the drive moves too close to the ends of the recording")
            )
            raise IdentificationError(f"{recording.name}: {why} to look for a lag")
        return None
    settled = DataBasis(s, state)
    settled.update(x[:start], y[:start], count=False)

    def error(lag: float) -> float:
        values, kept = shift_output(y, lag)
        basis = DataBasis(s, settled.state)
        basis.update(x[start:stop], values[start - kept.start : stop - kept.start])
        problem = basis.problem(proximal=proximal)
        return error_percent(problem, optimum(problem, solver))

    found = minimise_over_lag(error, longest)
    return Lag(found.lag, remove and found.lag > 0.0, found.cost_without, found.cost, found.at_edge)


def without_lag(
    recording: Recording,
    s: ModelStructure,
    lag: float,
    skip: int,
    state: OperatorState,
) -> tuple[Recording, int, OperatorState]:
    """Return the recording without the lag, and what is left of ``skip`` and the states where it starts now."""
    x, y = recording.arrays()
    values, kept = shift_output(y, lag)
    start = DataBasis(s, state)
    start.update(x[: kept.start], y[: kept.start], count=False)
    return (
        Recording.from_arrays(
            x[kept],
            values,
            recording.sample_time,
            name=recording.name,
            input_unit=recording.input_unit,
            output_unit=recording.output_unit,
        ),
        max(skip - kept.start, 0),
        start.state,
    )
