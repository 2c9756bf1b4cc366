"""Chooses creep rates and the orders n and m by cross-validation on whole excursions of the drive.

The creep part is K = Σ w_Ki Σ_a z_i(a), one state for each rate a, and every operator is known beforehand, so the
cost (6) of any set of rates, thresholds and dead zones depends on sums of the columns

    x,  H_r [x] for all thresholds r,  −S_r' [y] for all dead zones r',  z_r(a) for all thresholds and rates,  1.

One pass gives the Gram matrix of these columns for each fold; the programs of all candidates follow from it without the
samples. The recording is cut at the bottoms of the drive's excursions into FOLDS folds of about equal length; the
weights are identified from all folds but one and judged by the error of the drive (5) on that one. Candidates must have
at most PAYS times the error of the default structure, and a mean square error within one standard error of the
smallest (of the difference, fold by fold); the one with the fewest unknowns is chosen.

Source: T. Hastie, R. Tibshirani and J. Friedman, The Elements of Statistical Learning, 2nd edition 2009, section 7.10.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from piezo_model.identification.fitting import optimum
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import regressor_rows
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector

FOLDS = 5
EXCURSIONS = 2 * FOLDS
"""Fewest excursions of the drive for a choice."""
DEPTH = 0.25
"""Smallest descent and ascent of an excursion, as a share of the drive's range."""
MOST_RATES, BEAM = 4, 4
"""Most creep rates of a set, and number of best sets that are extended by another rate."""
PAYS = 0.95
"""Largest ratio of a candidate's error to that of the default structure at which it is worth choosing."""
PER_DECADE = 2
HYSTERESIS_ORDERS = (1, 2, 3, 5, 8, 12)
SUPERPOSITION_ORDERS = (0, 1, 2, 3, 5)
STILL = 1e-14
"""Largest variance of an operator at rest, unit amplitudes."""
SAMPLES, CHUNK = 100_000, 8192
"""Most samples used, and those of one chunk."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Candidate:
    """A structure with its cross-validated error."""

    n: int
    m: int
    creep_rates: tuple[float, ...]
    d: int
    """Number of unknowns."""
    error_percent: float
    standard_error: float
    """RMS error of the drive on held-out data, per cent of its range, and its standard error over the folds."""
    fold_errors: tuple[float, ...]
    """The RMS error of each fold, per cent of the range."""

    def __str__(self) -> str:
        rates = ", ".join(f"{rate:.3g}" for rate in self.creep_rates)
        creep = f"creep rates {rates} per second" if rates else "no creep"
        return f"n = {self.n}, m = {self.m} and {creep}"


@dataclass(frozen=True)
class Selection:
    """All tried candidates, and the choice."""

    candidates: tuple[Candidate, ...]
    best: Candidate
    """The candidate with the smallest error."""
    chosen: Candidate
    """The simplest candidate within one standard error of the best."""
    default: Candidate
    rejected: Candidate | None = None
    """The simplest candidate, if the default has the smaller error of the output on held-out data."""

    @property
    def sentence(self) -> str:
        """The choice in words."""
        c, b, count = self.chosen, self.best, len(self.candidates)
        if (r := self.rejected) is not None:
            return (
                f"Of {count} structures, {r} have the smaller RMS error of the drive on excursions left out, "
                f"{r.error_percent:.3g} % of its range against {c.error_percent:.3g} %, but the larger error of the "
                f"output on data left out; so the model takes {c}."
            )
        before = "" if c == self.default else f", {self.default.error_percent:.3g} % without the choice"
        smallest = "" if c == b else f", {b.error_percent:.3g} % at best"
        return (
            f"Cross-validation over {count} structures takes {c}: an RMS error of the drive of {c.error_percent:.3g} % "
            f"of its range on excursions left out{before}{smallest}."
        )

    @property
    def table(self) -> tuple[Candidate, ...]:
        """The choice, the default, and the best candidates of each number of rates and of each pair of orders, by their
        error."""
        kept: dict[object, Candidate] = {}
        for candidate in sorted(self.candidates, key=_error):
            kept.setdefault(len(candidate.creep_rates), candidate)
            kept.setdefault((candidate.n, candidate.m), candidate)
        return tuple(dict.fromkeys((self.chosen, self.default, *sorted(kept.values(), key=_error))))

    def to_dict(self) -> dict[str, Any]:
        """The sentence, and the table with the standing of each row, for JSON."""
        standing = {self.best: "smallest error", self.default: "without a choice", self.chosen: "chosen"}
        columns = ("n", "m", "creep_rates", "d", "error_percent", "standard_error")
        rows = [{**{name: getattr(c, name) for name in columns}, "standing": standing.get(c, "")} for c in self.table]
        return {"sentence": self.sentence, "tried": len(self.candidates), "table": rows}


def excursions(x: Vector) -> NDArray[np.int64]:
    """Indices of the bottoms of the drive's excursions, after a descent and before an ascent by DEPTH of its range."""
    depth, turns = DEPTH * float(np.ptp(x)), np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    x = x[: np.max(turns, initial=0) + 1]  # the last branch may end anywhere
    bottoms: NDArray[np.int64] = find_peaks(-x, prominence=depth)[0]
    # Of several equally low bottoms of one excursion, the last is taken.
    return bottoms[np.maximum.reduceat(x, bottoms) >= x[bottoms] + depth] if bottoms.size else bottoms


def candidate_rates(sample_time: float, duration_s: float, per_decade: int = PER_DECADE) -> tuple[float, ...]:
    """Rates in 1/s on a logarithmic grid from the length of the recording to ten sampling periods, fastest first.

    Examples
    --------
    >>> candidate_rates(1e-2, 1.0)
    (10.0, 3.16228, 1.0)
    """
    slowest = math.ceil(per_decade * math.log10(1.0 / duration_s) - 1e-9)
    fastest = math.floor(per_decade * math.log10(0.1 / sample_time) + 1e-9)
    return tuple(float(f"{10.0 ** (k / per_decade):.6g}") for k in range(fastest, slowest - 1, -1))


def select(
    x: Vector,
    y: Vector,
    structure: ModelStructure,
    start: OperatorState,
    skip: int,
    solver: str,
    *,
    ns: Sequence[int] = HYSTERESIS_ORDERS,
    ms: Sequence[int] = SUPERPOSITION_ORDERS,
    rates: Sequence[float] | None = None,
    progress: Progress = lambda what, done, total: None,
) -> Selection | None:
    """Cross-validate creep rates and orders; None if the drive makes too few excursions.

    Parameters
    ----------
    x, y : array (N,)
        Input and output from the first sample on; SAMPLES of them are enough.
    structure : ModelStructure
        Structure of a first fit: its ranges, sign and offset are kept, and its orders and rates are the default.
    start : OperatorState
        States before the first sample, of that structure.
    skip : int
        Samples at the start that are not counted.
    solver : str
    ns, ms : sequence of int
        Orders to try, those of ``structure`` among them.
    rates : sequence of float, optional
        Those of ``structure`` if they are given; otherwise sets of up to MOST_RATES of ``candidate_rates`` are tried.
    """
    bottoms = excursions(x[skip:]) + skip
    if bottoms.size < EXCURSIONS:
        return None
    # Folds end at the bottoms nearest to equal lengths.
    equal = np.linspace(skip, x.size, FOLDS + 1)[1:-1]
    edges = np.unique([skip, *(bottoms[np.argmin(np.abs(bottoms - at))] for at in equal), x.size]).tolist()
    if len(edges) <= FOLDS:
        return None
    orders = structure.n, structure.dead_zones // 2
    grid = tuple(rates or ())
    if rates is None:
        grid = candidate_rates(structure.sample_time, (x.size - skip) * structure.sample_time)
    grams = _Grams(structure, ns, ms, tuple(dict.fromkeys((*grid, *structure.creep_rates))), solver)
    grams.accumulate(x, y, start, edges, progress)
    default = grams.candidate(*orders, structure.creep_rates)
    best_rates = structure.creep_rates if rates is not None else _search(grams, grid, *orders, progress)
    for done, (n, m) in enumerate(product(ns, ms)):
        progress(f"n = {n}, m = {m}", done, len(ns) * len(ms))
        grams.candidate(n, m, best_rates)
    best = grams.best()
    if rates is None and (best.n, best.m) != orders:
        _search(grams, grid, best.n, best.m, progress)
        best = grams.best()
    candidates = tuple(grams.candidates.values())
    good = [c for c in candidates if _error(c) <= PAYS * _error(default) and _as_good(c, best)]
    chosen = min(good, key=lambda c: (c.d, len(c.creep_rates), _error(c)), default=default)
    return Selection(candidates, best, chosen, default)


def _error(candidate: Candidate) -> float:
    return candidate.error_percent


def _as_good(one: Candidate, best: Candidate) -> bool:
    """Whether the mean square error of a candidate is larger by no more than the standard error of the difference."""
    excess = np.square(one.fold_errors) - np.square(best.fold_errors)
    return bool(np.mean(excess) <= np.std(excess, ddof=1) / math.sqrt(excess.size))


def _search(grams: _Grams, grid: Sequence[float], n: int, m: int, progress: Progress) -> tuple[float, ...]:
    """The best set of rates for given orders: all sets of one and two rates are tried, and extensions of the best."""
    tried = best = [grams.candidate(n, m, ())]
    for size in range(1, MOST_RATES + 1):
        larger = {
            tuple(sorted({*c.creep_rates, rate}, reverse=True))
            for c in best
            for rate in grid
            if rate not in c.creep_rates
        }
        extended = sorted((grams.candidate(n, m, rates) for rates in sorted(larger)), key=_error)
        tried, best = [*tried, *extended], extended if size == 1 else extended[:BEAM]
        progress("creep rates", size, MOST_RATES)
    return min(tried, key=_error).creep_rates


class _Grams:
    """Gram matrices of all columns, one per fold, and the candidates computed from them."""

    def __init__(
        self, structure: ModelStructure, ns: Sequence[int], ms: Sequence[int], rates: tuple[float, ...], solver: str
    ) -> None:
        self.structure, self.rates, self.solver = structure, rates, solver
        self.plays = tuple(sorted({r for n in ns for r in _orders(structure, n, 0).play_thresholds}))
        self.zones = tuple(sorted({r for m in ms for r in _orders(structure, 0, m).dead_zone_thresholds}))
        self.candidates: dict[tuple[int, int, tuple[float, ...]], Candidate] = {}
        self.folds: list[Matrix] = []
        self.counts: list[int] = []

    def accumulate(self, x: Vector, y: Vector, start: OperatorState, edges: Sequence[int], progress: Progress) -> None:
        """Run all operators once over the samples and sum the products of their columns by fold."""
        s = replace(
            self.structure, play_thresholds=self.plays, dead_zone_thresholds=self.zones, creep_rates=(), offset=True
        )
        r, own = np.array((0.0, *self.plays)), np.array((0.0, *self.structure.play_thresholds))
        play = np.interp(r, own, start.play[: own.size])
        # creep starts from the same state for all rates
        rested = np.interp(r, own, start.creep[: own.size]) if start.creep.size else play
        structures = [replace(s, creep_rates=(rate,)) for rate in self.rates] or [s]
        states = [OperatorState.of(play, [rested] * len(each.creep_rates), each) for each in structures]
        self.span = float(np.ptp(s.unit_input(x[edges[0] :])))

        def columns(part: slice) -> Matrix:
            rows = [
                regressor_rows(each, state, x[part], y[part]) for each, state in zip(structures, states, strict=True)
            ]
            fixed = 1 + len(self.plays) + len(self.zones)
            return np.hstack([rows[0][:, :fixed], *(each[:, fixed:-1] for each in rows), rows[0][:, -1:]])

        for begin in range(0, edges[0], CHUNK):
            columns(slice(begin, min(begin + CHUNK, edges[0])))
        width = 1 + len(self.plays) + len(self.zones) + len(self.rates) * r.size + 1
        for fold, (begin, end) in enumerate(pairwise(edges)):
            gram = np.zeros((width, width))
            for at in range(begin, end, CHUNK):
                samples = slice(at, min(at + CHUNK, end))
                part = columns(samples)[~np.isnan(y[samples])]
                gram += part.T @ part
            self.folds.append(gram)
            self.counts.append(int(np.count_nonzero(~np.isnan(y[begin:end]))))
            progress("running the operators", fold + 1, len(edges) - 1)

    def best(self) -> Candidate:
        """The candidate with the smallest error."""
        return min(self.candidates.values(), key=_error)

    def candidate(self, n: int, m: int, rates: Sequence[float]) -> Candidate:
        """The candidate of given orders and rates, cross-validated once."""
        key = n, m, tuple(rates)
        if key not in self.candidates:
            s = replace(_orders(self.structure, n, m), creep_rates=tuple(rates))
            members, first = self._members(s)
            folds = [
                np.add.reduceat(np.add.reduceat(gram[np.ix_(members, members)], first, axis=0), first, axis=1)
                for gram in self.folds
            ]
            total = np.sum(folds, axis=0)
            squares = []
            for gram, count in zip(folds, self.counts, strict=True):
                problem = self._problem(s, total - gram, sum(self.counts) - count)
                w = np.concatenate([[1.0], optimum(problem, self.solver)])
                squares.append(max(float(w @ gram @ w), 0.0) / count)
            errors = 100.0 * np.sqrt(squares) / self.span
            self.candidates[key] = Candidate(
                n,
                m,
                tuple(rates),
                s.d,
                float(np.sqrt(np.mean(np.square(errors)))),
                float(np.std(errors, ddof=1)) / math.sqrt(errors.size),
                tuple(errors.tolist()),
            )
        return self.candidates[key]

    def _members(self, s: ModelStructure) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices of the columns that are summed to those of a structure, x first, and the start of each sum."""
        r, zones, creep = (0.0, *self.plays), 1 + len(self.plays), 1 + len(self.plays) + len(self.zones)
        sums = [
            [0],
            *([r.index(threshold)] for threshold in s.play_thresholds),
            *([zones + self.zones.index(threshold)] for threshold in s.dead_zone_thresholds),
        ]
        if s.creep_rates:
            blocks = [creep + self.rates.index(rate) * len(r) for rate in s.creep_rates]
            sums += [[block + r.index(threshold) for block in blocks] for threshold in (0.0, *s.play_thresholds)]
        if s.offset:
            sums.append([creep + len(self.rates) * len(r)])
        return np.concatenate(sums), np.cumsum([0, *(len(each) for each in sums[:-1])])

    def _problem(self, s: ModelStructure, gram: Matrix, count: float) -> IdentificationProblem:
        """The program of a Gram matrix of ``count`` samples; an operator of small variance has not moved."""
        gram, first = gram / count, 1 + s.n + s.dead_zones
        moved = np.diag(gram) - gram[-1] ** 2 > STILL if s.offset else np.diag(gram) > STILL
        excitation = Excitation(
            -1.0,
            1.0,
            -1.0,
            1.0,
            tuple(moved[1 : 1 + s.n].tolist()),
            tuple(moved[first : first + s.creep_weights].tolist()),
        )
        return IdentificationProblem(s, gram[1:, 1:], gram[0, 1:], 0.5 * float(gram[0, 0]), excitation)


def _orders(s: ModelStructure, n: int, m: int) -> ModelStructure:
    """The structure with other orders and equidistant thresholds."""
    other = ModelStructure.equidistant(n, m, (-1.0, 1.0), (-1.0, 1.0), (), s.sample_time)
    return replace(s, play_thresholds=other.play_thresholds, dead_zone_thresholds=other.dead_zone_thresholds)
