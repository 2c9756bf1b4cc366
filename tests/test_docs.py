"""The pages in docs/ match the program: their examples run, and their words and tables are compared with it."""

import re
from collections.abc import Callable
from pathlib import Path

import documents
import numpy as np
import pytest
from command_line import CommandLine

from bench.messages.verdict import Status, Tier
from bench.races.oneshot.report import HEADINGS
from piezo_model import ModelStructure, SelfLearningCompensator, plants
from piezo_model.learning.events import Phase
from solvers import Lane

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
LONG_PAGES = {"commands", "tutorial-live"}
"""Pages whose commands take over twenty seconds."""
READING = (ROOT / "docs" / "reading-the-report.md").read_text(encoding="utf-8")
LEARNING = ROOT / "docs" / "learning.md"
PLANT = plants.get("relay_preisach", sample_time=1e-3)
STRUCTURE = ModelStructure.equidistant(
    n=2, m=1, x_range=PLANT.x_range, y_range=PLANT.y_range, creep_rates=(), sample_time=1e-3
)
Steps = set[tuple[str, str]]


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow) if page.stem in LONG_PAGES else page for page in PAGES],
    ids=lambda page: page.stem,
)
def test_the_examples_of_a_page_run_and_print_what_it_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piezobench: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    documents.lay_out(tmp_path)
    documents.run(page, tmp_path, piezobench)


def included(found: re.Match[str]) -> str:
    """The text that a page has from another file, as a whole or from one of its marks to the next."""
    text = (ROOT / found[1]).read_text(encoding="utf-8")
    return text.partition(f"[start:{found[2]}]")[2].partition(f"[end:{found[2]}]")[0] if found[2] else text


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_links_lead_to_existing_files(page: Path) -> None:
    text = re.sub(r'--8<-- "([^":]+):?(\w*)"', included, page.read_text(encoding="utf-8"))
    for link in re.findall(r"\]\(([^)#:]+\.\w+)(?:#\S*)?\)", text):
        assert (page.parent / link).exists(), link


def test_the_page_on_the_report_explains_every_status_lane_and_tier_and_names_existing_headings() -> None:
    for word in (*Status, *Lane, *Tier):
        assert f"`{word}`" in READING, word
    for heading in ("lane", "tier", "worst cost gap", "right", "periods"):
        assert heading in HEADINGS.values()
        assert re.search(rf"^\| [^|]*\b{heading}\b", READING, flags=re.MULTILINE), heading


def test_the_figures_on_the_first_page_are_those_of_the_reference_run_and_of_the_page_on_learning() -> None:
    measured = (ROOT / "results" / "reference" / "report.md").read_text(encoding="utf-8") + LEARNING.read_text(
        encoding="utf-8"
    )
    figures = re.findall(r"\*\*(\d.*?)\*\*", (ROOT / "docs" / "index.md").read_text(encoding="utf-8"))
    assert len(figures) == 4
    assert all(figure in measured for figure in figures), figures


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
    steps = taken(cyclic(), honest) | taken(cyclic(solver="scipy_nnls"), honest)
    for phase in Phase:
        learner = cyclic()
        steps |= taken(learner, failing(learner, phase))
    still = cyclic()
    steps |= taken(still, lambda k, x: 0.001 * (k % 2)) | taken(cyclic(solver="box_active_set"), honest)
    assert steps == documented(0)
    assert {name for step in steps for name in step} == {"start", *Phase}
    table = re.findall(r"^\| `(\w+)` \| [^`]", LEARNING.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert table == [str(phase) for phase in Phase]


def test_the_state_machine_on_the_page_of_continuous_operation_is_that_of_the_learner() -> None:
    learner = SelfLearningCompensator(STRUCTURE, reset_s=0.02, mode="continuous")
    assert taken(learner, failing(learner, Phase.LEARN)) == documented(1)
