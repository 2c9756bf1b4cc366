"""Problem sets: their range, contents, options and proofs."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from measured_rows import judged

from bench.messages.task import Outcome, Status
from bench.problems import RaceProblem, all_sets, make, sets
from bench.problems.protocol import SCALINGS, Scaling
from bench.problems.recorded import ORDERS, WINDOWS, Recorded, preprocessed
from bench.races.run_problems import raced
from bench.races.settings import RaceSettings
from piezo_model import HysteresisCreepModel, plants
from piezo_model.identification.error_model import Solving, accumulate, counted_from
from piezo_model.recordings import write_table
from piezo_model.signals import SIGNALS
from solvers.certificate import verify


@pytest.fixture(scope="module")
def excitation(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, RaceProblem]]:
    """Output of ``--verify`` for the set, and its problems."""
    folder = tmp_path_factory.mktemp("excitation")
    call = piezobench.run("problems", "--set", "excitation", "--verify", "--export", folder)
    problems = [RaceProblem.load(path) for path in folder.glob("*.npz")]
    return call.stdout, {problem.name: problem for problem in problems}


@pytest.fixture(scope="module")
def drift() -> list[RaceProblem]:
    return list(make("drift").problems())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the Preisach actuator, with a sensor offset."""
    sample_time = 1e-3
    plant = plants.get("relay_preisach", sample_time=sample_time)
    x = SIGNALS["multi_sine"](duration_s=6.0, sample_time=sample_time, low=0.0, high=150.0, seed=3)
    path = tmp_path_factory.mktemp("recording") / "stage.csv"
    write_table(
        path, {"time_s": np.arange(x.size) * sample_time, "voltage_V": x, "displacement_um": plant.run(x) + 7.0}
    )
    return path


@pytest.fixture(scope="module")
def recorded(recording: Path) -> list[RaceProblem]:
    return list(make("recorded", options={"recording": str(recording)}).problems())


def test_conditions_of_the_bare_problems_span_eight_decades_and_end_in_singular_ones(
    excitation: tuple[str, dict[str, RaceProblem]],
) -> None:
    bare = [problem for name, problem in excitation[1].items() if name.endswith("bare")]
    assert all(
        np.allclose(problem.forms["scaled"].qp.P.diagonal()[problem.forms["scaled"].qp.P.diagonal() > 0], 1.0)
        for problem in bare
    )
    finite = [value for problem in bare if np.isfinite(value := problem.forms["scaled"].condition)]
    assert min(finite) < 3e4
    assert max(finite) > 5e11
    assert len({int(np.log10(value)) for value in finite}) >= 6
    assert any(not problem.forms["scaled"].certificate.unique for problem in bare)
    assert any(problem.forms["scaled"].certificate.convexity_shift > 0 for problem in bare)


def test_a_forward_program_leads_from_its_start_to_the_weights_of_the_next_step() -> None:
    problems = list(make("forward").problems())
    assert len(problems) == len(make("forward").names())
    for first, second in pairwise(problems):
        form = second.forms["raw"]
        if first.name.partition("-step")[0] == second.name.partition("-step")[0]:
            np.testing.assert_allclose(form.to_weights @ form.starts["warm"], first.optimal_weights, atol=1e-6)
        assert form.optimum_is_unique
        assert len(form.windows) == 1
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
        certificate = problem.forms["scaled"].certificate
        assert ("not unique" in lines[name]) == (not certificate.unique)
        assert ("since rounding left P indefinite" in lines[name]) == (certificate.convexity_shift > 0)
        assert ("singular" in lines[name]) == (not problem.forms["scaled"].optimum_is_unique)


@pytest.mark.parametrize("scaling", SCALINGS)
def test_weights_are_not_judged_if_the_optimum_is_not_unique(
    excitation: tuple[str, dict[str, RaceProblem]], scaling: Scaling
) -> None:
    for problem in excitation[1].values():
        form = problem.forms[scaling]
        verdict = judged(problem, scaling, Outcome(found=True, x=np.array(form.certificate.x)))
        assert verdict.status == Status.OK
        assert np.isnan(verdict.weight_error) == (not form.optimum_is_unique)


def test_snapshots_of_the_drift_follow_each_other_every_quarter_of_a_second(drift: list[RaceProblem]) -> None:
    assert len(drift) == len(make("drift").names()) == len({problem.name for problem in drift})
    times = [float(problem.name.strip("ts")) for problem in drift]
    assert np.allclose(np.diff(times), 0.25)


@pytest.mark.parametrize("scaling", SCALINGS)
def test_a_warm_start_is_the_optimum_before_it_and_feasible(drift: list[RaceProblem], scaling: Scaling) -> None:
    for before, problem in pairwise(drift):
        form = problem.forms[scaling]
        np.testing.assert_allclose(form.to_weights @ form.starts["warm"], before.optimal_weights, rtol=0.0, atol=1e-9)
        assert np.all(form.starts["warm"] >= form.qp.lb)
        line = HysteresisCreepModel.from_weights(problem.validation.structure, form.to_weights @ form.starts["line"])
        x = np.linspace(*problem.validation.structure.x_range, 9)
        np.testing.assert_allclose(np.diff(line.simulate(x), 2), 0.0, atol=1e-9)


def test_the_optimum_moves_with_the_gain_and_a_warm_start_is_nearer_to_it_than_the_start_of_the_drift(
    drift: list[RaceProblem],
) -> None:
    moved = [float(np.max(np.abs(problem.optimal_weights - drift[0].optimal_weights))) for problem in drift[16:]]
    steps = [float(np.max(np.abs(b.optimal_weights - a.optimal_weights))) for a, b in pairwise(drift[15:])]
    assert 0.0 < np.median(steps) < np.median(moved)


def test_a_recording_gives_problems_of_every_order_over_every_window(recorded: list[RaceProblem]) -> None:
    names = [problem.name for problem in recorded]
    assert len(names) == len({*names}) == (len(ORDERS) + 1) * len(WINDOWS)  # and those of identify's own model
    assert {f"n{n}-m{m}-{window}" for n, m in ORDERS for window in WINDOWS} < {*names}
    for problem in recorded[:4]:
        for form in problem.forms.values():
            verify(form.qp, form.certificate)


def test_the_last_fifth_of_a_recording_validates_models_with_a_free_offset(
    recorded: list[RaceProblem], recording: Path
) -> None:
    x, y = np.loadtxt(recording, delimiter=",", skiprows=1, unpack=True)[1:]
    for problem in recorded:
        v = problem.validation
        assert v is not None
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
    fitted, _ = made._parts
    assert fitted.starts == (0, 2000)
    prepared = preprocessed(fitted, 5, 3, made._orders_and_rates[1])
    alone = accumulate(fitted, counted_from(fitted, 0), prepared.structure, prepared.fit.states, Solving())
    np.testing.assert_allclose(problem.forms["scaled"].qp.P, alone.qp.P, atol=1e-12)


@pytest.mark.slow
def test_a_race_reads_a_recording_with_the_options_of_identify(tmp_path: Path, piezobench: CommandLine) -> None:
    """Semicolons, decimal commas, no header, no times, and the output before the input."""
    x = SIGNALS["multi_sine"](duration_s=3.0, sample_time=1e-3, low=0.0, high=150.0, seed=3)
    y = plants.get("relay_preisach", sample_time=1e-3).run(x)
    (tmp_path / "stage.txt").write_text(
        "".join(f"{b:.6f};{a:.6f}\n".replace(".", ",") for a, b in zip(x, y, strict=True))
    )
    reading = (
        "--recording",
        tmp_path / "stage.txt",
        "--header-row",
        0,
        "--decimal",
        ",",
        "--sample-rate",
        1000,
        "--input",
        2,
        "--output",
        1,
    )
    listed = piezobench("problems", "--set", "recorded", "--limit", 1, *reading)
    assert "n5-m3-whole" in listed.stdout, listed.stderr
    piezobench.run(
        "race",
        *reading,
        "--solver",
        "box_active_set",
        "--lane",
        "kernel",
        "--limit",
        1,
        "--out",
        tmp_path,
        "--name",
        "run",
    )
    options = json.loads((tmp_path / "run/run.json").read_text())["settings"]["set_options"]
    assert options == {
        "recording": str(tmp_path / "stage.txt"),
        "input": "2",
        "output": "1",
        "sample_time": "0.001",
        "header_row": "0",
        "decimal": ",",
    }
    refused = piezobench("race", *reading[:2], "--sheet", "two", "--sample-time", "later", "--out", tmp_path)
    assert refused.status == 2
    assert "--sample-time" in refused.stderr


def test_windows_that_are_too_short_are_left_out_with_the_reason(tmp_path: Path) -> None:
    x = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)])
    write_table(tmp_path / "short.csv", {"time_s": np.arange(100) / 100, "voltage_V": x, "displacement_um": x**2})
    made = make("recorded", options={"recording": str(tmp_path / "short.csv")})
    found = [problem.name for problem in made.problems()]
    assert {*found, *made.left_out} >= {f"n{n}-m{m}-{window}" for n, m in ORDERS for window in WINDOWS}
    assert made.left_out["n5-m3-tenth"] == "8 samples are too few for 13 weights"


def test_sets_that_need_a_file_are_not_among_those_of_a_seed() -> None:
    assert set(all_sets()) - set(sets()) == {"recorded", "foreign", "test_set"}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--set", "recorded"), "'recorded' needs --recording, a recording in any known format"),
        (("--set", "foreign"), "needs --folder"),
        (("--set", "recorded", "--recording", "none.csv"), "none.csv: no such file"),
        (("--set", "foreign", "--folder", "nowhere"), "nowhere: is not a folder"),
        (("--set", "unheard"), "there is no problem set 'unheard'; known are boxes, drift, "),
        (("--from", "nowhere"), "nowhere: is not a folder"),
        (("--verify",), "needs problems; name a --set"),
    ],
)
def test_missing_options_and_files_are_refused_in_one_sentence(
    piezobench: CommandLine, words: tuple[str, ...], sentence: str
) -> None:
    assert sentence in piezobench("problems", *words).refusal


def test_the_verb_lists_the_problems_of_a_set(piezobench: CommandLine, recording: Path) -> None:
    one = piezobench("problems", "--set", "recorded", "--recording", recording, "--input", "voltage_V", "--limit", 2)
    assert [line.split()[0] for line in one.stdout.splitlines()[1:]] == ["n5-m3-whole", "n5-m3-half"]


def test_a_few_problems_of_a_set_are_spread_over_its_actuators_and_drives() -> None:
    few = raced(RaceSettings(limit=3), "paper", make("paper").names())
    assert len({name.split("-")[0] for name in few}) == len({name.split("-")[1] for name in few}) == 3


def test_a_set_makes_only_the_problems_that_are_wanted_under_their_names() -> None:
    for name in ("noise", "measured"):
        problem_set = make(name)
        problem_set.wanted = {problem_set.names()[1]}
        assert [problem.name for problem in problem_set.problems()] == [problem_set.names()[1]]
