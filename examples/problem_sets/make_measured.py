"""Make the files of the problem set `measured` from the recordings listed in its README.md.

    python examples/problem_sets/make_measured.py dbo=dbo_identification.csv afm_scanner=afm_single.csv
    afm_head=fmt-tab-fd_version_0.13.3.tab

Each argument is the name of a file of the set and its recording. Lengths in metres become micrometres.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from bench.problems.measured import FOLDER
from bench.problems.protocol import Validation
from bench.problems.recorded import HELD_OUT_SHARE, excerpt, preprocessed, sensor_noise
from piezo_model import DataBasis, IdentificationProblem, Recording
from piezo_model.identification.creep import candidate_rates

ORDERS = (5, 3)
PROGRAMS = 7
WINDOWS = (0.5, 1.0)
"""Windows from the start of the counted part, as shares of it."""
UNSEEN = 1000
"""Number of samples after the fitted part that are stored for validation."""


def make(name: str, source: str | Path, folder: Path = FOLDER) -> None:
    """Write the file of one recording."""
    whole = in_micrometres(Recording.open(source))
    fitted = round((1.0 - HELD_OUT_SHARE) * whole.length)
    recording, unseen = excerpt(whole, slice(fitted)), excerpt(whole, slice(fitted, fitted + UNSEEN))
    found = preprocessed(recording, *ORDERS, candidate_rates(recording.sample_time, recording.duration_s))
    x, y = recording.x, recording.counted_y
    ends = {found.skip + round(share * (x.size - found.skip)) for share in WINDOWS}
    programs: list[list[IdentificationProblem]] = []
    for first in range(PROGRAMS):
        basis = DataBasis(found.fit.structure, found.fit.states[0])
        windows = []
        for k in range(x.size):
            basis.update(x[k : k + 1], y[k : k + 1], count=k >= found.skip and k % PROGRAMS == first)
            if k + 1 in ends:
                windows.append(basis.problem())
        programs.append(windows)
    write(
        folder / f"{name}.npz",
        programs,
        Validation(found.fit.structure, basis.state.copy(), unseen.x, unseen.counted_y, sensor_noise(whole.counted_y)),
    )


def write(path: Path, programs: Sequence[Sequence[IdentificationProblem]], unseen: Validation) -> None:
    """Write programs of one structure (phases × windows), and the data for validation, rounded to single precision.

    The upper triangle of each P is stored row by row.
    """
    meta = {
        "structure": unseen.structure.to_dict(),
        "noise_um": unseen.noise_um,
        "excitation": [[asdict(problem.excitation) for problem in windows] for windows in programs],
    }
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            meta=np.array(json.dumps(meta)),
            P=np.array([[problem.P[np.triu_indices_from(problem.P)] for problem in windows] for windows in programs]),
            q=np.array([[problem.q for problem in windows] for windows in programs]),
            c=np.array([[problem.c for problem in windows] for windows in programs]),
            play=unseen.state.play,
            creep=unseen.state.creep,
            x=unseen.x.astype(np.float32),
            y=unseen.y.astype(np.float32),
        )


def in_micrometres(recording: Recording) -> Recording:
    """The recording with signals below a millimetre, in metres, as micrometres."""
    if max(map(np.ptp, (recording.x, recording.y))) > 1e-3:
        return recording
    return Recording.from_arrays(
        1e6 * recording.x,
        1e6 * recording.counted_y,
        recording.sample_time,
        input_unit="um",
        output_unit="um",
        name=recording.name,
    )


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        name, _, source = argument.partition("=")
        make(name, source)
