"""The C core: the stable ABI as it is declared, its build, its bindings, and the box solver in C without Python."""

import importlib.machinery
import importlib.util
import re
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from programs import lacking, program

import solvers
from piezo_model import Compensator, DataBasis, Dynamics, HysteresisCreepModel, ModelStructure
from piezo_model.core import bindings as of_model
from solvers import Problem, core
from solvers.core import bindings, block, compile_core

FOLDER, ROOT = Path(core.__file__).parent, Path(core.__file__).parents[2]
FOLDERS = compile_core.folders(FOLDER.parent)
WARNINGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wpsabi", "-Werror"]


def algorithms(folder):
    """Sources that may be in an exported folder."""
    return [file for file in folder.glob("*.c") if not file.name.startswith(("bindings", "module", "clock"))]


ALGORITHMS = algorithms(FOLDER)
OF_MODEL = algorithms(ROOT / "piezo_model" / "core") + algorithms(ROOT / "piezo_model" / "plants")
EXPORTED = [
    ROOT / "piezo_model" / "core" / name for name in ("model.c", "prefilter.c", "data_basis.c", "compensator.c")
]
INCLUDES = [f"-I{folder}" for folder in (*FOLDERS, ROOT / "piezo_model" / "core")]
WORDS = [f'-D{word}="x"' for word in ("CORE_SOURCES", "CORE_COMPILER", "CORE_INSTRUCTIONS")]
STRUCTS = {
    "Py_buffer": "buf obj len itemsize readonly ndim format shape strides suboffsets internal",
    "PyMethodDef": "ml_name ml_meth ml_flags ml_doc",
    "PyModuleDef": "m_base m_name m_doc m_size m_methods m_slots m_traverse m_clear m_free",
}
HEADERS = [
    path for path in (sysconfig.get_path("include"), "/usr/include/python3.11") if Path(path, "Python.h").exists()
]


def compiled(folder, text, *options):
    source, target = folder / "check.c", folder / "check"
    source.write_text(text, encoding="utf-8")
    subprocess.run([program("gcc"), f"-I{FOLDER}", f"-I{HEADERS[0]}", *options, source, "-o", target], check=True)
    return target


def test_the_size_of_a_learner_grows_with_the_square_of_its_weights_up_to_the_largest():
    large, largest = (of_model.learner_bytes(n, n, n, 1, 0, 0, 1, 1, 0) for n in (5000, 10_000))
    assert largest == pytest.approx(4 * large, rel=1e-2)


def test_the_declared_part_of_the_stable_abi_is_that_of_the_real_header(tmp_path):
    if not HEADERS:
        lacking("Python.h", "python3-dev")
    numbers = [
        *(f"offsetof({name}, {member})" for name, members in STRUCTS.items() for member in members.split()),
        *(f"sizeof({name})" for name in STRUCTS),
        *["METH_FASTCALL", "PyBUF_WRITABLE", "PyBUF_FORMAT", "PyBUF_ND", "PyBUF_C_CONTIGUOUS", "PYTHON_ABI_VERSION"],
    ]
    lines = "\n".join(f'printf("%ld\\n", (long)({number}));' for number in numbers)
    real, own = "#define Py_LIMITED_API 0x030B0000\n#include <Python.h>\n", '#include "python_abi.h"\n'
    ours, theirs = (
        subprocess.check_output(
            compiled(
                tmp_path, f"#include <stddef.h>\n#include <stdio.h>\n{header}int main(void) {{\n{lines}\nreturn 0; }}\n"
            ),
            text=True,
        ).split()
        for header in (own, real)
    )
    assert (ours, len(ours)) == (theirs, len(numbers))
    # Declarations that differ from those before them are errors of the compiler.
    compiled(tmp_path, f"{real}#define CORE_PYTHON_ABI_CHECKED_BY_PYTHON_H\n{own}", "-c")


SHAPE = "-DCORE_SHAPE={.n=9,.zones=7,.rates=3,.offset=1}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "compiler", "options"),
    [
        (ALGORITHMS, "gcc", ["-O2", "-DCORE_FLOAT"]),
        (ALGORITHMS, "clang", ["-fsyntax-only", "-DCORE_FLOAT"]),
        (ALGORITHMS, "clang", ["-fsyntax-only", "-DCORE_PLAIN"]),
        (OF_MODEL, "gcc", ["-O2", "-march=x86-64-v2"]),
        (OF_MODEL, "gcc", ["-fsyntax-only", "-march=x86-64-v4"]),
        (OF_MODEL, "clang", ["-fsyntax-only", "-march=x86-64-v3"]),
        (OF_MODEL, "clang", ["-fsyntax-only", "-DCORE_PLAIN"]),
        (EXPORTED, "gcc", ["-O2", "-DCORE_FLOAT", SHAPE]),
        (EXPORTED, "clang", ["-fsyntax-only", "-DCORE_FLOAT", SHAPE]),
    ],
)
def test_the_sources_compile_without_a_warning(files, compiler, options, tmp_path):
    """Compilation without optimisation shows all warnings of clang and of the header that queries the instruction set;
    gcc gives more with it."""
    subprocess.run(
        [program(compiler), *WARNINGS, "-c", *options, *WORDS, *INCLUDES, *map(str, files)], cwd=tmp_path, check=True
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "called"),
    [(ALGORITHMS, {"memcpy", "memset", "sqrt", "fabs"}), (EXPORTED, {"memcpy", "memset", "sqrt"})],
)
def test_the_algorithms_call_nothing_of_the_libraries_but_a_few_functions(files, called, tmp_path):
    subprocess.run(
        [program("gcc"), "-O2", "-fno-math-errno", "-c", *INCLUDES, *map(str, files)], cwd=tmp_path, check=True
    )
    symbols = subprocess.check_output([program("nm"), *(f.name for f in tmp_path.glob("*.o"))], cwd=tmp_path, text=True)
    assert {*re.findall(r" U (\w+)", symbols)} - {*re.findall(r" T (\w+)", symbols)} <= called | {
        "_GLOBAL_OFFSET_TABLE_"
    }
    assert not re.findall(r" [BDbdCc] (\w+)", symbols)  # no variable that outlives a call


def test_the_instruction_set_can_be_chosen_and_one_that_the_processor_lacks_is_refused(monkeypatch):
    for level in range(2, bindings.processor_level() + 1):
        monkeypatch.setenv("PIEZOBENCH_ISA", f"v{level}")
        assert core.load(FOLDER.parent).instructions == f"v{level}"
    for name, level, known in (("v9", None, "v2"), ("v4", 3, "v2, v3 of this processor$")):
        monkeypatch.setenv("PIEZOBENCH_ISA", name)
        with pytest.raises(ImportError, match=f"^the instruction set {name} is not one of {known}"):
            core.load(FOLDER.parent, level)


def test_a_library_beside_other_sources_or_none_is_refused_in_one_sentence(tmp_path, monkeypatch):
    package, (least, *_) = tmp_path / "solvers", compile_core.instruction_sets()
    monkeypatch.setattr(compile_core, "instruction_sets", lambda: (least,))
    monkeypatch.setenv("PIEZOBENCH_ISA", least)
    sources = [file for folder in FOLDERS for file in folder.glob("*.[ch]")]
    for file in (*sources, FOLDER / "compile_core.py", compile_core.library(FOLDER.parent, least)):
        (package / file.parent.name).mkdir(parents=True, exist_ok=True)
        (package / file.parent.name / file.name).write_bytes(file.read_bytes())
    assert core.load(package).descent_bytes(3) == bindings.descent_bytes(3)
    (package / "core" / "descent.c").write_text("/* changed */", encoding="utf-8")
    with pytest.raises(ImportError, match=r"^the C sources in solvers/core have changed since their library was built"):
        core.load(package)
    with pytest.raises(ImportError, match=r"^the C core of elsewhere is not built: run make core$"):
        core.load(tmp_path / "elsewhere")


VARIANTS = {
    "plain": ("gcc", "-O0", "-DCORE_PLAIN"),
    "level 2": ("gcc", "-O1", "-march=x86-64-v2"),
    "level 3": ("clang", "-O1", "-march=x86-64-v3"),
    "level 4": ("clang", "-O3", "-march=x86-64-v4"),
    "level 4 by gcc": ("gcc", "-O3", "-march=x86-64-v4", "-funroll-loops"),
}


@pytest.fixture(scope="module")
def installed():
    """The cores as they are installed, for every instruction set of this processor."""
    found = {}
    for level in range(2, bindings.processor_level() + 1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PIEZOBENCH_ISA", f"v{level}")
            found[f"v{level}"] = [core.load(package, level) for package in compile_core.PACKAGES]
    return found


@pytest.fixture(scope="module")
def variants(tmp_path_factory):
    """The cores built by two compilers for several instruction sets at several levels of optimisation; that of the
    solvers without a warning."""
    folder = tmp_path_factory.mktemp("variants")

    def build(name, package):
        compiler, *options = VARIANTS[name]
        (target := folder / name / package.name).mkdir(parents=True)
        warnings = WARNINGS if package == FOLDER.parent else []
        path = compile_core._compile(package, target, [program(compiler), *warnings, *options], "native", False)
        loader = importlib.machinery.ExtensionFileLoader("_core", str(path))
        module = importlib.util.module_from_spec(importlib.util.spec_from_file_location("_core", path, loader=loader))
        loader.exec_module(module)
        return module

    names = [name for name in VARIANTS if not name.startswith(f"level {bindings.processor_level() + 1}")]
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as pool:
        patch.setattr(compile_core, "FLAGS", [flag for flag in compile_core.FLAGS if not flag.startswith("-O")])
        return {name: [*pool.map(partial(build, name), compile_core.PACKAGES)] for name in names}


def random_data(d):
    """Matrices, vectors and rows; computed once, since results of BLAS depend on the processor."""
    rng = np.random.default_rng(d)
    A, rank = rng.normal(size=(d, d)), int(rng.integers(0, d + 1))
    hilbert = 1.0 / (np.arange(d)[:, None] + np.arange(d) + 1.0)
    lb = np.where(rng.random(d) < 0.7, -rng.random(d), -np.inf)
    ub = np.where(rng.random(d) < 0.5, rng.random(d), np.inf)
    q = rng.normal(size=d)
    programs = [(P, P @ q) for P in (A @ A.T + 1e-3 * np.eye(d), A[:, :rank] @ A[:, :rank].T, hilbert)]
    return programs, lb, ub, q, rng.normal(size=(40, d + 1))


def bits_of_everything(c, of_model, programs, lb, ub, q, rows):
    """States and answers of every function of the solvers, of a model, its data basis and its compensator, as bytes."""
    d, out = q.size, []
    s = ModelStructure.equidistant(d, d // 2, (0, 150), (-20, 20), (100, 10, 1), 1e-3, offset=True)
    w = s.slope_map @ np.linspace(0.1, 1.0, s.d)
    model = replace(HysteresisCreepModel.from_weights(s, w), dynamics=Dynamics((90.0,), (0.02,), (0.8,), 1e-3))
    basis, compensator = DataBasis(s, forgetting=0.999)._core.block, Compensator(model, rate_limit=5e4)._core.block
    x, y = np.sin(np.arange(1000) / 30) * np.cos(np.arange(1000) / 170), np.empty(1000)
    of_model.model_simulate(*model.arrays, np.zeros(s.lanes), np.zeros(3 * s.lanes), x, y)
    of_model.basis_update(basis, x, y)
    of_model.compensator_run(compensator, y, x)
    out += [each.tobytes() for each in (y, x, basis, compensator)]
    for P, linear in programs:
        box = block(c.box_bytes(d))
        out.append([c.box_setup(box, lb, ub), c.box_set_data(box, P, linear), c.box_solve(box, 0), c.box_solve(box, 1)])
        out.append(box.tobytes())
        changing_P, changing_q = P.copy(), linear.copy()
        for row in rows:
            changing_P, changing_q = 0.9 * changing_P + np.outer(row[:d], row[:d]), 0.9 * changing_q - row[d] * row[:d]
            out.append([c.box_set_data(box, changing_P, changing_q), c.box_solve(box, 1), box.tobytes()])
        for method in (c.projected_steps, c.accelerated_steps):
            descent = block(c.descent_bytes(d))
            c.descent_setup(descent, lb, ub)
            out.append(
                [c.descent_set_data(descent, P, q, 0.5, 1), c.descent_start(descent, q), method(descent, 50, 0.0)]
            )
            c.descent_answer(descent)
            out.append(descent.tobytes())
    return out


@pytest.mark.parametrize("d", [1, 2, 7, 16, 18, 33, 60])
@pytest.mark.parametrize("built", ["installed", pytest.param("variants", marks=pytest.mark.slow)])
def test_every_compiler_instruction_set_and_optimisation_gives_the_same_bits(request, built, d):
    data = random_data(d)
    expected = bits_of_everything(bindings, of_model, *data)
    for name, modules in request.getfixturevalue(built).items():
        assert bits_of_everything(*modules, *data) == expected, name


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        *(
            (partial(bindings.descent_setup, *arguments), error, message)
            for arguments, error, message in (
                ((), TypeError, "takes 3 arguments, not 0"),
                ((None, np.zeros(2), np.zeros(2)), TypeError, "bytes-like object is required"),
                (
                    (block(10_000), np.zeros(2, np.float32), np.zeros(2)),
                    TypeError,
                    "argument 2 holds numbers of type f, not d",
                ),
                (
                    (block(10_000), np.zeros(2, ">f8"), np.zeros(2)),
                    TypeError,
                    "argument 2 holds numbers of type >d, not d",
                ),
                ((block(10_000), np.zeros(4)[::2], np.zeros(2)), ValueError, "contiguous"),
                ((block(10_000), np.zeros((1, 2)), np.zeros(2)), ValueError, "argument 2: expected"),
                ((block(10_000), np.zeros(2), np.zeros(3)), ValueError, "argument 3: expected"),
                ((block(100), np.zeros(2), np.zeros(2)), ValueError, "the state has room for 100 bytes and needs"),
                ((block(10_000)[1:], np.zeros(2), np.zeros(2)), ValueError, "not the state"),
                ((np.zeros(2000), np.zeros(2), np.zeros(2)), TypeError, "argument 1 holds numbers of type d, not B"),
                ((bytes(10_000), np.zeros(2), np.zeros(2)), BufferError, "writable"),
            )
        ),
        (lambda: bindings.descent_answer(block(bindings.descent_bytes(3))), ValueError, "not the state"),
        (lambda: bindings.descent_answer(a_state()[:-8].copy()), ValueError, "not the state"),
        (lambda: bindings.descent_bytes(-1), ValueError, "argument 1 must be from 0 to 10000, not -1"),
        (lambda: bindings.descent_bytes(10_001), ValueError, "argument 1 must be from 0 to 10000, not 10001"),
        (lambda: bindings.descent_bytes(2.5), TypeError, "float"),
        (lambda: bindings.descent_bytes(2, 3), TypeError, "takes 1 arguments, not 2"),
        (lambda: bindings.processor_level(1), TypeError, "takes 0 arguments, not 1"),
        (lambda: bindings.projected_steps(a_state(), 1, "a"), ValueError, "^tolerance must be a real number"),
        (lambda: bindings.projected_steps(a_state(), 1, 10**400), ValueError, "and one that a double can hold$"),
        (lambda: bindings.projected_steps(a_state(), -1, 0.0), ValueError, "argument 2 must be from 0 to"),
        (
            lambda: bindings.descent_set_data(a_state(), np.eye(2), None, 0.5, 1),
            ValueError,
            "argument 2: expected",
        ),
        (
            lambda: bindings.descent_set_data(a_state(), None, np.ones(2), 0.5, 1),
            ValueError,
            "argument 3: expected",
        ),
        (lambda: played(np.zeros(2), np.zeros((1, 1))), ValueError, "argument 3: expected"),
        (lambda: played(np.zeros(1), np.zeros((2, 1))), ValueError, "argument 4: expected"),
        (
            lambda: played(np.broadcast_to(np.zeros(1), 1), np.zeros((1, 1))),
            ValueError,
            "read-only|not writable",
        ),
        (lambda: timed(np.zeros(1)), TypeError, "argument 10 holds numbers of type d, not lq"),
        (lambda: timed(np.zeros(1, np.int64), P=8), ValueError, "argument 7: expected"),
        (lambda: prepared(tile=1), ValueError, "argument 2 must be from 0 to 0, not 1"),
        (lambda: of_model.basis_update(a_basis(), np.zeros(3), np.zeros(2)), ValueError, "argument 3: expected"),
        (lambda: of_model.basis_finish(a_basis()[:-8].copy()), ValueError, "not the state"),
        (lambda: of_model.compensator_run(a_basis(), np.zeros(3), np.zeros(3)), ValueError, "argument 1 is not the"),
        (
            lambda: of_model.basis_setup(a_basis()[:900], 5, 7, 3, 0, 1.0),
            ValueError,
            "has room for 900 bytes and needs",
        ),
    ],
)
def test_arguments_that_do_not_fit_their_marks_are_refused_and_nothing_is_read(call, error, message):
    with pytest.raises(error, match=message):
        call()


def timed(updates, P=9):
    q, P, solves, answers = np.zeros((1, 3)), np.zeros((1, P)), np.zeros(1, np.int64), np.zeros((1, 3))
    return bindings.time_projected(a_state(), 0.5, 0, 1, -1.0, q, P, None, 1, updates, solves, answers, solves.copy())


def a_state(d=3):
    state = block(bindings.descent_bytes(d))
    bindings.descent_setup(state, np.zeros(d), np.ones(d))
    return state


def a_basis():
    return DataBasis(ModelStructure.equidistant(2, 1, (0, 1), (0, 1), (), 1e-3))._core.block


def played(states, outputs):
    of_model.play(np.zeros(1), np.zeros(1), states, outputs)


def prepared(tile):
    structure = 2, 1, 1, 0, 0, 0
    bank = block(of_model.bank_bytes(*structure, 1, 8))
    of_model.bank_setup(bank, *structure, 1, 8)
    of_model.bank_prepare(bank, tile, 0)


@pytest.mark.parametrize("module", [bindings, of_model], ids=["solvers", "piezo_model"])
def test_every_argument_of_a_table_is_marked_as_the_parser_reads_it(module):
    size = r"(\d+|[a-z]+(\+\d)?)"
    mark = rf"[A-Za-z_]+(#{size}?:{size}?|@([A-Z0-9]{{4}}&?)?|\[{size}(,{size})*\][qi]?[=?]?)?"
    functions = [
        each for each in vars(module).items() if callable(each[1]) and (each[1].__doc__ or "").startswith(f"{each[0]}(")
    ]
    assert len(functions) > 20
    assert [
        function.__doc__
        for name, function in functions
        if not re.fullmatch(rf"{name}\(({mark}(, {mark})*)?\): (.|\n)*\.", function.__doc__)
    ] == []


def output_of(source: Path, folder: Path, *options: str) -> str:
    """What a program of this source and the box solver prints; it must end with 0."""
    words = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", *options, f"-I{FOLDER}", source]
    subprocess.run([program("cc"), *words, *FOLDER.glob("box_*.c"), "-lm", "-o", folder / "built"], check=True)
    done = subprocess.run([folder / "built"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.sample(1)
@pytest.mark.parametrize("options", [(), ("-DCORE_PLAIN",)], ids=" ".join)
def test_the_box_solver_passes_its_test_in_C_with_vectors_and_without(options: tuple[str, ...], tmp_path: Path) -> None:
    assert output_of(Path(__file__).with_name("test_box.c"), tmp_path, *options) == ""


@pytest.mark.sample(1)
@pytest.mark.parametrize("options", [("-DCORE_VARIABLES=3",), ()], ids=" ".join)
def test_the_example_in_C_prints_the_answer_of_the_solver_in_Python(options: tuple[str, ...], tmp_path: Path) -> None:
    P, q = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 3.0]]), np.array([-2.0, -3.0, 2.0])
    solver = solvers.get("box_active_set")
    solver.setup(Problem(P, q, lb=np.zeros(3), ub=np.array([np.inf, 1.0, np.inf])))
    x = solver.solve()
    expected = "".join(f"x{j} = {x[j]:.6f}, gradient {P[j] @ x + q[j]:.6f}\n" for j in range(3))
    assert output_of(ROOT / "examples" / "c" / "box_problem.c", tmp_path, *options) == expected
