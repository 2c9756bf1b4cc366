"""The report of an identification, in numbers and in sentences.

Errors are those of the output over the counted samples, relative to the output's full range. A headline comes first,
then the findings in order of importance. The sentences of creep, dynamics and lag are written in their own modules.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any

from piezo_model.identification.adequacy import Adequacy, Fit, applicable
from piezo_model.identification.creep import CreepEvidence
from piezo_model.identification.drive import Identifiability
from piezo_model.identification.dynamics import Lag
from piezo_model.identification.dynamics_finding import DynamicsFinding
from piezo_model.identification.error_model import Certificate, ProgramSolver
from piezo_model.identification.selection import Selection
from piezo_model.identification_problem import ExcitationReport
from piezo_model.structure import ModelStructure
from piezo_model.units import percent, quantity, shown

STARTS = {
    "after an ascent": "Before the first sample the drive had made a long ascent.",
    "after a descent": "Before the first sample the drive had made a long descent.",
    "searched": "The states before the first sample were fitted to the data.",
}
FIGURES = {
    "gain": "Gain",
    "hysteresis_percent": "hysteresis",
    "creep_percent_per_decade": "creep",
    "offset": "offset",
}
MOST = 7
"""Most findings that are printed; the page shows all."""
NO_LOOP, FAR_MORE = 0.2, 3.0
"""Width of a loop below which there is no hysteresis, % of the output's range; smallest ratio of the largest errors of
skipped and counted samples that indicates a transient."""


@dataclass(frozen=True)
class FitReport:
    """The ``report`` that is stored with an identified model.

    ``start`` says how the states before the first sample were found; ``parts`` has the first sample, the start and the
    states of each later part; ``creep_chosen`` is True if the ``evidence``, not the user, decided on creep; the
    ``trend`` is not in the model: its change over the recording, per second with standard error, and the RMS error
    without it; ``members`` are the recordings of a joint model.
    """

    estimator: str
    qp_solver: ProgramSolver
    fit: Fit
    adequacy: Adequacy
    excitation: ExcitationReport
    certificate: Certificate
    lag: Lag | None
    dynamics: DynamicsFinding | None
    start: str
    parts: Sequence[Mapping[str, Any]]
    drive: Identifiability
    members: Sequence[Mapping[str, Any]]
    evidence: CreepEvidence
    creep_chosen: bool
    trend: Mapping[str, float] | None
    selection: Selection | None
    intervals: Mapping[str, Any] | None
    figures: Mapping[str, float]
    units: str

    def to_dict(self, s: ModelStructure) -> dict[str, Any]:
        """Numbers and sentences for JSON."""
        findings, headline = [*self._findings(s)], self.fit.headline(s.output_unit)
        merged = ("qp_solver", "adequacy", "evidence", "creep_chosen", "selection", "trend")
        own = {name: asdict(v) if is_dataclass(v) else v for name, v in vars(self).items() if name not in merged}  # type: ignore[arg-type]
        return {
            **own,
            **asdict(self.qp_solver),
            **asdict(self.adequacy),
            "hysteresis": self.hysteresis,
            **({} if self.selection is None else {"selection": self.selection.to_dict()}),
            "headline": headline,
            "data_sheet": self._figures(s),
            "drive": {**own["drive"], "sentence": self._drive_sentence},
            "creep": self.evidence.to_dict(s.creep_rates, self.creep_chosen),
            **{"drift": None, "settling": None, self._trend_kind: self.trend},
            "findings": findings[:MOST],
            "sentences": [*filter(None, (headline, self.units)), *findings, *self._facts(s)],
        }

    @property
    def hysteresis(self) -> bool:
        """True if the data admit a loop, by the upper end of the interval of its width."""
        known = (
            {name: [value] for name, value in self.figures.items()}
            if self.intervals is None
            else self.intervals["figures"]
        )
        return float(known["hysteresis_percent"][-1]) > NO_LOOP

    @property
    def _drive_sentence(self) -> str:
        own = self.drive.sentence(
            self.drive.creep and self.evidence.is_clear, bool(self.dynamics and self.dynamics.kept)
        )
        return " ".join(member["sentence"] for member in self.members) or own

    def _findings(self, s: ModelStructure) -> Iterator[str]:
        """The important sentences, the most important first."""
        fit, verdict, unreached = self.fit, self.adequacy, ", ".join(self.excitation.unreached)
        creep = self.evidence.sentence(s.creep_rates, self.creep_chosen)
        cause = " as a switch-on transient" * (fit.skipped_max_percent > FAR_MORE * fit.max_percent)
        shows_dynamics = self.dynamics and (self.dynamics.kept or self.drive.highest_Hz)
        return applicable(
            (verdict.refusal, f"The model was forced although {verdict.refusal}."),
            *((True, fault) for fault in verdict.faults),
            (
                s.negative_gain,
                "The output falls as the input rises; model, inverse and compensator have this sign.",
            ),
            (
                self.drive.hysteresis and not self.hysteresis,
                "No hysteresis: the data lie on a single curve, with an RMS error of "
                f"{percent(fit.line_percent)} for a line, {percent(fit.cubic_percent)} for a cubic and "
                f"{percent(fit.rms_percent)} for this model.",
            ),
            (
                fit.samples < fit.skipped,
                f"Only {fit.samples} of {fit.samples + fit.skipped} samples are counted, too few to rely on; record a "
                "few complete loops.",
            ),
            (
                verdict.monotonic_drive and self.drive.levels != 2,
                "The counted samples are almost a single branch, so hysteresis can barely be distinguished from "
                "curvature; record a few complete loops.",
            ),
            (
                unreached,
                f"The drive never reached the thresholds of {unreached}, where the model is a guess; drive over more "
                "of the range, or choose lower orders.",
            ),
            (creep, creep),
            (
                self.drive.levels,
                f"The drive has {self.drive.levels} levels and hardly any samples between them, where the model is a "
                "guess; record steps between many levels.",
            ),
            (
                fit.skipped,
                f"The first {fit.skipped} samples ({quantity(fit.skipped * s.sample_time, 's', 3)}) are excluded"
                f"{cause}, with errors of up to {percent(fit.skipped_max_percent)}.",
            ),
            (self.trend, self.trend and self._trend_sentence(self.trend, shown(s.output_unit))),
            *((shows_dynamics, sentence) for sentence in (self.dynamics.sentences() if self.dynamics else ())),
            (self.lag and self.lag.is_significant, self.lag and self.lag.sentence(s.sample_time)),
        )

    @property
    def _trend_kind(self) -> str:
        return "settling" if self.evidence.settling else "drift"

    def _trend_sentence(self, trend: Mapping[str, float], unit: str) -> str:
        if self.evidence.settling:
            what = f"The output settles by {abs(trend['change']):.2g} {unit}, as creep does after a movement"
        else:
            drifting, cause = (
                ("sensor", "") if self.evidence.is_clear else ("output", ", owing to creep or to the sensor")
            )
            what = f"The {drifting} drifts by {trend['per_s']:.2g} {unit}/s{cause}"
        return (
            f"{what}. The model does not include the {self._trend_kind}; without it the RMS error is "
            f"{percent(trend['rms_percent'])} of the range."
        )

    def _facts(self, s: ModelStructure) -> Iterator[str]:
        """Further sentences, for the page."""
        rates = ", ".join(f"{rate:g}" for rate in s.creep_rates)
        steps = ", followed by Gauss–Newton steps that minimise the output error" * (self.estimator == "forward")
        return applicable(
            (True, self._drive_sentence),
            (self.start in STARTS, STARTS.get(self.start)),
            (self.lag and not self.lag.is_significant, self.lag and self.lag.sentence(s.sample_time)),
            (
                self.figures["creep_percent_per_decade"] and self.creep_chosen,
                f"The data show creep, distinguishable from hysteresis, at rates of {rates} per second.",
            ),
            (True, self._figures(s)),
            (
                True,
                f"Program (6) was solved by {self.qp_solver.solver}{steps}; relative cost gap to its proven optimum "
                f"{self.certificate.cost_gap:.1e}, condition number of P {self.excitation.condition:.1e}.",
            ),
            (
                True,
                f"{self.qp_solver.passes} passes over the samples and {self.qp_solver.programs} quadratic programs.",
            ),
            (self.selection, self.selection and self.selection.sentence),
        )

    def _figures(self, s: ModelStructure) -> str:
        """The data-sheet figures, with their intervals."""
        between = {} if self.intervals is None else self.intervals["figures"]
        gain = f"{s.output_unit or 'output'}/{s.input_unit or 'input'}".replace("um", "µm")
        units = dict(zip(self.figures, (gain, "% of the travel", "% per decade", s.input_unit), strict=True))
        figures = [
            f"{FIGURES[name]} {value:.3g}"
            + (f" ({between[name][0]:.3g} to {between[name][1]:.3g})" if name in between else "")
            + f" {units[name]}".rstrip()
            for name, value in self.figures.items()
            if name != "creep_percent_per_decade" or s.creep_rates
        ]
        return f"{', '.join(figures)}{'; 95 % intervals for these orders in brackets' * bool(between)}."
