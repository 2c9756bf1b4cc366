"""The commands and figures of the README are right."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import documents
import numpy as np
import pytest
import typer
from command_line import CommandLine

from bench.cli.app import command_line
from bench.derived.like_with_like import like_with_like
from bench.derived.measurements import Measurements
from bench.derived.ranking import ranking
from bench.derived.verdict import KNOWN
from bench.messages.verdict import Tier
from bench.report.words import joined, number, rounded
from bench.store import Run
from solvers import Lane

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
MAKEFILE = (ROOT / "Makefile").read_text()


def blocks(language: str) -> list[str]:
    return [block.text for block in documents.blocks(README) if block.language == language]


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """A folder with a recording of a simulated actuator and a reference, as the README assumes."""
    documents.lay_out(tmp_path)
    return tmp_path


def test_the_python_example_runs(stage: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(stage)
    (block,) = blocks("python")
    names: dict[str, object] = {}
    exec(compile(block, "README.md", "exec"), names)
    assert np.all(np.isfinite(names["drive"]))


@pytest.mark.needs("cc")
def test_the_commands_from_a_recording_to_a_controller_work_as_printed(stage: Path, piezobench: CommandLine) -> None:
    shutil.copytree(ROOT / "results" / "reference", stage / "results" / "reference")
    (block,) = [text for text in blocks("sh") if "deploy" in text]
    for words in documents.commands(block):
        if words[1] not in ("realtime", "experiment", "live"):  # half a minute each, and run by tests of their own
            output = documents.call(words, stage, piezobench)
            assert words[1] != "deploy" or "Model: from model.json." in output
    assert (stage / "stage.html").is_file()
    assert (stage / "drive.csv").read_text().startswith("time_s,drive_V")
    assert (stage / "controller" / "Makefile").is_file()
    assert (stage / "stage.fmu").is_file()


def test_every_verb_and_option_that_the_readme_shows_exists() -> None:
    verbs = typer.main.get_command(command_line()).commands
    shown = [words for block in blocks("sh") for words in documents.commands(block) if words[0] == "piezobench"]
    assert {words[1] for words in shown} >= {"race", "compare", "deploy", "experiment", "identify", "export-c"}
    for words in shown:
        known = {option for parameter in verbs[words[1]].params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known, words


def test_every_make_target_that_the_readme_shows_exists() -> None:
    for target in set(re.findall(r"make ([a-z]+)", README.read_text(encoding="utf-8"))):
        assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE), target


def made(*words: str) -> subprocess.CompletedProcess[str]:
    """Run make with the current Python in place of the environment that it would set up."""
    return subprocess.run(
        ["make", "--no-print-directory", "--old-file=.venv/.field", f"BIN={Path(sys.executable).parent}", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_make_help_lists_every_target() -> None:
    targets = set(re.findall(r"^([a-z]+):", MAKEFILE, flags=re.MULTILINE))
    assert {line.split()[0] for line in made("help").stdout.splitlines()} == targets


def test_make_compare_compares_two_runs_and_refuses_a_missing_one(tmp_path: Path) -> None:
    done = made("compare", "A=results/reference", "B=results/reference", f"OUT={tmp_path}")
    assert done.returncode == 0, done.stderr
    assert "no difference" in done.stdout
    assert (tmp_path / "comparison.html").is_file()
    missing = made("compare", "A=results/reference")
    assert missing.returncode != 0
    assert "make compare A=results/<run> B=results/<run>" in missing.stderr


def test_the_figures_below_the_picture_are_those_of_the_reference_run() -> None:
    run = Run.open(ROOT / "results" / "reference")
    found = like_with_like(Measurements.of(run))
    for lane, word in ((Lane.KERNEL, "compiled"), (Lane.DIRECT, "from Python")):
        of_size = found[(found.lane == lane) & (found.d == 18)].set_index("timed")
        hot, turns = of_size.loc[["hot"]].iloc[0], of_size.loc[["interleaved"]].iloc[0]  # the best of the others
        cells = (
            word,
            f"{hot.ours} {number(hot.ours_us)} µs",
            f"{hot.other} {number(hot.other_us)} µs",
            f"{hot.ratio:.2f}",
            f"{turns.ratio:.2f}",
        )
        assert f"| {' | '.join(cells)} |" in README.read_text(encoding="utf-8")
    assert f"on one core with {run.settings['machine']['core'].partition(',')[0]}:" in README.read_text(
        encoding="utf-8"
    )


def test_the_answer_above_the_picture_is_that_of_the_reference_run() -> None:
    found, text = Measurements.of(Run.open(ROOT / "results" / "reference")), " ".join(README.read_text("utf-8").split())
    lines = {(line.solver, line.lane): line.results[Tier.HIGH] for line in ranking(found) if Tier.HIGH in line.results}
    direct = {solver: result for (solver, lane), result in lines.items() if lane == Lane.DIRECT and solver in KNOWN}
    by_time = sorted((result.us, solver) for solver, result in direct.items() if result.reached)
    assert joined(f"{solver} {rounded(us, 0.05)} µs" for us, solver in by_time) in text
    assert {solver: result.right for solver, result in direct.items() if not result.reached} == {
        "clarabel": 17,
        "piqp": 17,
    }
    assert f"{rounded(lines['box_active_set', Lane.DIRECT].us, 0.05)} µs from Python and 0.73 µs compiled" in text
    verdict = " ".join((ROOT / "results/reference/report.md").read_text("utf-8").split())
    for words in ("1e-9 on 5 of 18 problems", "begun at the straight line, 1e-9 on 10", "on 6 of 18 problems, smaller"):
        assert words in verdict
