"""The quick experiment, run once: its files, and its verdict on the terminal and in the report."""

from pathlib import Path

import numpy as np
from command_line import CommandLine
from figures import Figures

from bench.stage import trial
from bench.stage.setup import StageSetup

FIGURES = ("fig4_staircase_x", "fig4_staircase_y", "loops", "cycles")


def test_every_figure_exists_as_svg_and_numbers_and_is_in_the_report(figures: Figures) -> None:
    assert sorted(str(path.relative_to(figures.folder)) for path in figures.folder.rglob("*.*")) == sorted(
        [
            "experiment.html",
            "experiment.md",
            *(f"{name}.svg" for name in FIGURES),
            *(f"figures/{name}.csv" for name in FIGURES),
        ]
    )
    for name in FIGURES:
        assert f"({name}.svg)" in figures.page
        assert "<svg" in (figures.folder / f"{name}.svg").read_text(encoding="utf-8")
        assert len(figures.table(name)) > 1


def test_the_verdict_is_on_the_terminal_and_in_the_report(figures: Figures) -> None:
    verdict = " ".join(figures.call.stdout.partition("\n\n")[0].split())
    assert verdict.startswith("Self-learning compensation brings the stage from")
    assert verdict in figures.page
    assert figures.call.stderr == ""


def test_the_experiment_depends_on_the_seed_alone() -> None:
    def errors(seed: int) -> np.ndarray:
        return trial.learned(StageSetup.quick(cycles=1, seed=seed, solver="box_active_set")).error_um

    np.testing.assert_array_equal(errors(3), errors(3))
    assert not np.array_equal(errors(3), errors(4))


def test_an_impossible_experiment_is_refused_in_one_sentence(piezobench: CommandLine, tmp_path: Path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    assert "is not a folder" in piezobench("experiment", "--out", occupied).refusal
    assert "there is no solver 'magic'" in piezobench("experiment", "--solver", "magic", "--out", tmp_path).refusal
    assert list(tmp_path.iterdir()) == [occupied]
