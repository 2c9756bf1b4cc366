"""Whether a solver became slower from run a to run b: one hypothesis a solver lane, rows only where it is rejected.

With ℓ the level of a task (`levels`), u a block of tasks that were timed together (one problem in one scaling by one set of
processes), l a line (a solver in a lane, in turns or hot):

    m_u  = median over solvers of the median over their tasks in u of ℓ_b − ℓ_a          the machine
    e_lu = mean over the tasks of l in u of ℓ_b − ℓ_a − m_u
    θ_l  = trimmed mean of e_lu over u,  s_l its standard error (Tukey and McLaughlin)   exp(θ_l) is the ratio
    t_l  = θ_l / √(s_l² + τ² + υ²),  p = 2 P(T > |t_l|), corrected over all lines (Benjamini and Hochberg)

The blocks of a run share its processes, so s_l does not see what changes from process to process, where memory lies and how the
core fares. That is τ, of which the spread of the lines themselves tells, most of which do not differ (Efron's empirical null),
and with several processes for each solver (repeats) the spread between these:

    V₁ = squared normalised median absolute deviation of θ_l, good for 0.37 (L − 1) degrees of freedom (its efficiency),
    V₂ = mean over l of the variance of θ_l between R repeats, over R, good for L (R − 1),
    τ² = the mean of V₁ and V₂, weighted by their degrees of freedom, less the median of s_l², and not below 0,
    υ² = π/2 (τ² + the median of s_l²) over the number of solvers, the variance of the machine's median.

T is Student's with Satterthwaite's degrees of freedom, but not more than 10 R: between independent runs of the same some lines
move much farther than the others (those that take few µs, most of it cold caches), the less so the more processes are in θ.

The smallest ratio that the two runs could have shown is that which one line alone would show nine times in ten,
exp(δ √(s_l² + τ² + υ²)) with δ the noncentrality at which T exceeds t_{1−α/2L} with POWER. The variance falls as 1/R and the degrees
of freedom come with R, hence the repeats that would do for a given ratio.

Rows of a line that differs have the interval of one block, and a test of their own, corrected over all these rows.

Sources: J. W. Tukey and D. H. McLaughlin, Sankhyā A 25 (1963) 331 to 352; B. Efron, J. Amer. Statist. Assoc. 99 (2004) 96 to
104; C. Croux and P. J. Rousseeuw, Computational Statistics 1 (1992) 411 to 428, for the median absolute deviation of few; F. E.
Satterthwaite, Biometrics Bull. 2 (1946) 110 to 114; Y. Benjamini and Y. Hochberg, J. R. Statist. Soc. B 57 (1995) 289 to 300.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats
from scipy.special import nctdtrinc

from bench.report.words import marked, solver_lanes
from solvers.arrays import Vector

LEVEL, POWER = 0.05, 0.95
"""The tails of θ are heavier than those of Student's law, so that nine times in ten ask for more of it."""
TRIMMED = 0.2
"""Share of the blocks that the mean leaves out at either end."""
EFFICIENCY = 0.37
"""Of the median absolute deviation, for the normal law."""
FREEDOM = 10
"""Most degrees of freedom for each process: the tails of θ are heavier than the normal law's."""
LARGEST = 10.0
"""Logarithm of the largest ratio that is spoken of."""
UNLIMITED = math.exp(LARGEST) * (1.0 - 1e-9)
"""Ratio from which on nothing could have been shown, whatever its size."""
WITNESSES = 3
"""Solvers that tell what the machine changed, that which does nothing among them; of fewer nothing is taken off."""
BLOCK = ["problem_set", "problem", "scaling", "repeat", "timed"]
LINE = ["solver", "lane", "timed"]
OF_LINE = ["theta", "error", "own_freedom", "spread"]


CHANGES = ("slower", "faster")
CANNOT_TELL, SAME = "cannot tell", "no difference"
MOST_NAMED = 6
"""Lines that have a sentence each."""


@dataclass(frozen=True)
class Times:
    """What two runs say about times."""

    lines: pd.DataFrame
    """One row a line: LINE, ``rows``, ``ratio``, ``ratio_low``, ``ratio_high`` (95 %), ``shown`` (the smallest ratio that could have been
    shown), ``p``, ``adjusted``, ``finding`` (slower, faster, SAME or CANNOT_TELL) and ``repeats`` that would do."""
    rows: pd.DataFrame
    """One row a task: ``task``, ``timed``, ``ratio``, ``ratio_low``, ``ratio_high``, ``adjusted`` (NaN in lines that do not differ) and
    ``change``."""
    machine: pd.Series
    """By way of timing, the ratio that all share."""
    witnesses: int
    """Solvers that have times in both runs."""
    smallest: float
    """Smallest ratio that matters."""

    def lanes(self, finding: str) -> int:
        """Solver lanes of which that is found, in turns or hot; of which nothing can be told, in turns and hot."""
        found = (self.lines.finding == finding).groupby([self.lines.solver, self.lines.lane])
        return int((found.all() if finding == CANNOT_TELL else found.any()).sum())

    @property
    def differ(self) -> int:
        """Solver lanes that became slower or faster."""
        return self.lines[self.lines.finding.isin(CHANGES)].groupby(["solver", "lane"]).ngroups

    def sentences(self) -> list[str]:
        """What is found, and what could have been."""
        said = []
        for finding in CHANGES:
            those = self.lines[self.lines.finding == finding].sort_values("p")
            each = [f"{_name(line)} is {finding}: {line.ratio:.2f} times as long ({line.ratio_low:.2f} to {line.ratio_high:.2f})"
                    for line in those.itertuples()]
            said += [f"{sentence}." for sentence in each] if len(each) <= MOST_NAMED else [
                f"{len(each)} times are {finding}, most certainly these: {'; '.join(each[:3])}."]
        return said + [self._power(str(timed), part) for timed, part in self.lines.groupby("timed") if part.scale.any()] + self._unsure()

    def _power(self, timed: str, part: pd.DataFrame) -> str:
        half, most = (part.shown.quantile(share, "higher") for share in (0.5, 0.9))
        if half >= UNLIMITED:
            return f"{timed.capitalize()}, there are too few solver lanes and repeats to find a change of any size."
        where = "" if len(part) == 1 else f" in half of the {len(part)} solver lanes, and one of {most:.2f} in nine of ten"
        return f"{timed.capitalize()}, a change by a factor of {half:.2f} would have shown{where}."

    def _unsure(self) -> list[str]:
        """Of which solver lanes nothing can be told, and what would do."""
        best = self.lines.loc[self.lines.groupby(["solver", "lane"]).shown.idxmin()]
        unsure = best[best.finding == CANNOT_TELL].sort_values("shown")
        of_lanes = self.lines.groupby(["solver", "lane"]).finding.agg(set)
        unsure = unsure[[of_lanes[solver, lane] == {CANNOT_TELL} for solver, lane in zip(unsure.solver, unsure.lane, strict=True)]]
        if unsure.empty:
            return []
        names = [_name(line) for line in unsure.itertuples()]
        most = f", with --repeats {unsure.repeats.max()} for all" if unsure.repeats.max() > unsure.repeats.iloc[len(unsure) // 2] else ""
        return [f"In {solver_lanes(len(unsure), len(best))} a change by a factor of {self.smallest:g} may have gone unseen: "
                f"{', '.join(names[:MOST_NAMED])}{', …' if len(names) > MOST_NAMED else ''}. With --repeats "
                f"{unsure.repeats.iloc[len(unsure) // 2]} in both runs it would show in half of them{most}."]


def _name(line: Any) -> str:
    return f"{marked(line.solver)} ({line.lane}, {line.timed})"


def compare_times(pairs: pd.DataFrame, floor: str, smallest: float) -> Times:
    """Compare what two runs took, from one row a task and repeat: BLOCK, ``task``, ``solver``, ``lane``, ``log_ratio`` (ℓ_b − ℓ_a).

    The solver ``floor`` does nothing: a witness of the machine, and no line. Ratios that matter begin at ``smallest``.
    """
    by_solver = pairs.groupby([*BLOCK, "solver"]).log_ratio.median()
    witnesses = pairs.solver.nunique()
    machine = by_solver.groupby(BLOCK).median() * float(witnesses >= WITNESSES)
    own = pairs.join(machine.rename("machine"), on=BLOCK)
    own = own[own.solver != floor].assign(own=own.log_ratio - own.machine)
    of_blocks = own.groupby([*LINE, *BLOCK[:-1]]).own.mean().reset_index()
    lines = pd.DataFrame([(*name, *_trimmed(part.own.to_numpy())) for name, part in of_blocks.groupby(LINE)],
                         columns=[*LINE, *OF_LINE])
    lines = lines.merge(own.groupby(LINE).task.nunique().rename("rows").reset_index(), on=LINE, how="left")
    parts = [_with_noise(part, own[own.timed == timed], witnesses) for timed, part in lines.groupby("timed")]
    lines = _judged(pd.concat(parts, ignore_index=True) if parts else _with_noise(lines, own, witnesses), smallest, int(own.repeat.nunique()))
    return Times(lines, _rows(own, lines), np.exp(machine.groupby("timed").median()), witnesses, smallest)


def _judged(lines: pd.DataFrame, smallest: float, repeats: int) -> pd.DataFrame:
    """What is found of each line, what could have been, and how many repeats would find the smallest ratio that matters."""
    lines = _concluded(lines.assign(adjusted=stats.false_discovery_control(lines.p)))

    def log_shown(count: Vector) -> Vector:
        freedom = lines.freedom.to_numpy() * count / repeats
        needed = stats.t.ppf(1.0 - LEVEL / 2.0 / max(len(lines), 1), freedom)
        return np.minimum(nctdtrinc(freedom, 1.0 - POWER, needed) * lines.scale.to_numpy() * np.sqrt(repeats / count), LARGEST)

    asked, low = math.log(smallest), np.full(len(lines), float(repeats))
    now = log_shown(low)
    high = np.ceil(repeats * np.maximum(now / asked, 1.0) ** 2)  # would do if no degrees of freedom came with them
    while (low < high).any():
        middle = np.floor((low + high) / 2.0)
        enough = log_shown(middle) <= asked
        low, high = np.where(enough, low, np.minimum(middle + 1.0, high)), np.where(enough, middle, high)
    finding = np.where(lines.change != "", lines.change, np.where(now <= asked, SAME, CANNOT_TELL))
    return lines.assign(shown=np.exp(now), finding=finding, repeats=high.astype(int))


def _trimmed(values: Vector) -> tuple[float, float, int, float]:
    """Trimmed mean, its standard error (0 of one value) and degrees of freedom, and the deviation of one value."""
    cut = int(TRIMMED * values.size)
    error = float(stats.mstats.trimmed_stde(values, (TRIMMED, TRIMMED))) if values.size > 1 else 0.0
    return float(stats.trim_mean(values, TRIMMED)), error, max(values.size - 2 * cut - 1, 1), error * math.sqrt(values.size)


def _with_noise(lines: pd.DataFrame, own: pd.DataFrame, witnesses: int) -> pd.DataFrame:
    """The lines of one kind of time with their scale, degrees of freedom and p."""
    between, freedom = _between(lines, own)
    within = float((lines.error**2).median())
    tau2 = max(between - within, 0.0)
    tau2 += math.pi / 2.0 * (tau2 + within) / max(witnesses, 1)
    variance = lines.error**2 + tau2
    sure = lines.error**4 / lines.own_freedom + tau2**2 / freedom
    satterthwaite = np.divide(variance**2, sure, out=np.full(len(lines), freedom), where=sure > 0.0)
    freedom_of_each = np.minimum(satterthwaite, float(FREEDOM * own.repeat.nunique()))
    scale = np.sqrt(variance)
    return lines.assign(scale=scale, freedom=freedom_of_each, tau=math.sqrt(tau2), p=_p(lines.theta, scale, freedom_of_each))


def _between(lines: pd.DataFrame, own: pd.DataFrame) -> tuple[float, float]:
    """Variance of θ from what changes between processes and runs, with its degrees of freedom."""
    count, repeats = len(lines), own.repeat.nunique()
    estimates = []
    if count > 1:
        spread = stats.median_abs_deviation(lines.theta, scale="normal") * count / (count - 0.8)
        estimates.append((spread**2, EFFICIENCY * (count - 1)))
    if repeats > 1:
        of_repeats = own.groupby([*LINE, "repeat"]).own.apply(lambda part: stats.trim_mean(part, TRIMMED)).unstack()
        estimates.append((float(of_repeats.var(axis=1).mean()) / repeats, float(count * (repeats - 1))))
    if not estimates:
        return LARGEST**2, 1.0  # as uncertain as can be
    variances, weights = np.array(estimates).T
    return float(np.average(variances, weights=weights)), max(float(weights.sum()), 1.0)


def _p(theta: pd.Series, scale: pd.Series, freedom: pd.Series) -> Vector:
    """Two-sided p of each; without any noise 0, and 1 of no effect."""
    t = np.divide(np.abs(theta), scale, out=np.where(theta == 0.0, 0.0, np.inf), where=np.asarray(scale) > 0.0)
    return np.asarray(2.0 * stats.t.sf(t, freedom), dtype=np.float64)


def _concluded(table: pd.DataFrame) -> pd.DataFrame:
    """Ratios with intervals, and what changed."""
    half = stats.t.ppf(1.0 - LEVEL / 2.0, table.freedom) * table.scale
    change = np.where(table.adjusted >= LEVEL, "", np.where(table.theta > 0.0, "slower", "faster"))
    return table.assign(ratio=np.exp(table.theta), ratio_low=np.exp(table.theta - half), ratio_high=np.exp(table.theta + half),
                        change=change)


def _rows(own: pd.DataFrame, lines: pd.DataFrame) -> pd.DataFrame:
    """Each task with its own ratio and interval, tested where its line differs."""
    tasks = own.groupby(["task", *LINE]).own.agg(theta="mean", repeats="size").reset_index()
    tasks = tasks.merge(lines[[*LINE, "spread", "tau", "freedom", "change"]].rename(columns={"change": "of_line"}), on=LINE)
    tasks["scale"] = np.hypot(tasks.spread / np.sqrt(tasks.repeats), tasks.tau)
    tested = tasks.of_line != ""
    tasks["adjusted"] = np.nan
    if tested.any():
        part = tasks[tested]
        tasks.loc[tested, "adjusted"] = stats.false_discovery_control(_p(part.theta, part.scale, part.freedom))
    found = _concluded(tasks.fillna({"adjusted": 1.0}))
    return found.assign(adjusted=tasks.adjusted)[["task", "timed", "ratio", "ratio_low", "ratio_high", "adjusted", "change"]]
