"""The exported C against Python: the same bits from every compiler, and files that build without this package."""

import re
import subprocess
from dataclasses import replace
from graphlib import TopologicalSorter
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from exported_loops import (
    DYNAMICS,
    LIMITS,
    LOOPS,
    MILLION,
    SAMPLE_TIME,
    SHORT,
    Expected,
    Stage,
    a_model,
    build,
    compensation,
    learning,
    loop_of,
    references,
    replay,
    write_sources,
)
from programs import program

from bench.cli.export_verbs import _opened
from bench.deploy.deployment import Deployment
from bench.export.building import EXACT, WARNINGS
from bench.export.c_source import FLOAT_BOUND, export
from bench.export.settings import ExportError, ExportSettings, Precision, initialiser, literal
from piezo_model import Compensator, Dynamics, HysteresisCreepModel
from piezo_model.recordings import write_table
from piezo_model.signals import multi_sine

COMPILERS, LEVELS = ("gcc", "clang"), ("-O0", "-O1", "-O2", "-O3")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FLOAT_LOOP_BOUND = 1e-4
"""Normalised units."""
FAULTY = "projected_difference, faulty sensor", "continuous, faulty sensor"
INTEGRAL = (
    "projected_difference, faulty sensor, integral action",
    ("continuous, faulty sensor, integral action"),
)
RINGING = "compensator, ringing", "projected_difference, ringing", "continuous, faulty sensor, integral action, ringing"
FALLING = "box_active_set, falling", "continuous, falling"
DESCENDING = "box_active_set, falling, descending range", "continuous, falling, descending range"
KINDS = ("compensator", *LOOPS, *FAULTY, *INTEGRAL, *RINGING, *FALLING, *DESCENDING)
NIGHTLY = pytest.mark.nightly


def expected_of(kind: str, size: int = SHORT) -> Expected:
    """Drives that Python computes."""
    solver, dynamics = kind.partition(", ")[0], DYNAMICS if "ringing" in kind else None
    if solver == "compensator":
        return compensation(size, dynamics)
    return learning(
        solver,
        size,
        "faulty" in kind,
        integral_gain=1000.0 * ("integral" in kind),
        gain=-1.0 if "falling" in kind else 1.0,
        structure=a_model().structure.reversed_output() if "descending" in kind else None,
        dynamics=dynamics,
    )


def replayed(
    folder: Path, model: HysteresisCreepModel, settings: ExportSettings, samples: np.ndarray, *words: str
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Drives and events of the replay program, built without a warning with a compiler and its flags."""
    write_sources(folder, model, settings)
    return replay(build(folder, "replay.c", words[0], *WARNINGS, *EXACT, *words[1:]), samples)


# The same numbers.


def compare(folder: Path, expected: Expected, compiler: str, flags: tuple[str, ...]) -> tuple[int, ...]:
    """Drives are equal to the last bit, and so are the counts of events."""
    x, events = replayed(folder, expected.model, expected.settings, expected.samples, compiler, *flags)
    np.testing.assert_array_equal(x, expected.x, str((compiler, *flags)))
    assert events[:2] == expected.events
    assert not any(events[4:]), "the learner was never late"
    assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))
    return events


@pytest.mark.sample(1)
@pytest.mark.parametrize(("kind", "way"), [*zip(KINDS, cycle(product(COMPILERS, LEVELS)), strict=False)], ids=str)
def test_the_exported_c_gives_pythons_drive_to_the_last_bit_with_every_compiler_and_level(
    tmp_path: Path, kind: str, way: tuple[str, str]
) -> None:
    events = compare(tmp_path, expected_of(kind), *way[:1], way[1:])
    if kind in FAULTY:
        compare(tmp_path, expected_of(kind), "clang", ("-O3", "-march=native"))
    if not kind.startswith("compensator"):
        assert (events[0] > 0, events[3]) == (kind not in FALLING, 0)
        assert (events[1] > 0) or kind not in FALLING
        assert events[2] >= 2 * ("faulty" in kind)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "size", "compiler", "flags"),
    [
        *(
            pytest.param(
                kind, SHORT, "gcc", ("-O1", *SANITIZED), marks=() if kind in ("compensator", INTEGRAL[1]) else NIGHTLY
            )
            for kind in KINDS
        ),
        *(
            pytest.param(kind, MILLION, compiler, (level, "-march=native"), marks=NIGHTLY)
            for kind, compiler, level in product(KINDS, COMPILERS, LEVELS)
        ),
    ],
    ids=str,
)
def test_the_drives_are_the_same_with_sanitizers_and_over_a_million_samples(
    tmp_path: Path, kind: str, size: int, compiler: str, flags: tuple[str, ...]
) -> None:
    compare(tmp_path, expected_of(kind, size), compiler, flags)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("kind", "bound"),
    [
        ("compensator", FLOAT_BOUND),
        (RINGING[0], FLOAT_BOUND),
        ("projected_difference", FLOAT_LOOP_BOUND),
        ("continuous", FLOAT_LOOP_BOUND),
        (RINGING[2], FLOAT_LOOP_BOUND),
    ],
)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("size", [SHORT, pytest.param(MILLION, marks=NIGHTLY)])
def test_single_precision_stays_within_its_stated_bound(
    tmp_path: Path, size: int, compiler: str, kind: str, bound: float
) -> None:
    expected = expected_of(kind, size)
    settings = replace(expected.settings, precision="float")
    x, _ = replayed(tmp_path, expected.model, settings, expected.samples, compiler, "-O2")
    assert 0.0 < np.max(np.abs(x - expected.x)) / expected.model.structure.x_scale <= bound
    assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))


SHAPES: tuple[tuple[dict[str, object], dict[str, object]], ...] = (
    ({"n": 0, "m": 0, "rates": ()}, {}),
    ({"n": 20, "m": 9, "rates": (1.0,), "offset": True}, {}),
    ({"n": 7, "m": 4, "rates": (1.0, 2.0, 3.0, 4.0)}, {"rate_limit": 1e4}),
    ({"n": 8, "m": 0, "rates": (), "offset": True}, {"name": "left_axis"}),
)
PARTS = tuple(product((None, *LOOPS), ("double", "float")))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("shape", "settings", "solver", "precision"),
    [
        pytest.param(*shape, *part, marks=() if k in (0, i + 1, i + 2) else NIGHTLY)
        for i, shape in enumerate(SHAPES)
        for k, part in enumerate(PARTS)
    ],
    ids=str,
)
def test_every_shape_of_model_builds_and_fits_its_memory(
    tmp_path: Path, shape: dict[str, object], settings: dict[str, object], solver: str | None, precision: str
) -> None:
    model, y_ref = a_model(**shape), references(500)
    loop = {} if solver is None else {"part": "learning", **loop_of(solver)}
    samples = np.column_stack([y_ref, 0.9 * np.roll(y_ref, 1)]) if loop else y_ref
    chosen = ExportSettings(**{**settings, **loop, "name": "piezo"}, precision=precision)
    blocks = f"-DPIEZO_BLOCKS={3 if precision == 'double' else 20}"
    x, _ = replayed(tmp_path, model, chosen, samples, "gcc", "-O0", *SANITIZED, blocks)
    if not loop and precision == "double":
        np.testing.assert_array_equal(x, Compensator(model, (0.0, 150.0), settings.get("rate_limit")).run(y_ref))


@pytest.mark.sample(1)
@pytest.mark.parametrize("x_start", [40.0, None])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_first_drive_of_the_exported_c_is_a_step_of_the_rate_limit_away_from_where_the_stage_is(
    tmp_path: Path, precision: Precision, x_start: float | None
) -> None:
    y_ref, limit = np.array([np.nan, 12.0, 12.0]), 0.1 / SAMPLE_TIME
    settings = ExportSettings(precision=precision, x_limits=LIMITS, rate_limit=limit, x_start=x_start)
    x, _ = replayed(tmp_path, a_model(), settings, y_ref, "gcc", "-O1", *SANITIZED)
    expected = Compensator(a_model(), LIMITS, limit, x_start=x_start).run(y_ref)
    if precision == "double":
        np.testing.assert_array_equal(x, expected)
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-4)
    np.testing.assert_allclose(x - (LIMITS[0] if x_start is None else x_start), [0.0, 0.1, 0.2], rtol=0, atol=1e-4)


TINY = replace(a_model(), structure=replace(a_model().structure, x_scale=1e-42))


@pytest.mark.parametrize(
    ("model", "settings", "sentence"),
    [
        (
            a_model(),
            ExportSettings(x_limits=LIMITS, x_start=4.0),
            "x_start must be within the limits of the drive, 5 to 145, not 4",
        ),
        (
            a_model(),
            ExportSettings(x_limits=LIMITS, x_start=np.nan),
            "x_start must be within the limits of the drive, 5 to 145, not nan",
        ),
        (
            TINY,
            ExportSettings(precision="float"),
            "the constant 1e-42 does not fit into single precision; export it with --precision double",
        ),
    ],
)
def test_a_start_outside_of_the_limits_and_constants_that_single_precision_cannot_hold_are_refused(
    model: HysteresisCreepModel, settings: ExportSettings, sentence: str
) -> None:
    with pytest.raises(ExportError, match=sentence):
        export(model, settings)
    assert "1e-42" in export(TINY)["piezo_parameters.h"]


PROGRAM = r"""
#include "piezo.h"
#include <stdio.h>
#include <string.h>

static piezo_axis a, b;

int main(void)
{
    const piezo_weights other = { WEIGHTS };
    piezo_weights wrong = other;
    piezo_state state;
    double y;
    int k = 0;
    piezo_reset(&a);
    piezo_reset(&b);
    while (scanf("%lf", &y) == 1) {
        if (k == 300) {
            wrong.w_s[0] = -100;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            wrong = other;
            wrong.w_h[PIEZO_THRESHOLDS - 1] = -1e-9;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            wrong = other;
            wrong.w_h[0] = 0;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            wrong.offset = NAN;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            printf("%d ", piezo_set_model(&a, &other, 1.5));
            printf("%d ", piezo_set_limits(&a, 3, 3, 1));
            printf("%d ", piezo_set_integral_gain(&a, 1.001 * PIEZO_LARGEST_GAIN));
            printf("%d\n", piezo_set_model(&a, &other, FADE));
        }
        if (k == 600) {
            piezo_get_state(&a, &state);
            memset(&b, 0, sizeof b);
            piezo_reset(&b);
            piezo_set_model(&b, &other, FADE);
            piezo_set_state(&b, &state);
            state.blend = 1.5;
            printf("%d ", piezo_set_state(&b, &state));
            state.play[0] = INFINITY;
            printf("%d\n", piezo_set_state(&b, &state));
        }
        printf("%.17g %.17g\n", piezo_step(&a, y), piezo_step(&b, k < 600 ? -y : y));
        ++k;
    }
    return 0;
}
"""


@pytest.mark.sample(1)
@pytest.mark.parametrize("dynamics", [DYNAMICS, None], ids=["ringing", "static"])
def test_models_states_and_limits_can_be_set_and_two_axes_are_independent(
    dynamics: Dynamics | None, tmp_path: Path
) -> None:
    model, other = (replace(a_model(seed=seed), dynamics=dynamics) for seed in (0, 5))
    y_ref = np.nan_to_num(references(1000), nan=1.0, posinf=1.0, neginf=1.0)
    write_sources(tmp_path, model, ExportSettings())
    blend_time_s = 0.003
    weights = ", ".join(initialiser(w) for w in (other.w_H, other.w_S_inverse, other.w_K)) + ", 0.0"
    fade = literal(np.exp(-model.structure.sample_time / blend_time_s))
    (tmp_path / "program.c").write_text(PROGRAM.replace("WEIGHTS", weights).replace("FADE", fade))
    subprocess.run(
        [program("gcc"), *WARNINGS, *EXACT, "-O1", *SANITIZED, "program.c", "piezo.c", "-o", "program", "-lm"],
        cwd=tmp_path,
        check=True,
    )
    done = subprocess.run(
        [tmp_path / "program"], input="\n".join(map(repr, y_ref.tolist())), capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert (lines.pop(300), lines.pop(600)) == ("2 2 2 1 3 3 3 0", "3 1")
    first, second = np.array([line.split() for line in lines], dtype=float).T

    a, b = Compensator(model, (0.0, 150.0)), Compensator(model, (0.0, 150.0))
    x = a.run(y_ref[:300])
    a.change_model(other, blend_time_s)
    x = np.concatenate([x, a.run(y_ref[300:])])
    np.testing.assert_array_equal(first, x)
    np.testing.assert_array_equal(second[:600], b.run(-y_ref[:600]))
    np.testing.assert_array_equal(second[600:], first[600:])


OF_C = {"memcpy", "memmove", "memset", "sqrt", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}
"""What the sources may call."""


@pytest.mark.slow
@pytest.mark.parametrize("solver", LOOPS)
def test_the_source_has_no_recursion_allocates_nothing_and_its_stack_is_that_of_the_readme(
    tmp_path: Path, solver: str
) -> None:
    write_sources(tmp_path, a_model(), ExportSettings(part="learning", **loop_of(solver)))
    deepest = 0
    for unit in ("piezo", "piezo_learner"):
        subprocess.run(
            [
                program("gcc"),
                *WARNINGS,
                "-O2",
                "-fno-math-errno",
                "-fstack-usage",
                "-fcallgraph-info",
                "-c",
                f"{unit}.c",
            ],
            cwd=tmp_path,
            check=True,
        )
        calls = re.findall(
            r'edge: \{ sourcename: "(?:[^"]*:)?(.*?)" targetname: "(?:[^"]*:)?(.*?)"',
            (tmp_path / f"{unit}.ci").read_text(),
        )
        below = {caller: {called for each, called in calls if each == caller} for caller, _ in calls}
        order = [*TopologicalSorter(below).static_order()]  # CycleError if a function calls itself, however indirectly
        assert len(order) > 10
        symbols = subprocess.run(
            [program("nm"), f"{unit}.o"], cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout
        assert {name for name in re.findall(r" U (\w+)", symbols) if not name.startswith("piezo_")} <= OF_C
        assert not re.search(r" [bBdDC] ", symbols), "nothing is static but constants"
        assert all(name.startswith("piezo_") for name in re.findall(r" T (\w+)", symbols)), (
            "two exports in one program do not meet"
        )
        frames = [line.split("\t") for line in (tmp_path / f"{unit}.su").read_text().splitlines()]
        assert {kind for _, _, kind in frames} == {"static"}
        own = {name.rpartition(":")[2]: int(size) for name, size, _ in frames}
        depth: dict[str, int] = {}
        for name in order:  # callees come first
            depth[name] = own.get(name, 0) + max((depth[called] for called in below.get(name, ())), default=0)
        deepest += max(depth.values())
    stack = re.search(r"stack \| below (\d+) bytes", (tmp_path / "README.md").read_text())
    assert 0.2 * int(stack[1]) < deepest <= int(stack[1])


# The command line, from a recording to the controller.


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, a model and compensators of deploy."""
    folder, model = tmp_path_factory.mktemp("desk"), a_model()
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, seed=1)
    write_table(
        folder / "stage.csv", {"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": model.simulate(x)}
    )
    model.save(folder / "model.json")
    for name, solver, lane, mode in (
        ("deployed", "box_active_set", "kernel", "continuous"),
        ("exact", "box_active_set", "kernel", "cyclic"),
        ("daqp", "daqp", "direct", "cyclic"),
    ):
        Deployment(
            model=model, solver=solver, lane=lane, tier="high", settings={}, mode=mode, x_limits=(10.0, 120.0)
        ).save(folder / f"{name}.json")
    return folder


@pytest.mark.sample(1)
@pytest.mark.needs("cc")
@pytest.mark.parametrize(
    "words",
    [
        ("--precision", "float"),
        ("--part", "learning"),
        ("--part", "learning", "--mode", "cyclic", "--solver", "accelerated_projection"),
        ("--name", "stage_x", "--low", 5, "--high", 100, "--rate-limit", 1000),
    ],
    ids=str,
)
def test_the_example_takes_references_from_standard_input(
    piezobench: CommandLine, desk: Path, tmp_path: Path, words: tuple[object, ...]
) -> None:
    assert piezobench("export-c", "model.json", tmp_path / "c", *words, folder=desk).status == 0
    subprocess.run([program("make"), "-C", tmp_path / "c", "example"], capture_output=True, check=True)
    done = subprocess.run(
        [tmp_path / "c" / "example", "-"], input="0\n5\nnan\n1e9\n", capture_output=True, text=True, check=True
    )
    x = np.array([line.split()[1] for line in done.stdout.splitlines()], dtype=float)
    assert x.size == 4
    assert x[1] == x[2]
    assert np.all((x >= 0.0) & (x <= 150.0))
    refused = subprocess.run([tmp_path / "c" / "example", "more"], capture_output=True, text=True, check=False)
    assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1)


@pytest.mark.slow
@pytest.mark.needs("cmake", "cc")
def test_cmake_builds_it_too(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    assert piezobench("export-c", "model.json", tmp_path / "c", folder=desk).status == 0
    for words in (["-S", "c", "-B", "build"], ["--build", "build"]):
        subprocess.run([program("cmake"), *words], cwd=tmp_path, capture_output=True, check=True)
    assert subprocess.run([tmp_path / "build" / "example"], capture_output=True, check=True).stdout


LEARNS, COMPENSATES, REFUSED = "piezo_learner.c", "piezo.c", ""


@pytest.mark.parametrize(
    ("file", "options", "made", "said"),
    [
        ("deployed.json", (), LEARNS, "the self-learning loop (continuous, box_active_set) with d"),
        ("exact.json", (), LEARNS, "the self-learning loop (cyclic, box_active_set) with d"),
        ("daqp.json", ("--part", "compensator"), COMPENSATES, "the compensator, without learning with d"),
        ("daqp.json", ("--mode", "continuous"), LEARNS, "the self-learning loop (continuous, box_active_set) with d"),
        ("daqp.json", ("--solver", "projected_difference"), LEARNS, "(cyclic, projected_difference) with d"),
        (
            "daqp.json",
            (),
            REFUSED,
            "the C does not learn with daqp in cyclic mode; it learns with box_active_set in either mode",
        ),
        (
            "deployed.json",
            ("--solver", "projected_difference"),
            REFUSED,
            "the C does not learn with projected_difference in continuous mode",
        ),
    ],
)
def test_a_compensator_of_deploy_keeps_its_solver_or_is_refused_and_nothing_is_written(
    piezobench: CommandLine, desk: Path, tmp_path: Path, file: str, options: tuple[str, ...], made: str, said: str
) -> None:
    call = piezobench("export-c", file, tmp_path / "c", *options, folder=desk)
    assert said in " ".join((call.stdout if made else call.refusal).split())
    sources = {path.name for path in tmp_path.glob("c/*")} & {LEARNS, COMPENSATES}
    assert sources == {REFUSED: set(), COMPENSATES: {COMPENSATES}, LEARNS: {COMPENSATES, LEARNS}}[made]


def test_a_compensator_of_deploy_keeps_its_limits(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()  # an empty folder is filled
    piezobench.run("export-c", "deployed.json", tmp_path / "c", folder=desk)
    defined = dict(re.findall(r"#define (\w+) (\S+)", (tmp_path / "c" / "piezo_parameters.h").read_text()))
    assert defined.items() >= {"PIEZO_LOW": "10.0", "PIEZO_LEARNING": "4", "PIEZO_INTERVAL": "80"}.items()


@pytest.mark.needs("cc")
def test_the_c_of_a_deployment_learns_as_the_compensator_that_python_loads_from_it(desk: Path, tmp_path: Path) -> None:
    """To the last bit, with a stage that is not the model."""
    learner = Deployment.load(desk / "deployed.json").learner()
    y_ref, stage = references(SHORT, seed=3), Stage(SHORT, False)
    x, y = learner.run(y_ref[:-1], stage)
    x = np.append(x, learner.step(y_ref[-1], np.nan))
    samples = np.column_stack([y_ref, np.concatenate([[np.nan], y])])
    found, events = replayed(tmp_path, *_opened(desk / "deployed.json"), samples, "gcc", "-O2")
    np.testing.assert_array_equal(found, x)
    assert events[0] == learner.counts["hand_overs"] > 0


def test_every_verb_that_takes_a_model_takes_a_compensator_of_deploy(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    t = np.arange(2000) * 125e-6
    write_table(tmp_path / "wish.csv", {"time_s": t, "reference_um": 30.0 * np.sin(200.0 * t)})
    write_table(tmp_path / "x.csv", {"time_s": t, "drive_V": 75.0 + 50.0 * np.sin(200.0 * t)})
    for name in ("deployed", "model"):
        for words in (
            ("compensate", desk / f"{name}.json", "wish.csv", "--out", f"{name}-drive.csv"),
            ("simulate", desk / f"{name}.json", "x.csv", "--out", f"{name}-output.csv"),
        ):
            piezobench.run(*words, folder=tmp_path)
    assert (tmp_path / "deployed-output.csv").read_bytes() == (tmp_path / "model-output.csv").read_bytes()
    drive = np.loadtxt(tmp_path / "deployed-drive.csv", delimiter=",", skiprows=1)[:, 1]
    assert (drive.min(), drive.max()) == (10.0, 120.0)  # its limits
    said = piezobench.run("export-fmu", desk / "deployed.json", tmp_path / "it.fmu").said
    assert "It compensates and does not learn; export-c writes the self-learning loop" in said
