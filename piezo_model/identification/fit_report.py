"""What an identification found out, in figures and in sentences.

Errors are those of the forward model over the counted part of the data, as a share of the range of the output there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from piezo_model.identification_problem import ExcitationReport
from piezo_model.structure import ModelStructure


@dataclass(frozen=True)
class Fit:
    """Error of the forward model.

    Attributes
    ----------
    samples : int
        Samples counted.
    skipped : int
        Samples before them, whose operator states were not known yet.
    rms_percent, max_percent : float
        Error over the counted part, per cent of the output's range there.
    rms, max : float
        The same in the output's unit.
    skipped_max_percent : float
        Largest error over the skipped part.
    """

    samples: int
    skipped: int
    rms_percent: float
    max_percent: float
    rms: float
    max: float
    skipped_max_percent: float


@dataclass(frozen=True)
class Lag:
    """Delay of the sensor that explains the data best, in samples, and the error (5) without and with its removal."""

    samples: float
    removed: bool
    error_percent: float
    error_without_lag_percent: float
    at_edge: bool
    """The largest lag looked at explains the data best: it may be larger."""

    @property
    def pays(self) -> bool:
        """Whether removing the lag lowers the error by more than two per cent of itself."""
        return abs(self.samples) > 0.1 and self.error_without_lag_percent < 0.98 * self.error_percent


@dataclass(frozen=True)
class Offset:
    """Constant of the sensor in units of the input, and the error (5) with and without it."""

    value: float
    error_percent: float
    error_without_offset_percent: float


@dataclass(frozen=True)
class Certificate:
    """Proof that the weights are the optimum: relative cost gap and violation, exact arithmetic."""

    cost_gap: float
    violation: float
    unique: bool


@dataclass(frozen=True)
class FitReport:
    """Everything that is stored with an identified model under ``report``."""

    solver: str
    fit: Fit
    excitation: ExcitationReport
    certificate: Certificate
    lag: Lag | None
    offset: Offset | None
    resting_input: float | None
    creep_rates_chosen: bool

    def to_dict(self, structure: ModelStructure) -> dict[str, Any]:
        """Figures and sentences as JSON can hold them."""
        return {**asdict(self), "sentences": list(self.sentences(structure))}

    def sentences(self, s: ModelStructure) -> Iterator[str]:
        """What an engineer has to know, one sentence a finding."""
        fit = self.fit
        seconds = s.sample_time
        yield (f"Forward error over {fit.samples} counted samples: {fit.rms_percent:.2f} % RMS and "
               f"{fit.max_percent:.2f} % at most of the output's range ({fit.rms:.3g} and {fit.max:.3g} {s.output_unit}).")
        if fit.skipped:
            yield (f"The first {fit.skipped} samples ({fit.skipped * seconds:.3g} s) are not counted, since the states "
                   f"that the actuator started with are unknown until the drive has passed the largest threshold.")
        if fit.skipped_max_percent > 3.0 * fit.max_percent:
            yield (f"These first samples hold a transient: the error there reaches {fit.skipped_max_percent:.1f} % of "
                   f"the range.")
        if self.resting_input is not None:
            yield (f"Creep starts as if the actuator had rested at {self.resting_input:.3g} {s.input_unit}, which fits the "
                   f"data best.")
        if self.offset is not None:
            yield (f"The sensor has an offset of {self.offset.value:.3g} {s.input_unit} at the input of S; without a "
                   f"free constant the error at the input would be {self.offset.error_without_offset_percent:.2f} % RMS "
                   f"instead of {self.offset.error_percent:.2f} %.")
        if self.lag is not None:
            yield _lag_sentence(self.lag, seconds)
        if self.creep_rates_chosen:
            rates = ", ".join(f"{rate:g}" for rate in s.creep_rates) or "none"
            yield f"Creep rates chosen to span sampling period and length of the recording: {rates} per second."
        if self.excitation.unreached:
            yield (f"The drive never reached the thresholds of {', '.join(self.excitation.unreached)}; these weights "
                   f"stay at their reference.")
        for names in self.excitation.undetermined:
            yield f"The data do not tell the weights {names} from each other."
        yield (f"Solved by {self.solver}; relative cost gap to the proven optimum {self.certificate.cost_gap:.1e}, "
               f"condition of P {self.excitation.condition:.1e}.")


def _lag_sentence(lag: Lag, sample_time: float) -> str:
    if not lag.pays:
        return "The sensor shows no lag that is worth removing."
    more = " or more" if lag.at_edge else ""
    how = (f"The sensor lags by {lag.samples:.2f} samples{more} ({lag.samples * sample_time * 1e3:.3g} ms): the error at the "
           f"input is {lag.error_percent:.3f} % RMS with the lag and {lag.error_without_lag_percent:.3f} % without")
    return how + ("; it was removed before the fit." if lag.removed else "; removing it is left to the option lag.")
