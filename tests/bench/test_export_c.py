"""The exported C beside Python: the same numbers from every compiler, and files that a stranger can build."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from exported_loops import LIMITS, MILLION, Told, a_model, compensation, learning, references, single

from bench.export import memory, numbers
from bench.export.building import EXACT, WARNINGS, build, replay, tool, write_sources
from bench.export.c_source import FLOAT_BOUND
from bench.export.settings import ExportError, ExportSettings
from bench.export.step_cost import loop_samples, shortened
from piezo_model import Compensator, Recording, identify, plants
from piezo_model.deployment import Deployment
from piezo_model.recordings import write_table
from piezo_model.signals import multi_sine

COMPILERS, LEVELS = ("gcc", "clang"), ("-O0", "-O1", "-O2", "-O3")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
EXACTLY = 1e-12
BOUND = {"compensator": EXACTLY, "cyclic": EXACTLY, "continuous": 1e-11}
"""Unit amplitudes. In continuous operation the root of the condition of P amplifies rounding, that of the sums in P included, in
Python as in C: both are several 1e-12 from the same recursion in extended precision, and about 1e-12 from each other."""
FLOAT_LOOP_BOUND = 1e-4
FAULTY = 150_000
KINDS: dict[str, Callable[[], Told]] = {
    "compensator": compensation, "cyclic": lambda: learning("cyclic"), "continuous": lambda: learning("continuous"),
    "cyclic, faulty sensor": lambda: learning("cyclic", FAULTY, faulty=True),
    "continuous, faulty sensor": lambda: learning("continuous", FAULTY, faulty=True)}


@cache
def told(kind: str) -> Told:
    """What Python says, computed once."""
    if not kind.startswith("cyclic"):
        return KINDS[kind]()
    with pytest.MonkeyPatch.context() as patch:
        # A controller cannot afford an eigenvalue, so the C takes its step from the infinity norm of P.
        patch.setattr("solvers.kernels.projected_engine.limit", lambda P: 2.0 / np.abs(P).sum(axis=1).max())
        return KINDS[kind]()


def built(folder: Path, said: Told, compiler: str, *flags: str) -> Path:
    """The replay program, without a warning."""
    write_sources(folder, said.model, said.settings)
    return build(folder, "replay", tool(compiler), (*WARNINGS, *EXACT, *flags))


def difference(said: Told, x: np.ndarray) -> float:
    """Largest difference in unit amplitudes."""
    return float(np.max(np.abs(x - said.x[:x.size]))) / said.model.structure.x_scale


# The same numbers.


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_compensator_gives_pythons_drive_over_a_million_samples(tmp_path: Path, compiler: str, level: str) -> None:
    said = told("compensator")
    x = replay(built(tmp_path, said, compiler, level, *SANITIZED), said.samples).x
    assert x.size == MILLION
    assert difference(said, x) <= EXACTLY


def test_a_falling_output_gives_the_drives_of_the_turned_one_to_the_last_digit(tmp_path: Path) -> None:
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, highest_Hz=10.0)
    y = plants.get("relay_preisach", sample_time=1e-3).run(x)
    rising, falling = (identify(Recording.from_arrays(x, sign * y, 1e-3)) for sign in (1.0, -1.0))
    assert falling.structure.falling
    y_ref = np.linspace(y.min(), y.max(), 500)
    drives = []
    for model, sign, name in ((rising, 1.0, "rising"), (falling, -1.0, "falling")):
        (tmp_path / name).mkdir()
        write_sources(tmp_path / name, model, ExportSettings())
        program = build(tmp_path / name, "replay", tool("gcc"), (*WARNINGS, *EXACT, "-O2"))
        drives += [Compensator(model, x_limits=(x.min(), x.max())).run(sign * y_ref), replay(program, sign * y_ref).x]
        np.testing.assert_array_equal(sign * model.simulate(x), rising.simulate(x))
    np.testing.assert_array_equal(drives[2], drives[0])
    np.testing.assert_array_equal(drives[3], drives[1])
    assert np.max(np.abs(drives[1] - drives[0])) / 75.0 <= EXACTLY


@pytest.mark.parametrize("kind", ["cyclic", "continuous"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_learning_loop_gives_pythons_drive_over_a_million_samples(tmp_path: Path, compiler: str, kind: str) -> None:
    said = told(kind)
    found = replay(built(tmp_path, said, compiler, "-O2"), said.samples)
    assert difference(said, found.x) <= BOUND[kind]
    assert found.events[:2] == said.events
    assert said.events[0] > 10


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "faulty" in kind])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_a_failing_sensor_is_guarded_against_as_in_python(tmp_path: Path, compiler: str, kind: str) -> None:
    said = told(kind)
    found = replay(built(tmp_path, said, compiler, "-O1", *SANITIZED), said.samples)
    assert difference(said, found.x) <= BOUND[kind.partition(",")[0]]
    assert found.events[2] >= 3
    assert found.events[3] == 0
    assert np.all((found.x >= LIMITS[0]) & (found.x <= LIMITS[1]))


@pytest.mark.parametrize("kind", ["cyclic, faulty sensor", "continuous, faulty sensor"])
def test_every_compiler_and_level_gives_the_learning_loop_to_the_last_bit(tmp_path: Path, kind: str) -> None:
    said = told(kind)
    part = said.samples[:40_000]
    drives = [replay(built(tmp_path, said, compiler, level), part).x for compiler in COMPILERS for level in LEVELS]
    assert all(np.array_equal(drives[0], x) for x in drives[1:])


@pytest.mark.parametrize(("kind", "bound"), [("compensator", FLOAT_BOUND), ("cyclic", FLOAT_LOOP_BOUND),
                                             ("continuous", FLOAT_LOOP_BOUND)])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_single_precision_stays_within_its_stated_bound(tmp_path: Path, compiler: str, kind: str, bound: float) -> None:
    said = single(told(kind))
    x = replay(built(tmp_path, said, compiler, "-O2"), said.samples).x
    assert EXACTLY < difference(said, x) <= bound
    assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))


@pytest.mark.parametrize(("shape", "settings"), [
    ({"n": 0, "m": 0, "rates": ()}, {}), ({"n": 20, "m": 9, "rates": (1.0,), "offset": True}, {}),
    ({"n": 7, "m": 4, "rates": (1.0, 2.0, 3.0, 4.0)}, {"rate_limit": 1e4}),
    ({"n": 8, "m": 0, "rates": (), "offset": True}, {"name": "left_axis"})], ids=str)
@pytest.mark.parametrize("part", ["compensator", "cyclic", "continuous"])
def test_every_shape_of_model_builds_and_fits_the_memory_that_the_readme_says(
        tmp_path: Path, shape: dict[str, object], settings: dict[str, object], part: str) -> None:
    model = a_model(**shape)
    loop = {} if part == "compensator" else {"part": "learning", "solver": "projected_difference" if part == "cyclic"
                                             else "recursive_active_set"}
    for block in (1, 8):
        for precision in ("double", "float"):
            folder = tmp_path / f"{precision}{block}"
            folder.mkdir()
            chosen = ExportSettings(**{**settings, **loop, "name": "piezo"}, precision=precision)
            write_sources(folder, model, chosen)
            program = build(folder, "replay", tool("gcc"), (*WARNINGS, *EXACT, "-O1", f"-DPIEZO_BLOCK={block}"))
            y_ref = references(500)
            samples = np.column_stack([y_ref, 0.9 * np.roll(y_ref, 1)]) if loop else y_ref
            found = replay(program, samples, repetitions=1)
            assert found.time is not None
            assert found.time.axis_bytes == memory.axis_bytes(model.structure, precision, bool(loop), part == "cyclic", block)
            if not loop and precision == "double":
                limits = 0.0, 150.0
                x = Compensator(model, limits, settings.get("rate_limit")).run(y_ref)
                assert np.max(np.abs(found.x - x)) / 75.0 <= EXACTLY


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
            wrong.w_h[0] = 0;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            wrong.offset = NAN;
            printf("%d ", piezo_set_model(&a, &wrong, 0.5));
            printf("%d ", piezo_set_model(&a, &other, 1.5));
            printf("%d ", piezo_set_limits(&a, 3, 3, 1));
            printf("%d\n", piezo_set_model(&a, &other, FADE));
        }
        if (k == 600) {
            piezo_get_state(&a, &state);
            memset(&b, 0, sizeof b);
            piezo_reset(&b);
            piezo_set_model(&b, &other, FADE);
            piezo_set_state(&b, &state);
            state.play[0] = INFINITY;
            printf("%d\n", piezo_set_state(&b, &state));
        }
        printf("%.17g %.17g\n", piezo_step(&a, y), piezo_step(&b, k < 600 ? -y : y));
        ++k;
    }
    return 0;
}
"""


def test_models_states_and_limits_can_be_set_and_two_axes_do_not_meet(tmp_path: Path) -> None:
    model, other, y_ref = a_model(), a_model(seed=5), references(1000)
    y_ref = np.where(np.isfinite(y_ref), y_ref, 1.0)
    write_sources(tmp_path, model, ExportSettings())
    fade_s = 0.003
    weights = ", ".join(numbers.initialiser(w) for w in (other.w_H, other.w_S_inverse, other.w_K)) + ", 0.0"
    fade = numbers.literal(np.exp(-model.structure.sample_time / fade_s))
    (tmp_path / "program.c").write_text(PROGRAM.replace("WEIGHTS", weights).replace("FADE", fade))
    subprocess.run([tool("gcc"), *WARNINGS, *EXACT, "-O1", *SANITIZED, "program.c", "piezo.c", "-o", "program", "-lm"],
                   cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "program"], input="\n".join(map(repr, y_ref.tolist())), capture_output=True, text=True,
                          check=True)
    lines = done.stdout.splitlines()
    assert lines.pop(300).split() == ["2", "1", "3", "3", "0"]
    assert lines.pop(600) == "1"
    first, second = np.array([line.split() for line in lines], dtype=float).T

    a, b = Compensator(model, (0.0, 150.0)), Compensator(model, (0.0, 150.0))
    x = a.run(y_ref[:300])
    a.change_model(other, fade_s)
    x = np.concatenate([x, a.run(y_ref[300:])])
    np.testing.assert_allclose(first, x, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(second[:600], b.run(-y_ref[:600]), rtol=0.0, atol=1e-10)
    np.testing.assert_array_equal(second[600:], first[600:])


COUNTING = r"""
#include <cmath>
static int mul, add, cmp;
struct counted {
    double v;
    counted() = default;
    counted(double x) : v(x) {}
    counted operator-() const { return -v; }
    counted &operator+=(counted o) { ++add; v += o.v; return *this; }
    counted &operator-=(counted o) { ++add; v -= o.v; return *this; }
    counted &operator*=(counted o) { ++mul; v *= o.v; return *this; }
};
#define RESULT(op, count) static counted operator op(counted a, counted b) { ++count; return a.v op b.v; }
#define ANSWER(op) static bool operator op(counted a, counted b) { ++cmp; return a.v op b.v; }
RESULT(+, add) RESULT(-, add) RESULT(*, mul) RESULT(/, mul) ANSWER(<) ANSWER(>) ANSWER(<=) ANSWER(>=)
static bool isfinite(counted a) { return std::isfinite(a.v); }
static counted fabs(counted a) { return std::fabs(a.v); }
static counted sqrt(counted a) { return std::sqrt(a.v); }
"""
COUNTED_MAIN = """
#include "piezo.c"
#include <cstdio>
static piezo_axis axis;
int main() {
    double in[COLUMNS];
    piezo_reset(&axis);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        const int phase = PHASE;
        mul = add = cmp = 0;
        piezo_step(&axis, ARGUMENTS);
        printf("%d %d %d %d\\n", phase, mul, add, cmp);
    }
}
"""
RESET, BUILD, LEARN = 0, 1, 2


@pytest.mark.parametrize(("solver", "parts"), [
    (None, {RESET: ["compensation"]}),
    ("projected_difference", {BUILD: ["compensation", "data basis"], LEARN: ["compensation", "projected step"]}),
    ("recursive_active_set", {LEARN: ["compensation", "exact optimum"]})])
@pytest.mark.parametrize(("n", "m"), [(5, 3), (20, 9)])
def test_a_sample_takes_no_more_operations_than_the_readme_says_and_not_many_fewer(
        tmp_path: Path, n: int, m: int, solver: str | None, parts: dict[int, list[str]]) -> None:
    model = a_model(n, m)
    settings = ExportSettings() if solver is None else ExportSettings(part="learning", solver=solver)
    settings = shortened(model, settings, 2000)
    write_sources(tmp_path, model, settings)
    header = (tmp_path / "piezo.h").read_text().replace("#ifdef __cplusplus", "#if 0")
    for name in ("real", "wide"):
        header = header.replace(f"typedef double piezo_{name};", f"typedef counted piezo_{name};")
    (tmp_path / "piezo.h").write_text(header)
    words = {"COLUMNS": "1", "PHASE": "0", "ARGUMENTS": "in[0]"} if solver is None else {
        "COLUMNS": "2", "PHASE": "axis.learner.phase", "ARGUMENTS": "in[0], in[1]"}
    text = COUNTING + COUNTED_MAIN
    for word, meaning in words.items():
        text = re.sub(rf"\b{word}\b", meaning, text)
    (tmp_path / "counted.cpp").write_text(text)
    subprocess.run([tool("g++", "clang++"), "-w", "-O1", "-DPIEZO_BLOCK=1", "counted.cpp", "-o", "counted"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "counted"], input=loop_samples(model, settings, 2000).tobytes(), capture_output=True, check=True)
    counts = np.array([line.split() for line in done.stdout.splitlines()], dtype=int)
    said = numbers.operations(model.structure, settings.learning, settings.cyclic)
    for phase, names in parts.items():
        ordinary = np.median(counts[counts[:, 0] == phase][:, 1:], axis=0)
        most = np.sum([said[name] for name in names], axis=0)
        assert np.all(ordinary <= most)
        assert np.all(ordinary >= 0.85 * most)


def test_the_source_has_neither_recursion_nor_an_unbounded_loop(tmp_path: Path) -> None:
    for solver in ("projected_difference", "recursive_active_set"):
        write_sources(tmp_path, a_model(), ExportSettings(part="learning", solver=solver))
        subprocess.run([tool("gcc"), *WARNINGS, "-O0", "-fcallgraph-info", "-c", "piezo.c"], cwd=tmp_path, check=True)
        graph = TopologicalSorter[str]()
        for caller, called in re.findall(r'edge: \{ sourcename: "(.*?)" targetname: "(.*?)"', (tmp_path / "piezo.ci").read_text()):
            graph.add(caller, called)
        assert len(list(graph.static_order())) > 20  # CycleError where a function calls itself, however indirectly
        text = re.sub(r"/\*.*?\*/", "", (tmp_path / "piezo.c").read_text(), flags=re.DOTALL)
        assert not re.search(r"\b(while|goto|malloc|calloc|alloca)\b", text)
        bounds = {re.sub(r"^\w+ (<=?|>=?) ", "", head.split(";")[1].strip()) for head in re.findall(r"for \((.*?)\) \{", text)}
        assert all(re.match(r"PIEZO_|[a-z]+ \+ PIEZO_BLOCK|half|0|3 &&|2$|s->free_count|j \+ 1 < PIEZO_D", bound) for bound in bounds), bounds


def test_the_source_allocates_nothing_and_its_stack_is_what_the_readme_says(tmp_path: Path) -> None:
    for solver in ("projected_difference", "recursive_active_set"):
        settings = ExportSettings(part="learning", solver=solver)
        write_sources(tmp_path, a_model(), settings)
        subprocess.run([tool("gcc"), *WARNINGS, "-O2", "-fstack-usage", "-c", "piezo.c"], cwd=tmp_path, check=True)
        needed = subprocess.run([tool("nm"), "-u", "piezo.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        assert {line.split()[-1] for line in needed.splitlines()} <= {"memcpy", "memmove", "memset", "sqrt",
                                                                      "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}
        data = subprocess.run([tool("nm"), "piezo.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        assert not re.search(r" [bBdDC] ", data), "nothing is static but constants"
        frames = [line.split("\t") for line in (tmp_path / "piezo.su").read_text().splitlines()]
        assert {kind for _, _, kind in frames} == {"static"}
        said = re.search(r"stack \| below (\d+) bytes", (tmp_path / "README.md").read_text())
        assert said is not None
        assert sum(int(size) for _, size, _ in frames) <= int(said[1])


# The command line, from a recording to the controller.


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, a model and a compensator of deploy."""
    folder, model = tmp_path_factory.mktemp("desk"), a_model()
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, seed=1)
    write_table(folder / "stage.csv", {"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": model.simulate(x)})
    model.save(folder / "model.json")
    Deployment(model, "recursive_active_set", "kernel", "high", {}, "continuous", (10.0, 120.0)).save(folder / "deployed.json")
    Deployment(model, "daqp", "direct", "high", {}, "cyclic", (10.0, 120.0)).save(folder / "daqp.json")
    return folder


def made(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([tool("make"), "-C", str(folder), *words], capture_output=True, text=True, check=True)


def test_one_line_leads_from_a_recording_to_a_program_that_runs(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    call = piezobench("identify", "stage.csv", "--out", tmp_path / "m.json", folder=desk)
    assert call.status == 0, call.stderr
    call = piezobench("export-c", tmp_path / "m.json", tmp_path / "c", "--precision", "float", folder=desk)
    assert (call.status, call.stderr) == (0, "")
    assert "make -C" in call.stdout
    done = made(tmp_path / "c", "run")
    assert "8000 samples" in done.stderr


@pytest.mark.parametrize("words", [(), ("--part", "learning"), ("--part", "learning", "--solver", "recursive_active_set"),
                                   ("--name", "stage_x", "--low", 5, "--high", 100, "--rate-limit", 1000)], ids=str)
def test_the_example_takes_references_from_standard_input(piezobench: CommandLine, desk: Path, tmp_path: Path,
                                                          words: tuple[object, ...]) -> None:
    assert piezobench("export-c", "model.json", tmp_path / "c", *words, folder=desk).status == 0
    made(tmp_path / "c", "example")
    done = subprocess.run([tmp_path / "c" / "example", "-"], input="0\n5\nnan\n1e9\n", capture_output=True, text=True, check=True)
    x = np.array([line.split()[1] for line in done.stdout.splitlines()], dtype=float)
    assert x.size == 4
    assert x[1] == x[2]
    assert np.all((x >= 0.0) & (x <= 150.0))
    refused = subprocess.run([tmp_path / "c" / "example", "more"], capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert len(refused.stderr.splitlines()) == 1


def test_cmake_builds_it_too(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    assert piezobench("export-c", "model.json", tmp_path / "c", folder=desk).status == 0
    for words in (["-S", "c", "-B", "build"], ["--build", "build"]):
        subprocess.run([tool("cmake"), *words], cwd=tmp_path, capture_output=True, check=True)
    assert subprocess.run([tmp_path / "build" / "example"], capture_output=True, check=True).stdout


def test_a_compensator_of_deploy_brings_its_limits_and_its_solver(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    call = piezobench("export-c", "deployed.json", tmp_path / "c", "--part", "learning", folder=desk)
    assert "recursive_active_set" in call.stdout
    parameters = (tmp_path / "c" / "piezo_parameters.h").read_text()
    assert "#define PIEZO_LOW 10.0" in parameters
    assert "PIEZO_REFRESH = 256" in parameters
    assert "learns with daqp" in piezobench("export-c", "daqp.json", tmp_path / "d", "--part", "learning", folder=desk).refusal
    assert piezobench("export-c", "daqp.json", tmp_path / "d", folder=desk).status == 0


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("words", "said"), [
    (["export-c", "nothing.json", "c"], "nothing.json: there is no such file"),
    (["export-c", "broken.json", "c"], "is not a whole JSON file"),
    (["export-c", "invalid.json", "c"], "w_H[0] must be positive"),
    (["export-c", "stage.csv", "c"], "stage.csv: is not a whole JSON file"),
    (["export-c", "model.json", "full"], "holds notes.txt already; name a new or an empty folder"),
    (["export-c", "model.json", "model.json"], "is a file; name a new folder"),
    (["export-c", "model.json", "nowhere/c"], "nowhere does not exist"),
    (["export-c", "model.json", "c", "--low", 9, "--high", 1], "the lowest drive 9 must be below the highest 1"),
    (["export-c", "model.json", "c", "--rate-limit", 0], "--rate-limit"),
    (["export-c", "model.json", "c", "--name", "two words"], "is no identifier of C"),
    (["export-c", "model.json", "c", "--rate-limit", "nan"], "--rate-limit"),
    (["export-c", "model.json", "c", "--rate-limit", "fast"], "--rate-limit"),
    (["export-c", "model.json", "c", "--low", "nan"], "must be below the highest"),
    (["export-c", "model.json", "c", "--high", "inf"], "must be finite"),
    (["export-c", "model.json", "c", "--part", "all"], "--part"),
    (["export-c", "model.json", "c", "--solver", "daqp"], "--solver"),
    (["export-c", "model.json", "c", "--speed", "9"], "--speed"),
    (["export-c", "model.json"], "folder"),
    (["export-c", "model.json", "/proc/c"], "/proc/c: cannot be written"),
    (["export-c", "model.json", "c", "--precision", "half"], "--precision")], ids=str)
def test_bad_input_is_refused_in_one_sentence_and_nothing_is_written(
        piezobench: CommandLine, desk: Path, tmp_path: Path, words: list[object], said: str) -> None:
    for name in ("model.json", "stage.csv"):
        shutil.copy(desk / name, tmp_path)
    (tmp_path / "broken.json").write_text('{"format": "piezobench-model"')
    data = json.loads((desk / "model.json").read_text())
    (tmp_path / "invalid.json").write_text(json.dumps({**data, "w_H": [0.0, *data["w_H"][1:]]}))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    before = contents(tmp_path)
    assert said in piezobench(*words, folder=tmp_path).refusal
    assert contents(tmp_path) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.json", "full", "invalid.json", "model.json", "stage.csv"]


def test_a_full_disk_leaves_no_half_written_folder(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    call = piezobench("export-c", desk / "model.json", tmp_path / "c", folder=tmp_path, largest_file=2000)
    assert "cannot be written" in call.refusal
    assert list(tmp_path.iterdir()) == []


def test_an_empty_folder_is_filled(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    assert piezobench("export-c", desk / "model.json", tmp_path / "c").status == 0
    assert (tmp_path / "c" / "piezo.c").is_file()


def test_a_missing_compiler_is_named_with_its_package() -> None:
    with pytest.raises(ExportError, match="there is no no-such-compiler on this machine; apt-get install no-such-compiler"):
        tool("no-such-compiler")
