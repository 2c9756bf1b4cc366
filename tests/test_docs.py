"""The README, the pages in docs/ and the docstrings match the program: their examples run, and their words, figures and
tables are compared with it. Fenced blocks of a page:

```sh        commands, each a process that must succeed; ``sh fails``: each must be refused
```python    executed, all blocks of a page in one namespace; ``python title="x.py"``: written to that file instead
```text      expected output of the block before
"""

import contextlib
import doctest
import importlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer
from command_line import CommandLine, Finished
from programs import library, program

from bench.cli.app import command_line
from bench.derived.measurements import Measurements
from bench.derived.ranking import like_with_like, ranking
from bench.messages.task import Status, Tier
from bench.race_table import COLUMNS
from bench.report.words import joined, marked, number, rounded
from bench.store import Run
from piezo_model import ModelStructure, SelfLearningCompensator, plants
from piezo_model.learning.events import Phase
from piezo_model.recordings import write_table
from piezo_model.signals import decaying_triangle, multi_sine
from solvers import Lane

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
LONG_PAGES = {
    "adding-problems",
    "commands",
    "reading-the-report",
    "tutorial-live",
    "tutorial-scanner",
    "tutorial-solver-author",
    "what-to-record",
}
"""Pages whose commands take over five seconds."""
READING = (ROOT / "docs" / "reading-the-report.md").read_text(encoding="utf-8")
LEARNING = ROOT / "docs" / "learning.md"
PLANT = plants.get("relay_preisach", sample_time=1e-3)
STRUCTURE = ModelStructure.equidistant(
    n=2, m=1, x_range=PLANT.x_range, y_range=PLANT.y_range, creep_rates=(), sample_time=1e-3
)
Steps = set[tuple[str, str]]


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the rest of the fence's line, and its text."""

    language: str
    rest: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """Blocks of a page in order; those in a list are indented."""
    for found in re.finditer(
        r"^( *)```(\w+) *(.*?)\n(.*?)^\1```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    ):
        yield Block(found[2], found[3], re.sub(rf"^{found[1]}", "", found[4], flags=re.MULTILINE))


def commands(text: str) -> list[list[str]]:
    """Words of each line, without comments."""
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


def lay_out(folder: Path) -> None:
    """Write the files that the pages assume: two recordings of a simulated actuator and a reference."""
    plant = plants.get("relay_preisach", sample_time=1e-3)
    for name, x in (
        ("another.csv", decaying_triangle(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0)),
        ("stage.csv", multi_sine(duration_s=6.0, sample_time=1e-3, low=0.0, high=150.0, highest_Hz=10.0)),
    ):
        plant.reset()
        y = plant.run(x)
        write_table(folder / name, {"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": y})
    y_ref = decaying_triangle(duration_s=2.0, sample_time=1e-3, low=float(y.min()), high=float(y.max()))
    write_table(folder / "reference.csv", {"time_s": np.arange(y_ref.size) * 1e-3, "reference_um": y_ref})


def called(words: list[str], folder: Path, piezobench: CommandLine, refused: bool = False) -> str:
    """Output of a command, which must succeed, or be refused in one sentence."""
    if words[0] == "piezobench":
        done = piezobench(*words[1:], folder=folder)
    else:
        if words[0] == "make":
            program("cc")  # to compile what was exported
        environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        other = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        done = Finished(other.returncode, other.stdout, other.stderr)
    assert done.status == (2 if refused else 0), (words, done.status, done.stdout, done.stderr)
    assert not refused or done.stderr.count("\n") == 1
    return done.stdout


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with the files that the examples take."""
    monkeypatch.chdir(tmp_path)
    lay_out(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow) if page.stem in LONG_PAGES else page for page in PAGES],
    ids=lambda page: page.stem,
)
def test_the_examples_of_a_page_run_and_print_what_it_shows(page: Path, folder: Path, piezobench: CommandLine) -> None:
    names: dict[str, object] = {"__name__": "__main__"}
    printed = ""
    for block in blocks(page):
        if block.language == "sh":
            printed = "".join(
                called(words, folder, piezobench, refused=block.rest == "fails") for words in commands(block.text)
            )
        elif block.language == "python" and block.rest:
            (folder / re.sub(r'title="(.*)"', r"\1", block.rest)).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(compile(block.text, str(page), "exec"), names)
            printed = out.getvalue()
        elif block.language == "text":
            assert printed.rstrip() == block.text.rstrip(), page.name


def included(found: re.Match[str]) -> str:
    """The text that a page has from another file, as a whole or from one of its marks to the next."""
    text = (ROOT / found[1]).read_text(encoding="utf-8")
    return text.partition(f"[start:{found[2]}]")[2].partition(f"[end:{found[2]}]")[0] if found[2] else text


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_links_lead_to_existing_files(page: Path) -> None:
    text = re.sub(r'--8<-- "([^":]+):?(\w*)"', included, page.read_text(encoding="utf-8"))
    links = {link: page.parent / link for link in re.findall(r"\]\(([^)#:]+\.\w+)(?:#\S*)?\)", text)}
    assert [link for link, path in links.items() if not path.exists()] == []


def test_the_page_on_the_report_explains_every_status_lane_and_tier_and_names_existing_headings() -> None:
    assert [word for word in (*Status, *Lane, *Tier) if f"`{word}`" not in READING] == []
    for heading in ("lane", "tier", "worst gap", "right", "periods"):
        assert heading in {column.heading for column in COLUMNS}
        assert re.search(rf"^\| [^|]*\b{heading}\b", READING, flags=re.MULTILINE), heading


def test_the_figures_on_the_first_page_are_those_of_the_reference_run_and_of_the_page_on_learning() -> None:
    measured = (ROOT / "results" / "reference" / "report.md").read_text(encoding="utf-8") + LEARNING.read_text(
        encoding="utf-8"
    )
    figures = re.findall(r"\*\*(\d.*?)\*\*", (ROOT / "docs" / "index.md").read_text(encoding="utf-8"))
    assert [figure in measured for figure in figures] == [True] * 4, figures


@pytest.mark.slow
def test_the_workflow_of_a_solvers_author_fails_when_the_solver_takes_more_time_or_is_wrong(
    tmp_path: Path, piezobench: CommandLine
) -> None:
    texts = {block.rest: block.text for block in blocks(ROOT / "docs" / "tutorial-solver-author.md")}
    source, workflow = texts['title="my_solver.py"'], texts['title=".github/workflows/solver.yml"']
    race, compare = re.findall(r"- run: piezobench (.*)", workflow)
    for name in ("my_solver.py", "baseline.py"):
        (tmp_path / name).write_text(source)
    assert piezobench(*compare.split(), folder=tmp_path).status == 0
    slower = "return self._solve() if self._solve() is None else self._solve()"
    (tmp_path / "my_solver.py").write_text(
        source.replace(
            "def solve(self, warm_start=None):",
            f"def solve(self, warm_start=None):\n        {slower}\n\n    def _solve(self):",
        )
    )
    assert piezobench(*compare.split(), folder=tmp_path).status == 3
    for name, answer in (("right", "x"), ("off", "x * (1.0 + 1e-4)"), ("nan", "np.full_like(x, np.nan)")):
        (tmp_path / "my_solver.py").write_text(source.replace("        return x\n", f"        return {answer}\n"))
        words = (*race.split(), "--solver", "projected_difference", "--name", name)  # which errs, and is not theirs
        for call in (words, ("report", f"results/{name}")):
            done = piezobench(*call, folder=tmp_path)
            is_named = done.stdout.splitlines()[-1].startswith("Wrong: my_solver (direct) ")
            assert (done.status, is_named) == ((0, False) if name == "right" else (1, True))


def test_the_defect_that_the_page_on_certificates_names_is_there(capfd: pytest.CaptureFixture[str]) -> None:
    library("casadi")
    page = (ROOT / "docs" / "certificates.md").read_text(encoding="utf-8")
    (source,) = re.findall(r'^``` title="upper_bound.py"\n(.*?)^```', page, re.DOTALL | re.MULTILINE)
    exec(compile(source, "upper_bound.py", "exec"), {})
    assert capfd.readouterr().out.strip().endswith("\n2 Successful return.")


def documented(which: int) -> Steps:
    """Transitions of a state machine on the page, by its number."""
    table = re.findall(r"^\| from \|.*\n.*\n((?:\|.*\n)+)", LEARNING.read_text(encoding="utf-8"), flags=re.MULTILINE)[
        which
    ]
    return set(re.findall(r"^\| `?(\w+)`? \| `(\w+)` \|", table, flags=re.MULTILINE))


def taken(learner: SelfLearningCompensator, actuator: Callable[[int, float], float], samples: int = 1500) -> Steps:
    """Transitions that a learner takes with an actuator, starting with the first phase."""
    steps, x = {("start", str(learner.phase))}, float("nan")
    for k in range(samples):
        before, x = learner.phase, learner.step(15.0 * np.sin(0.03 * k), actuator(k, x))
        if learner.phase is not before:
            steps.add((str(before), str(learner.phase)))
    return steps


def honest(k: int, x: float) -> float:
    """Output of the actuator."""
    return PLANT.step(x) if np.isfinite(x) else float("nan")


def failing(learner: SelfLearningCompensator, phase: Phase) -> Callable[[int, float], float]:
    """A sensor that is out of range at every 50th sample while the learner is in the phase."""
    return lambda k, x: 1e3 if learner.phase is phase and k % 50 == 0 else honest(k, x)


def cyclic(**options: object) -> SelfLearningCompensator:
    return SelfLearningCompensator(
        STRUCTURE, **{"reset_s": 0.02, "build_s": 0.4, "learn_s": 0.05, "solver": "projected_difference", **options}
    )


def test_the_state_machine_on_the_page_is_that_of_the_learner() -> None:
    steps = taken(cyclic(), lambda k, x: 0.001 * (k % 2))
    for solver in ("projected_difference", "scipy_nnls", "box_active_set"):
        steps |= taken(cyclic(solver=solver), honest)
    for phase in Phase:
        learner = cyclic()
        steps |= taken(learner, failing(learner, phase))
    assert steps == documented(0)
    assert {name for step in steps for name in step} == {"start", *Phase}
    assert [str(phase) for phase in Phase] == re.findall(
        r"^\| `(\w+)` \| [^`]", LEARNING.read_text(encoding="utf-8"), flags=re.MULTILINE
    )


def test_the_state_machine_on_the_page_of_continuous_operation_is_that_of_the_learner() -> None:
    learner = SelfLearningCompensator(STRUCTURE, reset_s=0.02, mode="continuous")
    assert taken(learner, failing(learner, Phase.LEARN)) == documented(1)


README = ROOT / "README.md"


@pytest.mark.usefixtures("folder")
def test_the_python_example_runs() -> None:
    (text,), names = (
        [block.text for block in blocks(README) if block.language == "python"],
        dict[str, object](),
    )
    exec(compile(text, "README.md", "exec"), names)
    assert np.all(np.isfinite(names["drive"]))


@pytest.mark.needs("cc")
def test_the_commands_from_a_recording_to_a_controller_work_as_printed(folder: Path, piezobench: CommandLine) -> None:
    shutil.copytree(ROOT / "results" / "reference", folder / "results" / "reference")
    (block,) = [block for block in blocks(README) if block.language == "sh" and "deploy" in block.text]
    for words in commands(block.text):
        if words[1] not in ("realtime", "experiment", "live"):  # half a minute each, and run by tests of their own
            output = called(words, folder, piezobench)
            assert words[1] != "deploy" or "Model: from model.json." in output
    assert (folder / "drive.csv").read_text().startswith("time_s,drive_V")
    assert [name for name in ("stage.html", "controller/Makefile", "stage.fmu") if not (folder / name).is_file()] == []


OF_OTHERS = {"--depth", "--help", "--hypothesis-profile", "--package", "--quick", "--situations", "--tosses"}
"""Options that pages name of git, pytest, scripts, every verb, and the race that a page adds."""


def test_every_verb_and_option_that_a_page_names_exists() -> None:
    command = typer.main.get_command(command_line())
    assert isinstance(command, typer.core.TyperGroup)
    parameters = [parameter for verb in command.commands.values() for parameter in verb.params]
    known = {option for each in parameters for option in (*each.opts, *each.secondary_opts)}
    named = set[str]()
    for page in (*(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY", "CHANGELOG")), *PAGES):
        text = page.read_text(encoding="utf-8")
        named |= {*re.findall(r"(?:`|^|run: )piezobench ([a-z][a-z-]*)", text, re.MULTILINE)}
        assert {*re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)} <= known | OF_OTHERS, page.name
    assert {"race", "compare", "deploy", "identify", "export-c"} <= named <= {*command.commands}


def made(*words: str) -> subprocess.CompletedProcess[str]:
    """Run make with the current Python in place of the environment that it would set up."""
    return subprocess.run(
        ["make", "--no-print-directory", "--old-file=.venv/.field", f"BIN={Path(sys.executable).parent}", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_make_help_lists_every_target_and_those_that_the_readme_shows_exist() -> None:
    targets = {*re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)}
    assert {line.split()[0] for line in made("help").stdout.splitlines()} == targets
    assert {*re.findall(r"make ([a-z]+)", README.read_text(encoding="utf-8"))} <= targets


@pytest.mark.slow
def test_make_compare_compares_two_runs_and_refuses_a_missing_one(tmp_path: Path) -> None:
    done = made("compare", "A=results/reference", "B=results/reference", f"OUT={tmp_path}")
    assert (done.returncode, "no difference" in done.stdout) == (0, True), done.stderr
    assert (tmp_path / "comparison.html").is_file()
    missing = made("compare", "A=results/reference")
    assert (missing.returncode, "make compare A=results/<run> B=results/<run>" in missing.stderr) == (2, True)


def test_the_figures_below_the_picture_are_those_of_the_reference_run() -> None:
    run = Run.open(ROOT / "results" / "reference")
    found = like_with_like(Measurements.of(run))
    for lane, word in ((Lane.KERNEL, "compiled"), (Lane.DIRECT, "from Python")):
        of_size = found[(found.lane == lane) & (found.d == 18)].set_index("timed")
        hot, turns = of_size.loc[["hot"]].iloc[0], of_size.loc[["interleaved"]].iloc[0]  # the best of the others
        cells = (
            word,
            f"{marked(hot.ours)} {number(hot.ours_us)} µs",
            f"{hot.other} {number(hot.other_us)} µs",
            f"{hot.ratio:.2f}",
            f"{turns.ratio:.2f}",
        )
        assert f"| {' | '.join(cells)} |" in README.read_text(encoding="utf-8")
    assert f"on one core with {run.machine_of(run.rows())['core'].partition(',')[0]}:" in README.read_text("utf-8")


def test_the_answer_above_the_picture_is_that_of_the_reference_run() -> None:
    found, text = Measurements.of(Run.open(ROOT / "results" / "reference")), " ".join(README.read_text("utf-8").split())
    lines = {(line.solver, line.lane): line.results[Tier.HIGH] for line in ranking(found) if Tier.HIGH in line.results}
    known = ("osqp", "clarabel", "proxsuite", "piqp", "highspy", "scs", "qpalm", "daqp", "quadprog", "cvxopt")
    direct = {solver: lines[solver, Lane.DIRECT] for solver in known}
    by_time = sorted((result.us, solver) for solver, result in direct.items() if result.reached)
    assert joined(f"{solver} {rounded(us, 0.05)} µs" for us, solver in by_time) in text
    assert {solver: result.right for solver, result in direct.items() if not result.reached} == {
        "clarabel": 16,
        "piqp": 16,
    }
    ours = [rounded(lines["box_active_set", lane].us, 0.05) for lane in (Lane.DIRECT, Lane.KERNEL)]
    assert f"{ours[0]} µs from Python and {ours[1]} µs compiled" in text
    assert lines["projected_difference", Lane.KERNEL].right == 8
    verdict = " ".join((ROOT / "results/reference/report.md").read_text("utf-8").split())
    for words in ("1e-9 on 5 of 18 problems", "on 6 of 18 problems, smaller"):
        assert words in verdict


FILES = [
    path.relative_to(ROOT)
    for folder in ("solvers", "piezo_model", "bench", "examples/adapters", "examples/paper")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("path", FILES, ids=str)
def test_the_examples_of_a_file_print_what_they_show(path: Path) -> None:
    name = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    if path.parts[0] == "examples":
        library({"control_systems": "control", "hysteresis_regressor": "sklearn"}.get(name := path.stem, name))
    found = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > found.failed == 0
