"""Decisions: the rule on tables made by hand, the file, and a compensator that starts from it."""

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from command_line import CommandLine
from hostile_files import MODEL, STRUCTURE, change_machine
from measured_rows import columns_at, row
from pyarrow import parquet
from small_races import REFERENCE, Race

from bench.deploy.actuator_model import model_for
from bench.deploy.candidates import QUANTILES, UNOBSERVED_SHARE, Rule, explained
from bench.deploy.decision import Decision, decide
from bench.deploy.deployment import Deployment
from bench.derived.measurements import Measurements
from bench.derived.summary import summary
from bench.messages.task import Row
from bench.race_table import ROWS
from bench.store import TIMES, Run, RunError
from bench.timing import machine
from bench.timing.percentiles import rate_bound
from piezo_model import ModelError, SelfLearningCompensator, plants
from solvers import Lane, find
from solvers.protocol import setting_text

ACCELERATED, STEPPED = "accelerated_projection", "projected_difference"
CALLS = 3000
Us = Callable[[int], np.ndarray]


def ladder_of(solver: str, lane: str = "direct") -> list[str]:
    """Settings on the ladder of a real solver."""
    cls = find(solver, lane).load()
    return [setting_text({**cls.fixed_settings, **rung}) for rung in cls.ladder(1.0)]


def racer(
    solver: str,
    gaps: Sequence[Sequence[float]] = ((0.0,), (0.0,)),
    us: Us | float = 5.0,
    calls: int = CALLS,
    lane: str = "direct",
    names: Sequence[str] | None = None,
    **columns: object,
) -> list[tuple[Row, np.ndarray]]:
    """Rows of a solver lane with times in µs, for gaps by problem and rung; a list gives a column by problem."""
    names, rows = names or ladder_of(solver, lane), []
    for problem, by_rung in enumerate(gaps):
        for rung, gap in enumerate(by_rung):
            times = us(calls // len(gaps)) if callable(us) else np.full(calls // len(gaps), us)
            ordinary = {
                "problem": f"p{problem}",
                "solver": solver,
                "lane": lane,
                "setting": names[rung],
                "rung": rung,
                "cost_gap": gap,
                "solve_us_p50": float(np.median(times)),
                "samples": times.size,
            }
            rows.append((row(**{**ordinary, **columns_at(problem, columns)}), times))
    return rows


def nothing(us: Us | float = 0.1, calls: int = CALLS) -> list[tuple[Row, np.ndarray]]:
    """The solver that does nothing."""
    return racer("null", ((math.inf,), (math.inf,)), us, calls, names=["{}"], rung=-1, is_default=True)


def run_of(
    folder: Path,
    *parts: Iterable[tuple[Row, np.ndarray]],
) -> Run:
    """A finished run with these rows and times."""
    made, here = Run.create(folder, {"settings": {}}, "run"), machine.describe()
    (made.path / "parts").rmdir()
    (made.path / "machines").mkdir()
    (made.path / "machines" / f"{machine.key(here)}.json").write_text(json.dumps(here))
    both = [each for part in parts for each in part]
    parquet.write_table(
        pa.Table.from_pylist([{**one, "machine": machine.key(here)} for one, _ in both], ROWS),
        made.path / "rows.parquet",
    )
    times = [
        {**{name: one.get(name) for name in TIMES.names[:4]}, "what": name, "ns": np.round(1e3 * ns).astype(np.int64)}
        for one, us in both
        for name, ns in (("solve", us), ("update", 0.0 * us), *([("response", us)] if one["due"] else []))
    ]
    parquet.write_table(pa.Table.from_pylist(times, TIMES), made.path / "times.parquet")
    return made


def ranked(decision: Decision) -> list[str]:
    """The solvers that qualify, best first."""
    return [each.solver for each in (decision.chosen, *decision.runners_up)]


def reasons(decision: Decision) -> dict[str, str]:
    """Why each of the others does not."""
    return {each.solver: why for each, why in decision.refused}


LENIENT = Rule(deadline_us=1e6)


@pytest.mark.parametrize(
    ("accuracy", "gaps", "rung", "margin"),
    [
        (1e-9, ((1e-5, 1e-7, 9e-11, 1e-13), (1e-5, 9e-11, 9e-11, 1e-13)), 2, 10.0),
        (1e-9, ((1e-5, 1e-7, 5e-10, 2e-10), (1e-5, 2e-10, 1e-10, 2e-10)), 3, 3.0),
        (1e-9, ((1e-5, 9e-10, 5e-10, 5e-10), (9e-10, 9e-10, 5e-10, 5e-10)), 1, 1.0),
        (1e-3, ((1e-4, 3e-6, 2e-9), (1e-5, 3e-6, 2e-9)), 0, 10.0),
        (4e-5, ((1e-4, 3e-6, 2e-9), (1e-5, 3e-6, 2e-9)), 1, 10.0),
    ],
)
def test_a_solver_lane_has_the_loosest_setting_within_the_accuracy_ten_times_over_everywhere_else_three_times_else_once(
    tmp_path: Path, accuracy: float, gaps: Sequence[Sequence[float]], rung: int, margin: float
) -> None:
    decision = decide(run_of(tmp_path, nothing(), racer("osqp", gaps)), Rule(accuracy, 1e6))
    it = decision.chosen
    setting, worst = ladder_of("osqp")[rung], max(by_rung[rung] for by_rung in gaps)
    assert (it.setting, it.settings, it.worst, it.margin) == (setting, json.loads(setting), worst, margin)
    assert decision.runners_up == decision.refused == ()
    assert f"a margin of {margin:g};" in decision.sentences()[1]


@pytest.mark.parametrize(
    "spoiled",
    [
        {"timed_gap": [0.0, 1e-6]},
        {"violation": [0.0, 1e-6]},
        {"status": ["answered", "unsupported"]},
        {"status": ["answered", "not_run"]},
        {"cost_gap": [0.0, math.nan]},
        {"message": ["", "says 'exit flag -4'"]},
    ],
)
def test_a_wrong_timed_answer_a_violation_and_a_problem_without_an_answer_count_as_not_right(
    tmp_path: Path, spoiled: Mapping[str, object]
) -> None:
    decision = decide(
        run_of(tmp_path, nothing(), racer("daqp", ((0.0,), (0.0,)), 1.0, **spoiled), racer("box_active_set")), LENIENT
    )
    assert decision.chosen.solver == "box_active_set"
    (reason,) = reasons(decision).values()
    assert reason.startswith("has a cost gap or violation above 1e-09 on 1 of 2 problems at its best")


def test_a_setting_that_a_time_limit_skipped_in_one_repeat_counts_as_in_the_report(tmp_path: Path) -> None:
    run = run_of(
        tmp_path,
        nothing(),
        racer("daqp"),
        racer("daqp", calls=2, repeat=1, status="not_run", cost_gap=math.nan, samples=0),
    )
    chosen, reported = decide(run, LENIENT).chosen, Measurements.of(run).settings.set_index("tier")
    assert (chosen.solver, chosen.margin, reported.margin["high"]) == ("daqp", 10.0, 10.0)


@pytest.mark.parametrize(
    ("fewest", "by", "name"), [(3000, 0, "p99.9"), (2000, 1, "p99"), (200, 2, "median"), (2, 2, "median")]
)
def test_the_finest_percentile_that_all_candidates_support_decides_and_few_calls_exclude_none(
    tmp_path: Path, fewest: int, by: int, name: str
) -> None:
    run = run_of(
        tmp_path,
        nothing(),
        racer("box_active_set", us=2.0),
        racer("daqp", us=1.0, calls=fewest),
        racer("osqp", ((1.0,), (1.0,)), calls=2),
    )
    decision = decide(run, LENIENT)
    assert (decision.by, ranked(decision)) == (by, ["daqp", "box_active_set"])
    assert f"; {name} of an answer 1 µs on the machine of the run (" in decision.sentences()[1]
    needed = {0: "", 1: "p99.9 needs 2995 samples", 2: "p99 needs 299 samples"}[by]
    sentence = (
        f"Decided by the {name}, the finest percentile that all who qualify support: {needed} and has {fewest} "
        f"for {decision.chosen.name}."
    )
    assert (sentence in decision.sentences()) == (by > 0)


SELDOM_LATE = np.where(np.isin(np.arange(3000), (10, 700, 2000)), 80.5, 0.5)


@pytest.mark.parametrize(
    ("series", "answers", "expected"),
    [
        ([SELDOM_LATE], np.full(1000, 0.5), math.ceil(min(UNOBSERVED_SHARE, rate_bound(0, 3000)) * 1000)),
        pytest.param([np.full(500, 0.4), np.full(500, 0.8)], np.full(3000, 124.0), 30, id="each series has its level"),
        ([SELDOM_LATE], np.full(1000, 10.0), math.ceil(min(UNOBSERVED_SHARE, rate_bound(0, 150)) * 1000)),
        ([SELDOM_LATE], np.full(1000, 50.0), math.ceil(1000 * min(3 / 30 + UNOBSERVED_SHARE, rate_bound(3, 30)))),
        pytest.param([np.full(30, 1.0)], np.full(3000, 30.0), 30, id="unseen: one in a hundred at most"),
        pytest.param([np.full(100, 500.0)], np.full(100, 126.0), 0, id="the median is late"),
        pytest.param([], np.full(100, 1.0), 0, id="the floor was not measured"),
        pytest.param([np.full(100, 0.1)], np.zeros(0), 0, id="no answers"),
    ],
)
def test_the_machine_explains_the_misses_of_its_floor_in_blocks_as_long_as_an_answer_and_at_most_a_hundredth_unseen(
    series: list[np.ndarray], answers: np.ndarray, expected: int
) -> None:
    fewest, most = explained(series, answers, 125.0)
    assert 0 <= fewest <= most == expected


def now_and_then(calls: int) -> np.ndarray:
    """Times, every fourth one late."""
    return np.where(np.arange(calls) % 4, 1.0, 300.0)


def test_deadlines_missed_beyond_the_floor_disqualify_unless_they_are_allowed(tmp_path: Path) -> None:
    busy = decide(run_of(tmp_path / "busy", nothing(now_and_then), racer("daqp", us=now_and_then)), Rule())
    own = 750 - math.floor(3000 * (1.0 - rate_bound(2250, 3000)))
    assert (busy.chosen.missed, busy.chosen.own_misses) == (750, (0, own))
    assert f"0 to {own} of them its own, which this run cannot narrow down" in busy.sentences()[1]
    run = run_of(tmp_path, nothing(), racer("box_active_set", us=2.0), racer("daqp", us=now_and_then))
    strict = decide(run, Rule())
    assert re.fullmatch(
        "misses 750 of 3000 deadlines, .* more than the machine itself explains", reasons(strict)["daqp"]
    )
    assert "none of them its own" in strict.sentences()[1]
    assert (ranked(strict), ranked(decide(run, Rule(misses=10**6)))) == (["box_active_set"], ["box_active_set", "daqp"])


def test_the_lowest_tail_wins_runners_up_are_in_order_and_the_nearest_is_refused_first(tmp_path: Path) -> None:
    chance = np.random.default_rng(0)
    run = run_of(
        tmp_path,
        nothing(),
        racer("box_active_set", us=lambda n: 0.5 + 20.0 * (chance.random(n) < 0.05)),
        racer("quadprog", us=3.0),
        racer("pyqpmad", us=lambda n: 1.0 + 0.1 * chance.random(n)),
        racer("daqp", ((0.0,), (1e-3,)), 1.0),
        racer("osqp", us=200.0),
        racer("clarabel", us=lambda n: np.where(np.arange(n) % 9, 1.0, 300.0)),
        racer("mine", us=0.5, names=["{}"]),
    )
    decision = decide(run, Rule())
    assert ranked(decision) == ["pyqpmad", "quadprog", "box_active_set"]
    refused = reasons(decision)
    assert refused.pop("mine") == (
        "comes from a solver file of your own or an older version, and a compensator can start only solvers that are "
        "installed with piezobench"
    )
    assert [*refused] == ["clarabel", "osqp", "daqp"]
    assert "4 solver lanes do not qualify." in decision.sentences()


NONE_RACED = "no solver qualifies, none was raced on scaled data in the lanes "


@pytest.mark.parametrize(
    ("part", "rule", "sentence"),
    [
        pytest.param(racer("daqp", scaling="raw"), LENIENT, NONE_RACED, id="raw data"),
        pytest.param(racer("daqp", start="warm"), LENIENT, NONE_RACED, id="warm starts"),
        pytest.param(
            racer("daqp"), Rule(lanes=(Lane.CVXPY,), deadline_us=1e6), NONE_RACED, id="lanes that a controller lacks"
        ),
        pytest.param(
            racer("daqp"),
            Rule(deadline_us=0.05),
            "a solver that does nothing misses 3000 of 3000 deadlines of 0.05 µs, so this run says nothing",
            id="a deadline that the solver that does nothing misses",
        ),
        pytest.param(
            racer("daqp", names=['{"eps": 0.5}']),
            LENIENT,
            "the nearest, daqp (direct, eps 0.5), was raced at a setting that its ladder no longer has, so race it",
            id="a setting that the ladder no longer has",
        ),
    ],
)
def test_a_run_in_which_no_solver_qualifies_is_refused_with_the_reason(
    tmp_path: Path, part: list, rule: Rule, sentence: str
) -> None:
    with pytest.raises(RunError, match=re.escape(sentence)):
        decide(run_of(tmp_path, nothing(), part), rule)


def test_a_percentile_is_the_same_in_the_decision_and_in_the_report(tmp_path: Path) -> None:
    run = run_of(tmp_path, nothing(), racer("daqp", us=lambda n: 1.0 + np.arange(n) % 97))
    shown = summary(Measurements.of(run))
    (p99,) = set(shown[(shown.solver == "daqp") & (shown.tier == "high")].answer_us_p99)
    assert decide(run, LENIENT).chosen.times_us[QUANTILES.index(0.99)] == pytest.approx(p99)


@pytest.mark.parametrize(("bouts", "chosen"), [(2, "daqp"), (40, "quadprog")])
def test_a_solver_that_is_late_on_the_schedule_more_often_than_the_machine_does_not_qualify(
    tmp_path: Path, bouts: int, chosen: str
) -> None:
    def on_schedule(solver: str, setting: str, bouts: int) -> list[tuple[Row, np.ndarray]]:
        at_8_khz = {"timed": "scheduled", "due": 3000, "late": bouts, "bouts": bouts, "samples": 3000}
        return [(row(problem="p0", solver=solver, setting=setting, **at_8_khz), np.full(3000, 2.0))]

    run = run_of(
        tmp_path,
        nothing(),
        racer("daqp", us=1.0),
        racer("quadprog", us=2.0),
        on_schedule("null", "{}", 2),
        on_schedule("daqp", ladder_of("daqp")[0], bouts),
        on_schedule("quadprog", ladder_of("quadprog")[0], 2),
    )
    decision = decide(run, LENIENT)
    assert decision.chosen.solver == chosen
    assert (chosen == "daqp") or "is late on the schedule" in reasons(decision)["daqp"]


def test_the_reference_run_gives_a_compensator_that_runs_and_learns(piezobench: CommandLine, tmp_path: Path) -> None:
    call = piezobench.run("deploy", REFERENCE, "--out", tmp_path / "compensator.json", "--simulated")
    assert re.search(
        "Chosen: .*Model: from the problem paper/bouc_wen-multi_sine, simulated\\.", call.stdout, re.DOTALL
    )
    learner = Deployment.load(tmp_path / "compensator.json").learner(reset_s=0.01, build_s=0.2, learn_s=0.05)
    s = learner.structure
    y_ref = s.y_centre + 0.7 * s.y_scale * np.sin(np.arange(6000) / 300)
    x, y = learner.run(y_ref, plants.get("bouc_wen", sample_time=s.sample_time).run)
    assert np.all(np.abs(x - s.x_centre) <= s.x_scale)
    assert np.ptp(x) > 0.3 * s.x_scale
    assert np.sqrt(np.mean((y - y_ref)[1000:] ** 2)) < 0.1 * s.y_scale
    assert any(event.what in ("hand-over", "refused") for event in learner.log)


@pytest.mark.sample(4)
@pytest.mark.parametrize("elsewhere", [True, False])
@pytest.mark.parametrize(
    "words",
    [
        ("deploy", "run", "--out", "c.json", "--deadline", 1e6, "--simulated"),
        ("report", "run"),
        ("compare", "run", "run", "--out", "same"),
    ],
    ids=lambda words: words[0],
)
def test_times_of_another_machine_are_said_to_be_of_it_and_those_of_this_one_are_not(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path, words: tuple[object, ...], elsewhere: bool
) -> None:
    run, this = wide_race.copied(tmp_path / "run"), machine.name(machine.describe())
    if elsewhere:
        change_machine(run.path, processor="Abacus 3000", cores=1, core="wood, hand 1.0")
    output = piezobench.quietly(*words, folder=tmp_path).said
    there = "Abacus 3000, 1 core, wood, hand 1.0" if elsewhere else this
    assert words[0] != "deploy" or f"µs on the machine of the run ({there})." in output
    assert elsewhere == output.count(
        f"The run run was measured on another machine, {there}. Times on this one, {this}, differ: race here, too."
    )


def test_the_file_holds_the_decision_and_its_evidence(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    call = piezobench(
        "deploy", wide_race.run.path, "--out", tmp_path / "c.json", "--deadline", 1e6, "--simulated", "--json"
    )
    printed, written = json.loads(call.stdout), json.loads((tmp_path / "c.json").read_text())
    assert (written["format"], written["version"]) == ("piezobench-compensator", 3)
    assert all(written[name] == printed[name] for name in ("solver", "lane", "tier", "settings"))
    assert setting_text(written["settings"]) in ladder_of(written["solver"], written["lane"])
    evidence, run = written["evidence"], wide_race.run
    certificate, figures = evidence["certificate"], evidence["figures"]
    assert (evidence["run"], evidence["machines"], figures["right"]) == (
        run.path.name,
        run.machines,
        figures["problems"],
    )
    assert (certificate["unique"], certificate["cost_gap"] < 1e-12) == (True, True)
    assert evidence["model_from"] == printed["model_from"] == f"the problem {certificate['problem_of_run']}, simulated"
    assert (printed["error_percent"], printed["last_fifth"]) == (None, "")
    assert Deployment.load(tmp_path / "c.json").model.weights == pytest.approx(
        run.problem(*certificate["problem_of_run"].split("/")).optimal_weights, rel=1e-12, abs=1e-15
    )


def test_a_problem_can_be_named(wide_race: Race) -> None:
    names = ["/".join(name) for name in wide_race.rows[["problem_set", "problem"]].drop_duplicates().to_numpy()]
    models = [model_for(wide_race.run, problem=name, simulated=True) for name in names]
    assert [model.certificate["problem_of_run"] for model in models] == names


@pytest.mark.parametrize(
    ("fastest", "where"),
    [
        ("daqp", "in C and in piezobench live with box_active_set, in Python with daqp."),
        ("box_active_set", "in C and in piezobench live with box_active_set, in Python with it, too."),
    ],
)
def test_what_is_deployed_learns_continuously_and_a_sentence_says_with_which_solver_where(
    tmp_path: Path, fastest: str, where: str
) -> None:
    decision = decide(
        run_of(tmp_path, nothing(), racer(fastest, ((1e-13,) * len(ladder_of(fastest)),) * 2)),
        LENIENT,
    )
    assert f"The compensator learns continuously: {where}" in [text.replace("†", "") for text in decision.sentences()]
    loaded = saved_and_loaded(
        decision.deployment(model_for(decision.run, SelfLearningCompensator(STRUCTURE).model)), tmp_path
    )
    learner = loaded.learner()
    used = (learner.mode, learner.settings.solver, loaded.evidence["figures"]["solver"])
    assert used == ("continuous", fastest, fastest)


def saved_and_loaded(made: Deployment, folder: Path) -> Deployment:
    made.save(folder / "c.json")
    return Deployment.load(folder / "c.json")


def deployment(**changes: object) -> Deployment:
    usual = {"solver": "box_active_set", "lane": "kernel", "tier": "mid", "settings": {}, "mode": "cyclic"}
    return Deployment(**{"model": MODEL, "x_limits": (1.0, 9.0), **usual, **changes})


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda data: data.pop("solver"), "'solver' is missing"),
        (lambda data: data.update(version=2), "version 2 is not 3, the one this program reads; deploy again"),
        (lambda data: data.update(format="x"), "format"),
        (lambda data: data.update(x_limits=[1, 0]), "x_limits"),
        (lambda data: data.update(mode="lazy"), "'lazy'"),
        (lambda data: data["model"].pop("w_H"), "w_H"),
        (lambda data: data.pop("model"), "'model' is missing"),
        (lambda data: data["model"].update(version=2), "model: version 2 is not 3, the one this"),
    ],
)
def test_a_damaged_file_is_refused_in_one_sentence_that_names_it(
    tmp_path: Path, change: Callable[[dict], object], reason: str
) -> None:
    path = tmp_path / "c.json"
    deployment().save(path)
    change(data := json.loads(path.read_text()))
    path.write_text(json.dumps(data))
    with pytest.raises(ModelError, match=rf"\A{path}[^\n]*{reason}[^\n]*\Z"):
        Deployment.load(path)


def test_a_loaded_file_is_the_saved_one_and_its_tolerances_follow_from_the_constant_of_each_problem(
    tmp_path: Path,
) -> None:
    cls = find("osqp", "direct").load()
    made = deployment(solver="osqp", lane="direct", settings={**cls.fixed_settings, **cls.ladder(1.0)[1]})
    loaded = saved_and_loaded(made, tmp_path)
    assert (loaded.settings, loaded.tier, loaded.learning) == (made.settings, made.tier, made.learning)
    options = loaded.learning["solver_options"]
    assert cls.at(options["setting"], 1.0) == cls.ladder(1.0)[1]
    assert cls.at(options["setting"], 250.0) == cls.ladder(250.0)[1] != cls.ladder(1.0)[1]
    assert loaded.learner().settings.solver_options == options


@pytest.mark.parametrize(
    "changes",
    [
        {"x_limits": np.array([0, 150])},
        {"evidence": {"rms": np.float32(0.1), "curve": np.arange(3), "gap": np.inf}},
    ],
)
def test_numbers_of_numpy_are_saved_and_loaded(changes: dict[str, object], tmp_path: Path) -> None:
    saved_and_loaded(deployment(**changes), tmp_path).save(tmp_path / "again")
    assert (tmp_path / "again").read_text() == (tmp_path / "c.json").read_text()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"x_limits": (-np.inf, np.inf)}, "x_limits must be two finite numbers in ascending order"),
        ({"x_limits": (5.0, 1.0)}, "x_limits must be two finite numbers in ascending order"),
        ({"tier": "best"}, "'best' is not a valid Tier"),
        ({"solver": "nobody"}, "there is no solver 'nobody'"),
        ({"evidence": {"run": 1j}}, "evidence.run is a complex, which a file cannot hold"),
        *(
            ({"solver": solver, "settings": settings}, f"{solver} has no setting ")
            for solver, settings in (
                (ACCELERATED, {"tolerance": 0.5}),
                (ACCELERATED, {"tolerance": {}}),
                (ACCELERATED, {"setting": 99}),
                (ACCELERATED, {"rung": 2}),
                (ACCELERATED, {"lane": "none"}),
                (STEPPED, {"steps": None}),
                (STEPPED, {"steps": 2**70}),
                (STEPPED, {"tolerance": {}}),
            )
        ),
    ],
    ids=str,
)
def test_what_no_compensator_or_file_can_have_is_refused_and_the_file_stays(
    changes: dict[str, object], sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "c.json"
    path.write_text("an older file")
    with pytest.raises(ValueError, match=rf"^[^\n]*{sentence}[^\n]*$"):
        deployment(**changes).save(path)
    assert path.read_text() == "an older file"
    if "settings" in changes:  # and in a file
        solver = changes["solver"]
        deployment(solver=solver, settings=dict(find(solver).load().ladder(1.0)[0])).save(path)
        path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
        with pytest.raises(ModelError, match=rf"^[^\n]*c\.json: {sentence}[^\n]*; its ladder goes from [^\n]*$"):
            Deployment.load(path)


def test_a_compensator_starts_with_its_model_solver_and_limits_and_other_options(tmp_path: Path) -> None:
    learner = saved_and_loaded(deployment(solver=STEPPED, settings={"steps": 100}), tmp_path).learner(build_s=1.0)
    chosen = learner.settings
    assert (chosen.solver, chosen.x_limits, chosen.build_s) == (STEPPED, (1.0, 9.0), 1.0)
    assert (learner.structure, learner.step(1e9, math.nan)) == (MODEL.structure, 9.0)
