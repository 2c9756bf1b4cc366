"""The exported controller on a stage of one's own: however a run ends, the drive keeps its limits and comes to rest."""

import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from programs import program

from bench.export.c_source import export
from bench.export.folder import write_files
from bench.export.settings import ExportSettings
from piezo_model import HysteresisCreepModel, ModelStructure

LOW, HIGH, REST, RATE_LIMIT, RATE = 20.0, 100.0, 40.0, 2000.0, 1000
STAGE = f"""
#include "piezo_stage.h"

#include <math.h>
#include <stdio.h>

const piezo_stage_limits piezo_stage = {{{LOW}, {HIGH}, {RATE_LIMIT}, {REST}}};
static FILE *drives;
static int samples;

int piezo_stage_open(void)
{{
    drives = fopen("drives.txt", "w");
    return drives == NULL;
}}

int piezo_stage_exchange(double x, double *y)
{{
    fprintf(drives, "%.17g\\n", x);
    fflush(drives);
    ++samples;
    *y = samples % 7 ? 0.2 * x - 15.0 : NAN;
    return FAILS;
}}

void piezo_stage_close(void) {{ fclose(drives); }}
"""


@pytest.mark.needs("cc", "make")
@pytest.mark.parametrize("solver", [None, "projected_difference", "recursive_active_set"])
@pytest.mark.parametrize(("end", "status"), [("time", 0), ("SIGINT", 130), ("SIGTERM", 143), ("stage", 1)])
def test_however_a_run_ends_the_drive_keeps_limits_and_rate_and_comes_to_rest(
    tmp_path: Path, solver: str | None, end: str, status: int
) -> None:
    structure = ModelStructure.equidistant(
        n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0), creep_rates=(1.0,), sample_time=1.0 / RATE
    )
    model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
    settings = ExportSettings(part="learning", solver=solver) if solver else ExportSettings()
    write_files(tmp_path, export(model, settings))
    fails = "samples == 300" if end == "stage" else "0"
    (tmp_path / "piezo_stage.c").write_text(STAGE.replace("FAILS", fails))
    built = subprocess.run([program("make"), "loop"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert not built.stderr  # no warning
    seconds = "0.5" if end in ("time", "stage") else "60"
    run = subprocess.Popen(
        ["./loop", str(RATE), seconds, "0", "-1", "times"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    if end.startswith("SIG"):
        log = tmp_path / "drives.txt"
        while not (log.is_file() and log.stat().st_size > 2000):
            time.sleep(0.01)
        run.send_signal(signal.Signals[end])
    said = run.communicate(timeout=60)[1].decode()
    assert run.returncode == status, said
    assert ("the stage failed; its drive was brought to rest" in said) == (end == "stage")
    drives = np.loadtxt(tmp_path / "drives.txt")
    times = np.fromfile(tmp_path / "times", dtype=np.int64).reshape(-1, 2)
    assert drives.min() >= LOW
    assert drives.max() <= HIGH
    assert np.abs(np.diff(drives, prepend=REST)).max() <= RATE_LIMIT / RATE * (1 + 1e-12)
    assert drives[-1] == REST
    assert len(times) == {"time": 500, "stage": 300}.get(end, len(times))
    assert len(times) <= len(drives)
