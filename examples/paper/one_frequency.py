"""What a recording of one frequency does not tell: a stage that has been scanning is recorded, and then holds a step.

Two models of the same simulated stage: one from twenty seconds of a triangle, after a hundred seconds of the same, and
one from a drive of ``piezobench excite``. Both fit their recordings; a step held for a minute shows the creep.
"""

import numpy as np
import pandas as pd
from outputs import arguments, show
from references import raster_scan

from bench.report.report import INK, PALETTE, Axis, Figure, Mark, Plot
from piezo_model import Recording, identify, plants
from piezo_model.signals import excitation
from solvers.arrays import Vector

SAMPLE_TIME = 1e-3
LOW, HIGH, STEP = 0.0, 150.0, 120.0
HELD_S = 60.0
EVERY = 200
"""Samples between two points of the picture."""


def main() -> None:
    """Identify both models, and draw the step of the stage and of each."""
    given = arguments(plant="maxwell_slip")
    stage = plants.get(given.plant, sample_time=SAMPLE_TIME)
    rng = np.random.default_rng(0)

    def measured(drive: Vector) -> Vector:
        stage.reset()
        return stage.run(drive)

    scan = raster_scan(duration_s=120.0, sample_time=SAMPLE_TIME, low=LOW, high=HIGH, line_rate_Hz=1.0, fast_share=1.0)
    excited = excitation(duration_s=60.0, sample_time=SAMPLE_TIME, low=LOW, high=HIGH)
    kept = scan.size // 6
    recordings = {
        "from a triangle": (scan[-kept:], measured(scan)[-kept:]),
        "from excite": (excited, measured(excited)),
    }
    step = np.concatenate([np.linspace(LOW, STEP, 1000), np.full(round(HELD_S / SAMPLE_TIME), STEP)])
    truth = measured(step)
    after = np.arange(step.size)[1000::EVERY]
    lines = {"the stage": truth}
    sentences, span = [], float(np.ptp(recordings["from excite"][1]))
    for name, (x, y) in recordings.items():
        model = identify(Recording.from_arrays(x, y + rng.normal(0.0, 5e-4 * span, y.size), sample_time=SAMPLE_TIME))
        lines[f"model {name}"] = model.simulate(step)
        missed = 100.0 * abs(np.ptp(lines[f"model {name}"][1000:]) - np.ptp(truth[1000:])) / span
        sentences.append(
            f"The model {name} fits its recording to {model.report['fit']['rms_percent']:.2f} % of the range; of the "
            f"creep after a step it misses {missed:.1f} % in {HELD_S:g} s."
        )
    table = pd.concat(
        [
            pd.DataFrame(
                {"name": name, "time": (after - 1000) * SAMPLE_TIME, "moved": 100 * (y[after] - y[1000]) / span}
            )
            for name, y in lines.items()
        ],
        ignore_index=True,
    )
    plot = Plot(
        Axis("time", "time since the step, s"),
        Axis("moved", "creep, % of range"),
        (Mark("line", "name", along="time", size=2.0),),
        ("name",),
        colours=dict(zip(lines, (INK, PALETTE[1], PALETTE[0]), strict=True)),
    )
    note = "A step held for a minute, after two recordings of the same stage that both models fit."
    show(Figure("one_frequency", "What one frequency does not tell", note, table, [plot]), sentences, given.out)


if __name__ == "__main__":
    main()
