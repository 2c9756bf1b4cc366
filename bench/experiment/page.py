"""The page of an experiment: the verdict in words, then each figure with what it shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.experiment.plots import Exhibit
from bench.rig.rig import AXES, LEVELS, RANGE_UM, Rig
from bench.rig.trial import Trial


def verdict(straight: Trial, hindsight: Trial, learned: Trial) -> str:
    """The experiment in one sentence."""
    before, best, after = (float(np.sqrt(np.mean(run.rms_percent() ** 2))) for run in (straight, hindsight, learned))
    first = f"Self-learning compensation brings the stage from {before:.2f} % to {after:.3f} % RMS of range"
    if not after < best:
        return f"{first}: a straight line with hindsight would have done as well ({best:.2f} %)."
    return (f"{first}, {before / after:.0f} times nearer to the reference than a straight line and {best / after:.0f} times nearer "
            f"than the best straight line that hindsight can give ({best:.2f} %).")


def settings(rig: Rig) -> list[str]:
    """What the experiment was made with."""
    kinds = ", ".join(f"{axis}: {actuators.plant}" for axis, actuators in zip(AXES, rig.actuators, strict=True))
    return [f"Stage: two axes, {'two actuators in push-pull' if rig.push_pull else 'one actuator'} each ({kinds}), "
            f"cross-coupled, with structural dynamics, noise of {1e3 * rig.noise_um:g} nm and steps of "
            f"{1e3 * rig.quantum_um:g} nm in the sensors.",
            f"Reference: staircase of {LEVELS} levels over {RANGE_UM:g} µm, each held {rig.hold_s:g} s, a step taking "
            f"{1e3 * rig.step_s:g} ms; axis y a quarter of a period ahead.",
            f"Model: n = {rig.n}, m = {rig.m}; cycles of {rig.reset_s:g} s reset, {rig.build_s:g} s building and "
            f"{rig.learn_s:g} s learning; solver {rig.solver}; {rig.cycles} cycles; a sample every "
            f"{1e6 * rig.sample_time:g} µs; seed {rig.seed}.",
            "Uncompensated means driven along the straight line through the corners of the ranges. Errors are those of the "
            "measured platform in percent of the reference's range."]


def render(rig: Rig, sentence: str, exhibits: Sequence[Exhibit]) -> str:
    """The page as Markdown."""
    lines = ["# Self-learning compensation of a two-axis stage", "", f"**{sentence}**", ""]
    lines += [f"- {text}" for text in settings(rig)]
    for exhibit in exhibits:
        lines += ["", f"## {exhibit.title}", "", f"![{exhibit.title}]({exhibit.name}.svg)", "",
                  f"*{exhibit.caption}* Numbers: [{exhibit.name}.csv]({exhibit.name}.csv).", ""]
        lines += [f"- {text}" for text in exhibit.sentences]
    return "\n".join(lines) + "\n"
