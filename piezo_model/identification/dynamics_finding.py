"""What a recording says of a resonance, in numbers and sentences."""

from collections.abc import Iterator
from dataclasses import dataclass

from piezo_model.identification.resonance import LIGHTLY_DAMPED
from piezo_model.units import quantity

NOTABLE, RINGING, PERIODS = 0.1, 0.5, 6.0
"""Fraction of the whitened squares from which a rejected mode is mentioned, and of its width by which a frequency
moves; RMS ringing of a further mode beyond which the recording is refused, % of the output's range; periods of a mode
for which steps are to be held."""


@dataclass(frozen=True)
class DynamicsFinding:
    """What a recording says of structural dynamics."""

    kept: bool
    frequencies_Hz: tuple[float, ...]
    damping: tuple[float, ...]
    delay_s: float
    amplifier_lag_s: float
    intervals: dict[str, list[list[float]]]
    """95 % intervals of frequencies, damping ratios and delay."""
    held_out_percent: tuple[float, float]
    """RMS errors on held-out blocks without and with the dynamics, % of the output's range."""
    reason: str
    """Why the dynamics were not kept; "" if they were."""
    gain: float
    """Fraction of the whitened squares that the mode explains in the scan."""
    moves_Hz: tuple[tuple[float, float], ...]
    """Lowest and highest frequency of each mode, which differ if it depends on amplitude or position."""
    also_rings: tuple[float, float]
    """Frequency in Hz of a further mode, and its RMS ringing in % of the output's range."""

    @property
    def refusal(self) -> str | None:
        """Why linear dynamics do not describe the stage; None if they do."""
        frequency, ringing = self.also_rings
        if ringing > RINGING:
            return (
                f"the output also rings near {frequency:.3g} Hz, by {ringing:.2g} % of the range (RMS), which the "
                "modes of the model do not describe; record with a smoother drive that does not excite this resonance"
            )
        for zeta, (low, high) in zip(self.damping, self.moves_Hz, strict=True):
            if moves_too_far(zeta, (low, high)):
                return (
                    f"the resonance moves from {low:.4g} to {high:.4g} Hz with the amplitude or the position, too far "
                    f"for a linear mode with a damping ratio of {100.0 * zeta:.2g} %; record at the amplitude and the "
                    "position of use"
                )
        return None

    def sentences(self) -> Iterator[str]:
        """What a user should know."""
        without, behind = self.held_out_percent
        if self.refusal is not None or not self.kept:
            is_evident = self.gain >= NOTABLE and behind <= without and max(self.damping) < LIGHTLY_DAMPED
            if self.refusal is None and is_evident:
                yield (
                    f"A faint resonance near {quantity(self.frequencies_Hz[0], 'Hz', 3)} with a damping ratio of "
                    f"{100.0 * self.damping[0]:.2g} % is not in the model, since {self.reason}; record steps of "
                    f"{quantity(PERIODS / self.frequencies_Hz[0], 's', 1)} to determine it."
                )
            return
        for f, zeta, (low, high), moves in zip(
            self.frequencies_Hz, self.damping, self.intervals["frequencies_Hz"], self.moves_Hz, strict=True
        ):
            between = f" ({low:.5g} to {high:.5g} Hz)" * (f"{low:.5g}" != f"{high:.5g}")
            amplifies = f", which amplifies errors of the static part near it by up to {0.5 / zeta:.2g} times"
            moving = f" It moves from {moves[0]:.5g} to {moves[1]:.5g} Hz with the amplitude or the position."
            yield (
                f"The stage has a resonance at {quantity(f, 'Hz', 5)}{between} with a damping ratio of "
                f"{100.0 * zeta:.3g} %{amplifies * (zeta < LIGHTLY_DAMPED)}."
                f"{moving * (moves[1] - moves[0] > NOTABLE * zeta * moves[0])}"
            )
        if self.also_rings[1] > 0.0:
            yield f"The output also rings near {self.also_rings[0]:.3g} Hz, which is not in the model."
        lag = f", and the amplifier lags by {quantity(self.amplifier_lag_s, 's', 3)}" * (self.amplifier_lag_s > 0.0)
        ends = " to ".join(quantity(end, "s", 3) for end in self.intervals["delay_s"][0])
        yield (
            f"The output is delayed by {quantity(self.delay_s, 's', 3)} ({ends}) from the end of the sampling "
            f"interval{lag}; "
            f"the RMS error of a first fit on held-out data is {behind:.3g} % of the range with the dynamics and "
            f"{without:.3g} % without."
        )


def moves_too_far(zeta: float, ends: tuple[float, float]) -> bool:
    """True if a frequency moves by more than a linear mode of this damping ratio is wide."""
    return ends[1] - ends[0] > zeta * ends[0]
