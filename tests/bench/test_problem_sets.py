"""Problem sets: their range, contents, options and proofs; the set of measured actuators and its files."""

import json
import re
import subprocess
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from make_measured import PROGRAMS
from make_measured import make as made_from
from measured_rows import judged
from program_files import same_problem

from bench.messages.task import Outcome, Status
from bench.problems import ProblemSet, RaceProblem, all_sets, find, make
from bench.problems.measured import FOLDER, read
from bench.problems.protocol import SCALINGS, Scaling
from bench.problems.recorded import ORDERS, WINDOWS, Recorded, preprocessed
from bench.races.run_problems import raced
from bench.races.settings import RaceSettings
from piezo_model import DataBasis, HysteresisCreepModel, plants
from piezo_model.identification.error_model import ProgramSolver, accumulate, counted_from
from piezo_model.recordings import write_table
from piezo_model.signals import SIGNALS
from solvers.certificate import verify


@pytest.fixture(scope="module")
def excitation(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, RaceProblem]]:
    """Output of ``--verify`` for the set, and its problems."""
    folder = tmp_path_factory.mktemp("excitation")
    call = piezobench.run("problems", "--set", "excitation", "--verify", "--export", folder)
    return call.stdout, {problem.name: problem for problem in map(RaceProblem.load, folder.glob("*.npz"))}


@pytest.fixture(scope="module")
def drift() -> list[RaceProblem]:
    return list(make("drift").problems())


def drive_and_output(duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Of the Preisach actuator, at 1 kHz."""
    x = SIGNALS["multi_sine"](duration_s=duration_s, sample_time=1e-3, low=0.0, high=150.0, seed=3)
    return x, plants.get("relay_preisach", sample_time=1e-3).run(x)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the Preisach actuator, with a sensor offset."""
    x, y = drive_and_output(6.0)
    path = tmp_path_factory.mktemp("recording") / "stage.csv"
    write_table(path, {"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": y + 7.0})
    return path


@pytest.fixture(scope="module")
def made(recording: Path) -> ProblemSet:
    """A set of which problems of two orders are selected."""
    made = make("recorded", options={"recording": str(recording)})
    made.selected = {"n5-m3-whole", "n12-m6-whole"}
    return made


@pytest.fixture(scope="module")
def recorded(made: ProblemSet) -> list[RaceProblem]:
    return list(made.problems())


def test_conditions_of_the_bare_problems_span_eight_decades_and_end_in_singular_ones(
    excitation: tuple[str, dict[str, RaceProblem]],
) -> None:
    bare = [problem.forms["scaled"] for name, problem in excitation[1].items() if name.endswith("bare")]
    diagonals = np.concatenate([form.qp.P.diagonal() for form in bare])
    np.testing.assert_allclose(diagonals[diagonals > 0], 1.0)
    finite = [form.condition for form in bare if np.isfinite(form.condition)]
    assert min(finite) < 3e4 < 5e11 < max(finite)
    assert len({int(np.log10(value)) for value in finite}) >= 6
    assert not all(form.certificate.unique for form in bare)
    assert any(form.certificate.convexity_shift > 0 for form in bare)


def test_a_forward_program_leads_from_its_start_to_the_weights_of_the_next_step() -> None:
    problems = list(make("forward").problems())
    assert [problem.name for problem in problems] == make("forward").names()
    for first, second in pairwise(problems):
        form = second.forms["raw"]
        if first.name.partition("-step")[0] == second.name.partition("-step")[0]:
            np.testing.assert_allclose(form.to_weights @ form.starts["warm"], first.optimal_weights, atol=1e-6)
        assert (form.optimum_is_unique, len(form.windows)) == (True, 1)
    errors = {problem.name: problem.optimum_error_percent for problem in problems}
    assert errors["bouc_wen-step-3"] <= errors["bouc_wen-step-1"]


def test_proofs_are_counted_and_singular_problems_and_shifts_listed_which_a_proximal_term_prevents(
    excitation: tuple[str, dict[str, RaceProblem]],
) -> None:
    output, problems = excitation
    assert f"{len(problems)} of {len(make('excitation').names())} problems are certified in every scaling" in output
    lines = {line.split()[0]: line for line in output.splitlines() if line.startswith("n")}
    for name, problem in problems.items():
        assert not name.endswith("proximal") or all(form.optimum_is_unique for form in problem.forms.values())
        form = problem.forms["scaled"]
        expected = {
            "not unique": not form.certificate.unique,
            "since rounding left P indefinite": form.certificate.convexity_shift > 0,
            "singular": not form.optimum_is_unique,
        }
        assert {words: words in lines[name] for words in expected} == expected


@pytest.mark.parametrize("scaling", SCALINGS)
def test_weights_are_not_judged_if_the_optimum_is_not_unique(
    excitation: tuple[str, dict[str, RaceProblem]], scaling: Scaling
) -> None:
    for problem in excitation[1].values():
        form = problem.forms[scaling]
        verdict = judged(problem, scaling, Outcome(found=True, x=np.array(form.certificate.x)))
        assert (verdict.status, np.isfinite(verdict.weight_error)) == (Status.ANSWERED, form.optimum_is_unique)


def test_snapshots_of_the_drift_follow_each_other_every_quarter_of_a_second(drift: list[RaceProblem]) -> None:
    assert len(drift) == len(make("drift").names()) == len({problem.name for problem in drift})
    assert np.allclose(np.diff([float(problem.name.strip("ts")) for problem in drift]), 0.25)


@pytest.mark.parametrize("scaling", SCALINGS)
def test_a_warm_start_is_the_optimum_before_it_and_feasible(drift: list[RaceProblem], scaling: Scaling) -> None:
    for before, problem in pairwise(drift):
        form = problem.forms[scaling]
        np.testing.assert_allclose(form.to_weights @ form.starts["warm"], before.optimal_weights, rtol=0.0, atol=1e-9)
        assert np.all(form.starts["warm"] >= form.qp.lb)
        line = HysteresisCreepModel.from_weights(problem.validation.structure, form.to_weights @ form.starts["line"])
        np.testing.assert_allclose(
            np.diff(line.simulate(np.linspace(*problem.validation.structure.x_range, 9)), 2), 0.0, atol=1e-9
        )


def test_the_optimum_moves_with_the_gain_and_a_warm_start_is_nearer_to_it_than_the_start_of_the_drift(
    drift: list[RaceProblem],
) -> None:
    w = np.array([problem.optimal_weights for problem in drift])
    steps, moved = (np.median(np.abs(by).max(axis=1)) for by in (np.diff(w[15:], axis=0), w[16:] - w[0]))
    assert 0.0 < steps < moved


def test_a_recording_gives_problems_of_every_order_over_every_window_and_makes_those_of_the_selected_orders(
    made: ProblemSet, recorded: list[RaceProblem]
) -> None:
    names = made.names()
    assert len(names) == len({*names}) == (len(ORDERS) + 1) * len(WINDOWS)  # and those of identify's own model
    assert {f"n{n}-m{m}-{window}" for n, m in ORDERS for window in WINDOWS} < {*names}
    assert [problem.name for problem in recorded] == [f"{order}-{w}" for order in ("n5-m3", "n12-m6") for w in WINDOWS]
    for problem in recorded[:4]:
        for form in problem.forms.values():
            verify(form.qp, form.certificate)


def test_the_last_fifth_of_a_recording_validates_models_with_a_free_offset(
    recorded: list[RaceProblem], recording: Path
) -> None:
    x, y = np.loadtxt(recording, delimiter=",", skiprows=1, unpack=True)[1:]
    for problem in recorded:
        v = problem.validation
        assert v.structure.offset
        assert all(np.isneginf(form.qp.lb).nonzero()[0] == [problem.d - 1] for form in problem.forms.values())
        np.testing.assert_array_equal([v.x, v.y], [x[4800:], y[4800:]])
        if problem.name == "n12-m6-whole":
            assert v.error_percent(problem.optimal_weights) < 2.0


def test_the_operators_begin_anew_at_each_sweep_of_a_recording(recording: Path, tmp_path: Path) -> None:
    head, *rows = recording.read_text().splitlines()
    sweep = "\n".join([head, *rows[:2000], ""])
    (tmp_path / "sweeps.csv").write_text(2 * sweep + "\n".join(rows[2000:2500]) + "\n")
    made = make("recorded", options={"recording": str(tmp_path / "sweeps.csv")})
    problem = next(problem for problem in made.problems() if problem.name == "n5-m3-whole")
    assert isinstance(made, Recorded)
    fitted, _ = made._split
    assert fitted.starts == (0, 2000)
    prepared = preprocessed(fitted, 5, 3, made._orders_and_rates[1])
    alone = accumulate(fitted, counted_from(fitted, 0), prepared.fit.structure, prepared.fit.states, ProgramSolver())
    np.testing.assert_allclose(problem.forms["scaled"].qp.P, alone.qp.P, atol=1e-12)


@pytest.mark.slow
def test_a_race_reads_a_recording_with_the_options_of_identify(tmp_path: Path, piezobench: CommandLine) -> None:
    """Semicolons, decimal commas, no header, no times, and the output before the input."""
    (tmp_path / "stage.txt").write_text(
        "".join(f"{y:.6f};{x:.6f}\n".replace(".", ",") for x, y in zip(*drive_and_output(3.0), strict=True))
    )
    reading = ("--header-row", 0, "--decimal", ",", "--sample-rate", 1000, "--input", 2, "--output", 1)
    few = ("--solver", "box_active_set", "--lane", "kernel", "--limit", 1, "--out", tmp_path, "--name", "run")
    piezobench.run("race", "--recording", tmp_path / "stage.txt", *reading, *few)
    assert json.loads((tmp_path / "run/run.json").read_text())["settings"]["set_options"] == {
        "recording": str(tmp_path / "stage.txt"),
        "input": "2",
        "output": "1",
        "sample_time": "0.001",
        "header_row": "0",
        "decimal": ",",
    }


def test_windows_that_are_too_short_are_left_out_with_the_reason(tmp_path: Path) -> None:
    x = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)])
    write_table(tmp_path / "short.csv", {"time_s": np.arange(100) / 100, "voltage_V": x, "displacement_um": x**2})
    made = make("recorded", options={"recording": str(tmp_path / "short.csv")})
    found = [problem.name for problem in made.problems()]
    assert {*found, *made.left_out} >= {f"n{n}-m{m}-{window}" for n, m in ORDERS for window in WINDOWS}
    assert made.left_out["n5-m3-tenth"] == "8 samples are too few for 13 weights"


def test_the_verb_lists_the_problems_of_a_set(piezobench: CommandLine, recording: Path) -> None:
    one = piezobench("problems", "--set", "recorded", "--recording", recording, "--input", "voltage_V", "--limit", 2)
    assert [line.split()[0] for line in one.stdout.splitlines()[1:]] == ["n5-m3-whole", "n5-m3-half"]


def test_a_few_problems_of_a_set_are_spread_over_its_actuators_and_drives() -> None:
    few = raced(RaceSettings(limit=3), "paper", make("paper").names())
    assert len({name.split("-")[0] for name in few}) == len({name.split("-")[1] for name in few}) == 3


@pytest.mark.parametrize("name", ["noise", "measured"])
def test_a_set_makes_only_the_problems_that_are_wanted_under_their_names(name: str) -> None:
    problem_set = make(name)
    problem_set.selected = {problem_set.names()[1]}
    assert [problem.name for problem in problem_set.problems()] == [problem_set.names()[1]]


@pytest.fixture(scope="module")
def paper() -> list[RaceProblem]:
    return list(islice(find("paper")(seed=0).problems(), 2))


@pytest.fixture(scope="module", params=[name for name, made in all_sets().items() if not made.needs])
def first(request: pytest.FixtureRequest, paper: list[RaceProblem]) -> RaceProblem:
    return paper[0] if request.param == "paper" else next(find(request.param)().problems())


@pytest.mark.parametrize("scaling", SCALINGS)
def test_the_certificate_of_a_problem_is_accepted(
    first: RaceProblem, paper: list[RaceProblem], scaling: Scaling
) -> None:
    for problem in (first, paper[1]):
        verify(problem.forms[scaling].qp, problem.forms[scaling].certificate)


def test_both_scalings_have_the_same_optimal_weights(first: RaceProblem) -> None:
    scaled, raw = (first.forms[s].to_weights @ np.array(first.forms[s].certificate.x) for s in SCALINGS)
    np.testing.assert_allclose(raw, scaled, rtol=0.0, atol=1e-6 * abs(scaled).max())


def test_the_same_seed_gives_the_same_bits_and_another_seed_another_problem(paper: list[RaceProblem]) -> None:
    again, other = (next(find("paper")(seed=seed).problems()) for seed in (0, 1))
    assert [same_problem(paper[0], problem) for problem in (again, other)] == [True, False]


@pytest.fixture(scope="module")
def by_seed() -> list[dict[str, RaceProblem]]:
    return [{problem.name: problem for problem in make("measured", seed).problems()} for seed in range(PROGRAMS + 1)]


def test_measured_actuators_are_raced_by_default_in_all_lanes_and_have_sources_and_licences() -> None:
    usual = RaceSettings()
    assert (usual.lanes, usual.problem_sets) == (("kernel", "direct", "qpsolvers", "cvxpy"), ("paper", "measured"))
    files = list(FOLDER.glob("*.npz"))
    assert len(files) == len(make("measured").names()) >= 3
    readme = (FOLDER / "README.md").read_text()
    for path in files:
        assert path.stat().st_size < 30_000
        (licence,) = re.findall(rf"`{path.name}`.*?\[(.*?)\]", readme)
        assert "MIT License" in (FOLDER / licence).read_text()


def test_every_proof_holds_and_other_seeds_use_other_samples(
    by_seed: list[dict[str, RaceProblem]],
) -> None:
    for name, problem in by_seed[0].items():
        for form in problem.forms.values():
            verify(form.qp, form.certificate)
            assert form.optimum_is_unique
        *programs, again = (problems[name].forms["raw"].qp.P.tobytes() for problems in by_seed)
        assert (len(set(programs)), again) == (PROGRAMS, programs[0])


def test_the_model_of_an_optimum_follows_the_samples_after_it_and_the_noise_is_below_its_error(
    by_seed: list[dict[str, RaceProblem]],
) -> None:
    for problem in by_seed[0].values():
        v = problem.validation
        error_um = v.error_percent(problem.optimal_weights) / 100.0 * v.span_um
        assert 0.0 < v.noise_um < 2.0 * error_um
        assert error_um < 0.02 * 2.0 * abs(v.structure.y_scale)


def test_a_file_made_from_a_recording_holds_the_sums_over_its_samples(recording: Path, tmp_path: Path) -> None:
    t, x, y = np.loadtxt(recording, delimiter=",", skiprows=1, max_rows=3500, unpack=True)
    write_table(tmp_path / "stage.csv", {"time_s": t, "voltage_V": x, "displacement_um": y})
    made_from("stage", tmp_path / "stage.csv", tmp_path)
    found = [read(tmp_path / "stage.npz", seed) for seed in range(PROGRAMS)]
    unseen, fitted = found[0][1], 2800
    np.testing.assert_allclose([unseen.x, unseen.y], [x[fitted:], y[fitted:]], rtol=1e-6, atol=1e-5)
    # Together the programs of the longest window count every sample once.
    P, q, c = (np.mean([getattr(programs[-1], name) for programs, _ in found], axis=0) for name in "Pqc")
    reference, settled = DataBasis(unseen.structure), unseen.structure.slices[1]  # of y alone, whatever the states were
    reference.update(x[:fitted], y[:fitted])
    np.testing.assert_allclose(P[settled, settled], reference.P[settled, settled], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(q[settled], reference.q[settled], rtol=1e-9, atol=1e-12)
    assert c == pytest.approx(reference.c)


@pytest.mark.parametrize(
    ("words", "recipe"),
    [
        pytest.param([], "piezobench race", id="none"),
        pytest.param(
            ["RECORDING=my stage.csv", "OPTIONS=--input voltage_V"],
            '--recording "my stage.csv" --input voltage_V',
            id="one with a blank in its name",
        ),
    ],
)
def test_make_bench_races_on_the_given_recording(words: list[str], recipe: str) -> None:
    call = ["make", "-n", "--no-print-directory", "bench", *words]
    assert subprocess.check_output(call, cwd=Path(__file__).parents[2], text=True).strip().endswith(recipe)
