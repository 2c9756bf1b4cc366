"""Permanent sensor feedback: learned compensation with integral action, compared with compensation and control alone.

Situations are random (`situations`), and a disturbance outside the model moves the output: creep of the mount, or a
vibration of 1 or 10 Hz. PI control alone is tuned for each situation: for each of RATIOS the gains
are raised until the sensitivity to disturbances, |1 / (1 + L)|, has the same peak as that of the integral action, with
the steepest slope of the actuator in L,

    L = g z^-delay z / (z − 1) of the integral action,   L = s_max (k_P + k_I z / (z − 1)) z^-delay of the PI control

with the delay of one sample plus that of the sensor; the ratio with the smallest error in the situation counts.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from hindsight import tracking_error
from outputs import arguments, show
from robustness import FIRST_SEED, SAMPLE_TIME, learner_of
from situations import CYCLE_S, Situation

from bench.report.report import PALETTE, Axis, Figure, Mark, Plot
from piezo_model import plants
from solvers.arrays import Vector

GAIN = 0.2
"""Integral gain per sample; the gain in 1/s is this over the sampling period."""
RATIOS = (0.0, 0.5, 2.0)
"""k_P / k_I of the PI control."""
CYCLES = 2
JUDGED_S, SETTLING_S = 4.0, 2.0
SHARE = 0.01
"""Amplitude of a disturbance, as a share of the reference's range."""
DISTURBANCES = {"creep of the mount": 0.0, "1 Hz": 1.0, "10 Hz": 10.0}
WAYS = {
    "compensation alone": PALETTE[1],
    "PI control alone": PALETTE[5],
    "compensation and integral action": PALETTE[0],
}
"""Compared controllers, with their colours."""


def peak(k_p: float, k_i: float, delay: int) -> float:
    """Peak of |1 / (1 + L)| for a slope of 1 and ``delay`` samples from the drive to the error."""
    z = np.exp(1j * np.linspace(1e-3, np.pi, 4000))
    return float(np.max(1.0 / np.abs(1.0 + (k_p + k_i * z / (z - 1.0)) * z**-delay)))


def pi_gains(ratio: float, delay: int, highest: float) -> tuple[float, float]:
    """k_P and k_I of a given ratio whose sensitivity has the peak ``highest``, by bisection."""
    low, high = 0.0, 2.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if peak(ratio * middle, middle, delay) < highest else (low, middle)
    return ratio * low, low


class Disturbed:
    """A sensor with a disturbance added to its output; each call continues with the next samples."""

    def __init__(self, sensor: plants.Plant, added: Vector) -> None:
        self.sensor, self.added, self.done = sensor, added, 0

    def run(self, x: Vector) -> Vector:
        """Outputs (N,) of drives (N,)."""
        self.done += x.size
        return self.sensor.run(x) + self.added[self.done - x.size : self.done]


def pi_alone(
    situation: Situation, actuator: Disturbed, y_ref: Vector, gains: tuple[float, float], slope: float
) -> Vector:
    """Outputs (N,) under PI control, whose integral stops at the limits of the drive."""
    (low, high), (k_p, k_i) = situation.x_limits, gains
    integral, error, y = low, 0.0, np.empty_like(y_ref)
    for k in range(y_ref.size):
        unlimited = integral + (k_p + k_i) * error / slope
        x = min(max(unlimited, low), high)
        if (unlimited - x) * error <= 0.0:  # no integration further beyond a limit
            integral += k_i * error / slope
        y[k] = actuator.run(np.array([x]))[0]
        error = y_ref[k] - y[k] if np.isfinite(y[k]) else error
    return y


def steepest(situation: Situation) -> float:
    """The steepest slope of the actuator over two full ramps, in output per input unit."""
    (low, high), actuator = situation.x_limits, plants.get(situation.plant, **situation.actuator_options)
    up = np.linspace(low, high, 51)
    return max(float(np.max(np.diff(actuator.run(x)) / np.diff(x))) for x in (up, up[::-1], up, up[::-1]))


def rows(seed: int) -> Iterator[dict[str, Any]]:
    """RMS errors over the last JUDGED_S, in % of the reference's range, of each controller under each disturbance."""
    situation = Situation.draw(seed, CYCLES * CYCLE_S, SAMPLE_TIME)
    y_ref, delay = situation.y_ref, 1 + int(situation.sensor_options.get("delay_samples", 0))
    t, span, slope = np.arange(y_ref.size) * SAMPLE_TIME, float(np.ptp(y_ref)), steepest(situation)
    tuned = [pi_gains(ratio, delay, peak(0.0, GAIN, delay)) for ratio in RATIOS]
    judged, settled = (
        slice(-round(JUDGED_S / SAMPLE_TIME), None),
        slice(-round((JUDGED_S + SETTLING_S) / SAMPLE_TIME), None),
    )
    for name, frequency in DISTURBANCES.items():
        added = SHARE * span * (np.sin(2.0 * np.pi * frequency * t) if frequency else np.log1p(10.0 * t))

        outputs = {}
        for way, gain in (("compensation alone", 0.0), ("compensation and integral action", GAIN)):
            learner = learner_of(situation, "continuous", integral_gain=gain / SAMPLE_TIME)
            outputs[way] = [learner.run(y_ref, Disturbed(situation.sensor(), added).run)[1]]
        outputs["PI control alone"] = [
            pi_alone(situation, Disturbed(situation.sensor(), added[settled]), y_ref[settled], gains, slope)
            for gains in tuned
        ]
        for way in WAYS:
            least = min(tracking_error(y[judged], y_ref[judged]) for y in outputs[way])
            yield {
                "seed": seed,
                "plant": situation.plant,
                "reference": situation.reference,
                "disturbance": name,
                "way": way,
                "rms_percent": 100.0 * least / span,
            }


def figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of every situation by disturbance."""
    drawn = table.assign(situation=table["seed"].astype(str))
    return Figure(
        "feedback",
        "A sensor that stays in the loop",
        "Learned compensation (continuous), PI control, and both, in situations drawn at random; the output "
        f"is moved by {SHARE:.0%} of "
        "the range besides. PI control and integral action have the same peak of sensitivity; the gain is "
        f"{GAIN:g} a sample.",
        drawn,
        [
            Plot(
                Axis("rms_percent", f"{name}: RMS error, % of the reference's range", log=True),
                Axis("situation", "seed"),
                (Mark("point", "way", size=70.0),),
                ("seed", "plant", "reference", "way", "rms_percent"),
                WAYS,
                where={"disturbance": [name]},
                height=28 * table["seed"].nunique() + 20,
            )
            for name in DISTURBANCES
        ],
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Compare the combination with each controller alone."""
    errors = table.pivot(index=["seed", "disturbance"], columns="way", values="rms_percent")
    both = errors["compensation and integral action"]
    for name, part in errors.groupby("disturbance", sort=False):
        alone = part.drop(columns=both.name)
        yield (
            f"Disturbance {name}: with integral action beside the compensation the error is "
            f"{both[part.index].median():.3f} % in the median; "
            + ", ".join(f"{alone[way].median():.3f} % with {way}" for way in alone)
            + "."
        )
    ratio = both / errors.drop(columns=both.name).min(axis=1)
    yield (
        f"Against the better of the two alone it is {ratio.median():.2f} times the error in the median and "
        f"{ratio.max():.2f} times in the "
        "worst case."
    )


def main() -> None:
    """Compare the controllers in a number of situations from a first seed on."""
    given = arguments(first=FIRST_SEED, situations=6)
    table = pd.DataFrame([row for seed in range(given.first, given.first + given.situations) for row in rows(seed)])
    show(figure(table), sentences(table), given.out)


if __name__ == "__main__":
    main()
