"""The exported C on a schedule, counted instruction by instruction, and on an emulated controller."""

import json
import os
import resource
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from exported_loops import LIMITS, a_model, compensation
from programs import program

from bench.export import building, cortex_m
from bench.export.building import instructions_per_step, write_sources
from bench.export.cortex_m import CORES, controller_cost, cross_build, instructions
from bench.export.realtime import RealTime, highest, histogram
from bench.export.settings import ExportError, ExportSettings
from bench.export.step_cost import in_blocks, loop_samples, shortened, step_cost
from piezo_model import HysteresisCreepModel

LOOP = ExportSettings(part="learning", solver="recursive_active_set")
NOBODY = 65534

needs_arm = pytest.mark.needs(cortex_m.COMPILER, cortex_m.EMULATOR)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("desk") / "model.json"
    a_model().save(path)
    return path


# The schedule.


@pytest.mark.needs("cc")
def test_a_run_is_told_in_tables_and_in_json(piezobench: CommandLine, model_file: Path, tmp_path: Path) -> None:
    words = ("realtime", model_file, "--rate", 2000, "--seconds", 0.3, "--no-cost")
    shown = piezobench(*words, "--out", tmp_path / "figures.json")
    assert shown.status == 0, shown.stderr
    assert "of 600 deadlines at 2000 Hz missed; of a step that does nothing" in shown.stdout
    written = json.loads((tmp_path / "figures.json").read_text())
    for what, said in (("memory", "locking memory"), ("fifo", "SCHED_FIFO"), ("core", "pinning to a core")):
        assert (written["allowed"][what] == "yes") == (f"Without {said}" not in shown.stdout)
    printed = json.loads(piezobench(*words, "--json").stdout)
    for figures in (written, printed):
        assert figures["samples"] == 600
        assert figures["highest_rate_Hz"] is figures["cost"] is None
        assert list(figures["histograms_us"]) == ["wake-up", "service", "response", "null response"]
        assert all(sum(counts.values()) == 600 for counts in figures["histograms_us"].values())
        for tail in figures["us"].values():
            assert tail["p50"] <= tail["p99"] <= tail["max"]
            assert tail["p99.99"] is None  # 600 samples cannot support it


@pytest.mark.slow
@pytest.mark.needs("cc")
def test_a_paced_run_has_a_response_no_shorter_than_its_service() -> None:
    with RealTime(a_model(), LOOP, priority=0) as machine:
        paced, null = machine.run(1000.0, 0.1), machine.run(1000.0, 0.1, null=True)
    assert paced.response_ns.size == null.response_ns.size == 100
    assert np.all(paced.wake_ns >= 0)
    assert np.array_equal(paced.wake_ns + paced.service_ns, paced.response_ns)
    assert paced.missed == np.count_nonzero(paced.response_ns > 1e6)
    assert paced.met == 1.0 - paced.missed / 100
    assert paced.allowed["fifo"] == "not asked for"
    assert sum(histogram(paced.response_ns).values()) == 100


@pytest.mark.slow
@pytest.mark.needs("cc")
def test_a_rate_that_no_step_can_hold_misses_deadlines() -> None:
    with RealTime(a_model(20, 9), LOOP) as machine:
        hurried = machine.run(1e6, 0.02)
    assert hurried.missed > 0.9 * hurried.response_ns.size
    assert hurried.response_ns[-1] > hurried.response_ns[0]  # late ones are not left out: the delay adds up


def test_what_the_system_does_not_allow_is_said(tmp_path: Path) -> None:
    write_sources(tmp_path, a_model(), ExportSettings())
    built = building.build(tmp_path, "loop", program("gcc"), ("-O2",))

    def without_rights() -> None:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))

    descriptor = os.open(built, os.O_RDONLY)  # whoever it runs as need not see the folder
    try:
        done = subprocess.run(
            [f"/proc/self/fd/{descriptor}", "1000", "0.05", "80", "4000", "/dev/null"],
            pass_fds=[descriptor],
            user=NOBODY if os.geteuid() == 0 else None,
            preexec_fn=without_rights,
            capture_output=True,
            text=True,
            check=True,
        )
    finally:
        os.close(descriptor)
    allowed = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert allowed["fifo"] == "Operation not permitted"
    assert allowed["memory"] != "yes"
    assert allowed["core"] == "Invalid argument"  # there is no core 4000


@pytest.mark.parametrize(
    ("limit", "found"), [(50e3, 45255.0), (8000.0, 8000.0), (3000.0, 2828.43), (2e6, 861078.0), (100.0, 0.0)]
)
def test_the_highest_rate_is_found_to_a_quarter_of_an_octave(limit: float, found: float) -> None:
    tried: list[float] = []

    def holds(rate: float) -> bool:
        tried.append(rate)
        return rate <= limit

    assert highest(holds, 8000.0) == pytest.approx(found, rel=1e-4)
    assert all(500.0 <= rate <= 1e6 for rate in tried)
    assert len(tried) == len(set(tried)) < 20


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing.json"], "nothing.json: there is no such file"),
        (["model.json", "--rate", 0], "--rate"),
        (["model.json", "--seconds", "nan"], "--seconds"),
        pytest.param(
            ["model.json", "--rate", 1, "--seconds", 0.5],
            "0.5 s at 1 Hz hold no sample; the shortest run is 1 s",
            marks=pytest.mark.needs("cc"),
        ),
        (["model.json", "--solver", "box_active_set"], "--solver: is for --part learning"),
        (["model.json", "--priority", 100], "--priority"),
        (["model.json", "--core", -1], "--core"),
        (["model.json", "--out", "nowhere/figures.json"], "the folder nowhere does not exist"),
    ],
    ids=str,
)
def test_bad_input_is_refused_in_one_sentence(
    piezobench: CommandLine, model_file: Path, words: list[object], said: str
) -> None:
    assert said in piezobench("realtime", *words, folder=model_file.parent).refusal
    assert list(model_file.parent.iterdir()) == [model_file]


# What a step costs.


@pytest.mark.needs("valgrind")
def test_callgrind_counts_the_instructions_of_a_step(tmp_path: Path) -> None:
    write_sources(tmp_path, a_model(), ExportSettings())
    built = building.build(tmp_path, "replay", program("gcc"), building.COUNTABLE)
    few, more = (instructions_per_step(built, np.linspace(-5.0, 5.0, count)) for count in (1000, 2000))
    assert 100.0 < few < 1000.0
    assert few == pytest.approx(more, rel=0.02)


def test_a_shortened_cycle_keeps_its_proportions_and_its_reset() -> None:
    model = a_model()
    numbers = shortened(model, ExportSettings(part="learning"), 8000).numbers(model.structure)
    assert [numbers[f"{phase}_lasts"] for phase in ("reset", "build", "learn")] == [80, 6400, 1520]


def test_a_cycle_in_blocks_has_those_of_the_settings() -> None:
    model, settings = a_model(), ExportSettings(part="learning")
    numbers = in_blocks(model, settings, shortened(model, settings, 256)).numbers(model.structure)
    assert numbers["block"] == settings.numbers(model.structure)["block"] == 32
    assert [numbers[f"{phase}_lasts"] for phase in ("reset", "build", "learn")] == [32, 192, 64]


def test_without_valgrind_and_cross_compiler_their_part_is_left_out_and_said(
    piezobench: CommandLine, model_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("gcc", "as", "ld"):
        (tmp_path / name).symlink_to(program(name))
    monkeypatch.setenv("PATH", str(tmp_path))
    cost = step_cost(a_model(), ExportSettings(), repetitions=1)
    assert cost.ns > 0.0
    assert cost.instructions is None
    assert cost.controllers == ()
    assert [sentence.partition(": ")[0] for sentence in cost.absent] == [
        "Instructions here were not counted",
        "Cortex-M4F was left out",
        "Cortex-M7 was left out",
    ]
    assert "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi" in cost.absent[1]
    monkeypatch.setenv("PATH", str(tmp_path / "nowhere"))
    with pytest.raises(ExportError, match="there is no cc or gcc or clang on this machine"):
        RealTime(a_model(), ExportSettings())


# Controllers.


def emulate(image: Path, samples: np.ndarray) -> np.ndarray:
    """Drives (N,) for samples, (N,) or (N, 2) as of `building.replay`, by an emulated controller."""
    return np.frombuffer(
        subprocess.run(
            [cortex_m.EMULATOR, "-cpu", "max", str(image)],
            input=np.ascontiguousarray(samples).tobytes(),
            capture_output=True,
            check=True,
        ).stdout
    )


@needs_arm
@pytest.mark.parametrize("core", CORES, ids=lambda core: core.name)
def test_a_controller_computes_the_drives_of_python(tmp_path: Path, core: cortex_m.Core) -> None:
    said = compensation(8000)
    x = emulate(cross_build(tmp_path, said.model, said.settings, core), said.samples)
    np.testing.assert_array_equal(x, said.x)


@pytest.mark.slow
@needs_arm
@pytest.mark.parametrize("solver", ["projected_difference", "recursive_active_set"])
def test_a_controller_learns_to_the_last_bit_what_this_machine_learns(tmp_path: Path, solver: str) -> None:
    structure = a_model().structure
    model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
    settings = shortened(model, ExportSettings(part="learning", solver=solver), 800)
    samples = loop_samples(a_model(seed=4), settings, 1800)
    write_sources(tmp_path, model, settings)
    here = building.replay(building.build(tmp_path, "replay", program("gcc"), (*building.EXACT, "-O2")), samples)
    assert here.events[0] + here.events[1] > 0  # weights were learned and judged
    np.testing.assert_array_equal(emulate(cross_build(tmp_path, model, settings, CORES[1]), samples), here.x)


@pytest.mark.slow
@needs_arm
def test_single_precision_costs_a_controller_without_double_arithmetic_less(tmp_path: Path) -> None:
    model, found = a_model(), {}
    for precision in ("double", "float"):
        settings = ExportSettings(precision=precision, x_limits=LIMITS)
        found[precision] = controller_cost(tmp_path, model, settings, CORES[0], loop_samples(model, settings, 60))
    step = {name: each.step for name, each in found.items()}
    assert step["float"].calls == 60
    assert step["float"].median <= step["float"].largest < 0.2 * step["double"].median
    assert found["float"].learn.calls == 0
    assert found["float"].flash_bytes < found["double"].flash_bytes < 16_384
    assert found["float"].ram_bytes < found["double"].ram_bytes < 2048


@needs_arm
def test_the_list_of_instructions_ends_where_there_are_enough(tmp_path: Path) -> None:
    model, settings = a_model(), ExportSettings()
    image, samples = cross_build(tmp_path, model, settings, CORES[1]), loop_samples(model, settings, 50)
    (whole, _), (part, _) = instructions(image, samples), instructions(image, samples, enough=20_000)
    assert whole.size == 50
    assert 5 < part.size < 20
    np.testing.assert_array_equal(part, whole[: part.size])
