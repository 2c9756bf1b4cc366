"""The results of an identification, in numbers and in sentences.

Errors are those of the output over the counted samples, as a share of the output's full range. A headline comes first,
then the findings in order of the errors that they cause.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from piezo_model.identification_problem import ExcitationReport
from piezo_model.structure import ModelStructure
from piezo_model.units import quantity, shown

UNDETERMINED = "Creep is not determined by this recording; hold a step for a minute."
INDISTINCT = "Creep cannot be distinguished from hysteresis in this recording; hold a step for a minute."
ABSENT = "The recording shows no creep, although its drive would show it."

FINDINGS = 4
"""Largest number of findings after the headline; the page has all of them."""
STARTS = {
    "after an ascent": "The first sample lies on a branch after a long ascent.",
    "after a descent": "The first sample lies on a branch after a long descent.",
    "searched": "The states before the first sample were searched, and fit the data best.",
}
FIGURES = {
    "gain": "Gain",
    "hysteresis_percent": "hysteresis",
    "creep_percent_per_decade": "creep",
    "offset": "offset",
}
NOTABLE = 0.1
"""Smallest share of the squares that a mode explains in the scan at which it is worth a sentence if it is not kept."""
FAR_MORE = 3.0
"""Smallest ratio of the largest errors of skipped and counted samples that indicates a transient."""


def percent(value: float) -> str:
    """A percentage with two digits."""
    if abs(value) > 100.0:
        return "over 100 %" if value > 0.0 else "under −100 %"
    return f"{value:.2g} %" if abs(value) >= 1e-4 else "less than 0.0001 %"


@dataclass(frozen=True)
class Fit:
    """Error of the forward model."""

    samples: int
    """Number of counted samples."""
    skipped: int
    """Number of samples before them."""
    rms_percent: float
    max_percent: float
    """Errors of the counted samples, per cent of the output's full range."""
    rms: float
    max: float
    """The same in the output's unit."""
    skipped_max_percent: float
    """Largest error of the skipped samples."""
    line_percent: float
    cubic_percent: float
    """RMS errors of the best line and the best cubic over the counted samples."""
    line: tuple[float, float]
    """Constant and slope of the best line, normalised units."""
    span: float
    """The output's full range without a transient, in its unit."""
    missing: int
    """Number of samples after the skipped ones without an output, which are not counted."""

    def headline(self, unit: str, where: str = "") -> str:
        """The errors in one sentence."""
        total = self.samples + self.skipped + self.missing
        every = f" of {total}" if total > self.samples else ""
        without = f" ({self.missing} not counted)" if self.missing else ""
        return (
            f"{percent(self.line_percent)} with a line, {percent(self.rms_percent)} with this "
            f"model{where and ' ' + where}: RMS error of the output as a share of its full range, "
            f"over {self.samples}{every} samples{without}; at most {percent(self.max_percent)} "
            f"({quantity(self.max, unit, 2)}"
            f"{'' if unit else ' in the unit of the output, which the file does not say'})."
        )


@dataclass(frozen=True)
class Baseline:
    """RMS errors of the output, per cent of its full range."""

    line_percent: float
    cubic_percent: float
    model_percent: float
    held_out: bool
    """Whether they are those on held-out data, and not on the data of the fits."""

    @property
    def is_significant(self) -> bool:
        """Whether the model is better than the line."""
        return self.model_percent < 0.9 * self.line_percent


@dataclass(frozen=True)
class Lag:
    """The sensor's delay that fits best, in samples, and the error of the output without and with its removal."""

    samples: float
    removed: bool
    error_percent: float
    error_without_lag_percent: float
    at_edge: bool
    """Whether the best lag is the largest tried one: it may be larger."""
    is_significant: bool
    """Whether the gain of its removal is clear."""


@dataclass(frozen=True)
class Certificate:
    """Proof that the weights are the optimum: relative cost gap and violation, exact arithmetic."""

    cost_gap: float
    violation: float
    unique: bool | None
    """None if that was not decided."""


@dataclass(frozen=True)
class Offset:
    """The constant term b in units of the input, and the error (5) with and without it. An offset of the sensor and an
    asymmetry of the loops both contribute to it."""

    value: float
    error_percent: float
    error_without_offset_percent: float

    @property
    def is_significant(self) -> bool:
        """Whether the constant lowers the error by more than two per cent of itself."""
        return self.error_percent < 0.98 * self.error_without_offset_percent

    def sentence(self, unit: str) -> str:
        """The constant in words, and what it is good for if that shows."""
        without, behind = percent(self.error_without_offset_percent), percent(self.error_percent)
        gain = f"; without it the RMS error of the drive is {without} instead of {behind}" if without != behind else ""
        return f"Constant term b = {quantity(self.value, unit, 3)}, input-referred{gain}."


@dataclass(frozen=True)
class CreepFinding:
    """What the recording says of creep (`creep`)."""

    determined: bool
    chosen: bool
    """Whether creep was left out or taken in by that, and not by given rates."""
    rates: tuple[float, ...]
    """Rates in 1/s that the drive can determine beside any hysteresis."""
    share: float
    chi_square: float
    absent: bool
    """Whether more than negligible creep is excluded."""

    @property
    def clear(self) -> bool:
        """Whether the recording tells creep from hysteresis."""
        return self.determined or self.absent

    def sentence(self, rates: Sequence[float]) -> str:
        """What a user of a model with these rates should know; "" if nothing."""
        if self.determined:
            return "" if rates else "The recording holds creep, which the model leaves out."
        why = UNDETERMINED if not self.rates else ABSENT if self.absent else INDISTINCT
        return f"The creep of the given rates is a guess. {why}" if rates else why * self.chosen


@dataclass(frozen=True)
class Drive:
    """What the drive of a recording can determine, whether that is in the data or not."""

    hysteresis: bool
    creep: bool
    drift: bool
    highest_Hz: float
    """Highest frequency at which the output follows the drive; 0 without one."""

    def sentence(self, creep: bool) -> str:
        """The same in words, with creep if the recording tells it from hysteresis; otherwise that has a sentence of its
        own (`CreepFinding`)."""
        drift = "a drift of the sensor" if creep else "a drift"  # which may be creep
        effects = {"hysteresis": self.hysteresis, "creep": creep, drift: self.drift}
        can, cannot = ([name for name, shown in effects.items() if shown is which] for which in (True, False))
        determined = f"This drive determines {_listed(can, 'and') or 'none of hysteresis, creep and drift'}"
        cannot = [name for name in cannot if name != "creep"]
        but = f", but not {_listed(cannot, 'or')}" if can and cannot else ""
        dynamics = f"dynamics up to {quantity(self.highest_Hz, 'Hz', 2)}" if self.highest_Hz else "no dynamics"
        return f"{determined}{but}; it shows {dynamics}."


def _listed(names: Sequence[str], last: str) -> str:
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


@dataclass(frozen=True)
class Drift:
    """A drift of the sensor, output unit per second; it is no part of the model."""

    per_s: float
    se: float
    rms_percent: float
    """Error of the model without the drift, per cent of the output's range."""


@dataclass(frozen=True)
class LaterPart:
    """A later part of a recording: its first sample, how the states before it were found, and these."""

    first_sample: int
    start: str
    play: list[float]
    creep: list[list[float]]


@dataclass(frozen=True)
class DynamicsFinding:
    """What a recording says of structural dynamics."""

    kept: bool
    frequencies_Hz: tuple[float, ...]
    damping: tuple[float, ...]
    delay_s: float
    intervals: dict[str, list[list[float]]]
    """Those of frequencies, damping ratios and delay at 95 %."""
    held_out_percent: tuple[float, float]
    """Errors on held-out blocks without and with the dynamics, per cent of the output's range."""
    reason: str
    """Against dynamics that were not kept; "" for others."""
    gain: float
    """Share of the whitened squares that the mode explains in the scan."""

    def sentences(self) -> Iterator[str]:
        """What a user should know."""
        if not self.kept and (self.gain < NOTABLE or self.held_out_percent[1] > self.held_out_percent[0]):
            return
        if not self.kept:
            yield (
                f"A faint resonance near {quantity(self.frequencies_Hz[0], 'Hz', 3)} is not in the model, since "
                f"{self.reason}; record steps of 20 ms to determine it."
            )
            return
        for f, zeta, between in zip(self.frequencies_Hz, self.damping, self.intervals["frequencies_Hz"], strict=True):
            low, high = (f"{end:.5g}" for end in between)
            within = f" ({low} to {high} Hz)" if low != high else ""
            yield f"A resonance at {quantity(f, 'Hz', 5)}{within} with a damping of {100.0 * zeta:.3g} %."
        without, behind = self.held_out_percent
        yield (
            f"The output is delayed by {quantity(self.delay_s, 's', 3)} from the end of the sampling interval; with "
            f"the dynamics the error on held-out data is {behind:.3g} % of the range instead of {without:.3g} %."
        )


@dataclass(frozen=True)
class FitReport:
    """The ``report`` that is stored with an identified model.

    ``refusal`` is the reason against a forced model, and ``left_out`` what the output has of ignored dynamics;
    ``start`` says how the states before the first sample were found,
    and ``parts`` has those before the others;
    ``passes`` and ``programs`` count the passes of the operators over the samples and the quadratic programs solved.
    """

    solver: str
    estimator: str
    fit: Fit
    baseline: Baseline
    hysteresis: bool
    refusal: str | None
    left_out: str | None
    monotonic_drive: bool
    excitation: ExcitationReport
    certificate: Certificate | None
    lag: Lag | None
    dynamics: DynamicsFinding | None
    offset: Offset | None
    start: str
    parts: Sequence[LaterPart]
    drive: Drive
    creep: CreepFinding
    drift: Drift | None
    intervals: Mapping[str, Any] | None
    figures: Mapping[str, float]
    units: str
    passes: int
    programs: int

    def to_dict(self, structure: ModelStructure) -> dict[str, Any]:
        """Numbers and sentences for JSON."""
        findings = [sentence for _, sentence in sorted(self._findings(structure), key=lambda finding: -finding[0])]
        headline = self.fit.headline(structure.output_unit)
        return {
            **asdict(self),
            "headline": headline,
            "drive": {**asdict(self.drive), "sentence": self._drive_sentence},
            "creep": {**asdict(self.creep), "sentence": self.creep.sentence(structure.creep_rates)},
            "findings": findings[:FINDINGS],
            "advice": list(self._advice()),
            "sentences": [*filter(None, (headline, self.units)), *findings, *self._facts(structure)],
        }

    @property
    def _drive_sentence(self) -> str:
        return self.drive.sentence(self.drive.creep and self.creep.clear)

    def _findings(self, s: ModelStructure) -> Iterator[tuple[float, str]]:
        """The important sentences, each with the error that its cause adds or would add, per cent of the range."""
        fit = self.fit
        if self.refusal is not None:
            yield 1e3, f"The model was forced although {self.refusal}."
        if self.left_out is not None:
            yield 1e3, f"The model is without dynamics although {self.left_out}."
        if s.negative_gain:
            yield 200.0, "The output falls as the input rises; model, inverse and compensator have that sign."
        if not self.hysteresis:
            yield (
                150.0,
                "No hysteresis: the data lie on a single curve, which a line describes to "
                f"{percent(fit.line_percent)}, a cubic to {percent(fit.cubic_percent)} and this model to "
                f"{percent(fit.rms_percent)}.",
            )
        if fit.skipped:
            cause = " as a switch-on transient" * (fit.skipped_max_percent > FAR_MORE * fit.max_percent)
            yield (
                fit.skipped_max_percent,
                f"The first {fit.skipped} samples ({quantity(fit.skipped * s.sample_time, 's', 3)}) are excluded{cause}"
                f"; the error there reaches {percent(fit.skipped_max_percent)}.",
            )
        if fit.samples < fit.skipped:
            yield 100.0, f"Only {fit.samples} of {fit.samples + fit.skipped} samples are counted, too few to rely on."
        if self.monotonic_drive:
            yield (
                90.0,
                "The counted part is almost a single branch: the drive hardly reverses, so hysteresis can "
                "barely be separated from curvature.",
            )
        if sentence := self.creep.sentence(s.creep_rates):
            yield 85.0, sentence
        if self.drift is not None:
            who, why = ("sensor", "") if self.creep.clear else ("output", ", as by creep or a drift of the sensor")
            yield (
                fit.rms_percent - self.drift.rms_percent + 1.0,
                f"The {who} drifts by {self.drift.per_s:.2g} {shown(s.output_unit)}/s{why}; this is no part of the "
                f"model, and without it the RMS error is {percent(self.drift.rms_percent)} of the range.",
            )
        if self.offset is not None and self.offset.is_significant:
            yield (
                self.offset.error_without_offset_percent - self.offset.error_percent,
                self.offset.sentence(s.input_unit),
            )
        if self.dynamics is not None:
            without, behind = self.dynamics.held_out_percent
            for sentence in self.dynamics.sentences():
                yield abs(without - behind), sentence
        if self.lag is not None and self.lag.is_significant:
            yield self.lag.error_percent - self.lag.error_without_lag_percent, _lag_sentence(self.lag, s.sample_time)

    def _facts(self, s: ModelStructure) -> Iterator[str]:
        """Further sentences of the page."""
        yield self._drive_sentence
        if self.start in STARTS:
            yield STARTS[self.start]
        if self.offset is not None and not self.offset.is_significant:
            yield self.offset.sentence(s.input_unit)
        if self.lag is not None and not self.lag.is_significant:
            yield "The sensor shows no lag that is worth removing."
        if self.creep.determined and self.creep.chosen:
            rates = ", ".join(f"{rate:g}" for rate in s.creep_rates)
            yield f"Creep is in the data beside any hysteresis, at the rates that they determine: {rates} per second."
        yield from self._figures(s)
        if self.excitation.unreached:
            yield (
                f"The drive never reached the thresholds of {', '.join(self.excitation.unreached)}; these weights "
                f"stay at their reference."
            )
        for names in self.excitation.undetermined:
            yield f"The data cannot separate the weights {names}."
        b = self.baseline
        yield (
            f"On {'held-out data, every second block of the drive' if b.held_out else 'the data of the fit'}: "
            f"{percent(b.line_percent)} with a line, "
            f"{percent(b.cubic_percent)} with a cubic, {percent(b.model_percent)} with this model."
        )
        if self.certificate is None:
            yield "The model is the best straight line, since the fit is no better on these data."
            return
        steps = ", from which Gauss–Newton steps minimise the error of the output" * (self.estimator == "forward")
        yield (
            f"Program (6) solved by {self.solver}{steps}; relative cost gap to its proven optimum "
            f"{self.certificate.cost_gap:.1e}, condition of P {self.excitation.condition:.1e}."
        )
        yield f"{self.passes} passes over the samples and {self.programs} quadratic programs."

    def _figures(self, s: ModelStructure) -> Iterator[str]:
        """What a data sheet says, with intervals where there are some."""
        between = {} if self.intervals is None else self.intervals["figures"]
        gain = f"{s.output_unit or 'output'}/{s.input_unit or 'input'}".replace("um", "µm")
        units = dict(zip(self.figures, (gain, "% of the loop", "% a decade", s.input_unit), strict=True))
        shown = [
            f"{FIGURES[name]} {value:.3g}"
            + (f" ({between[name][0]:.3g} to {between[name][1]:.3g})" if name in between else "")
            + f" {units[name]}".rstrip()
            for name, value in self.figures.items()
            if name != "creep_percent_per_decade" or s.creep_rates
        ]
        yield f"{', '.join(shown)}{'; in brackets the 95 % intervals for these orders' * bool(between)}."

    def _advice(self) -> Iterator[str]:
        """Recommendations, the most useful first."""
        if self.excitation.unreached:
            yield (
                "Drive over more of the range, or ask for lower orders: the thresholds of "
                f"{', '.join(self.excitation.unreached)} "
                f"were never reached, and what the model says there is a guess."
            )
        if self.monotonic_drive or self.fit.samples < self.fit.skipped:
            yield "Record a few whole loops more."
        if self.lag is not None and self.lag.removed:
            yield "The model is without the lag of the sensor; a loop that the sensor closes has it."
        elif self.lag is not None and self.lag.is_significant and self.lag.at_edge:
            yield (
                f"Align input and output first: the lag may be longer than the {self.lag.samples:.0f} samples that "
                "are tried."
            )
        elif self.lag is not None and self.lag.is_significant:
            yield "Remove the lag of the sensor with the option --lag remove."


def _lag_sentence(lag: Lag, sample_time: float) -> str:
    samples = f"{lag.samples:.0f} samples or more, the search limit," if lag.at_edge else f"{lag.samples:.2f} samples"
    how = (
        f"The sensor lags by {samples} ({quantity(lag.samples * sample_time, 's', 3)}): the RMS error of the output is "
        f"{lag.error_percent:.3f} % with the lag and {lag.error_without_lag_percent:.3f} % without"
    )
    return how + ("; it was removed before the fit." if lag.removed else ".")
