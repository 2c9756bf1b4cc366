"""How exact an answer is within so many sampling periods: on tables by hand, and by a race with limits of
iterations."""

import json
import math

import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from conftest import Race, raced
from measured_rows import measured, row

import solvers
from bench.derived.anytime import BUDGETS, anytime, sentences
from bench.derived.ranking import PACE
from bench.races.kind import kinds
from bench.races.oneshot.settings import AnytimeSettings
from solvers.certificate import exact_cost_gap

Points = list[tuple[float, float]]


def points(solver: str, *those: tuple[float, float], **known: object) -> list[dict[str, object]]:
    """Rows of one problem from (periods, gap), each of another limit."""
    return [
        row(
            **{
                "solver": solver,
                "solve_us_p50": 125.0 * periods,
                "cost_gap": gap,
                "setting": f"{solver}{i}",
                "rung": -1,
                **known,
            }
        )
        for i, (periods, gap) in enumerate(those)
    ]


def steps(*those: tuple[int, float, float]) -> list[dict[str, object]]:
    """Rows of the paper's method from (steps, periods that they take, gap)."""
    return [
        found
        for count, periods, gap in those
        for found in points(
            "projected_difference",
            (periods, gap),
            lane="kernel",
            setting=str(count),
            periods=float(count),
            settings=json.dumps({"steps": count}),
        )
    ]


GROWING = ((0.4, 1.0), (1.7, 0.1), (3.0, 0.3), (60.0, 1e-9))
OF_STEPS = steps((1, 0.01, 0.9), (100, 0.2, 0.5), (15_200, 5.0, 0.1))
A_PROBLEM_WITHOUT_AN_ANSWER = [
    *points("a", (0.5, 1e-3)),
    *points("a", (0.5, 1e-6), problem="p2"),
    *points("b", (0.5, 1e-4)),
    *points("b", (0.5, math.nan), problem="p2", status="solver_failed"),
]
SETTINGS_AND_LIMITS = [
    *points("a", (0.5, 1e-2)),
    *points("a", (0.5, 1e-4), rung=3, setting="s3"),
    *points("a", (0.5, 1e-3), is_default=True, setting="{}"),
]


@pytest.mark.parametrize(
    ("rows", "name", "which", "expected"),
    [
        pytest.param(
            points("a", *GROWING),
            "a",
            "median_gap",
            {budget: min(gap for at, gap in GROWING if at <= budget) for budget in BUDGETS},
            id="the best so far",
        ),
        pytest.param(
            points("a", (7.0, 0.5)),
            "a",
            "median_gap",
            dict(zip(BUDGETS[:5], (math.inf, math.inf, math.inf, 0.5, 0.5), strict=True)),
            id="nothing before the first point",
        ),
        pytest.param(SETTINGS_AND_LIMITS, "a", "median_gap", {1: 1e-4}, id="settings and limits count alike"),
        pytest.param(OF_STEPS, "projected_difference†", "median_gap", {1: 0.5, 5: 0.1}, id="as many steps as fit"),
        pytest.param(
            OF_STEPS, PACE, "median_gap", {1: 0.9, 100: 0.5, 10_000: 0.5, 15_200: 0.1}, id="a step takes a sample"
        ),
        *(
            pytest.param(A_PROBLEM_WITHOUT_AN_ANSWER, name, which, {1: gap}, id=f"{name} on two problems, {which}")
            for name, gap in (("a", 1e-3), ("b", math.inf))
            for which in ("median_gap", "worst_gap")
        ),
    ],
)
def test_the_gap_within_a_budget_is_the_best_by_then_on_the_median_and_the_worst_problem(
    rows: list[dict[str, object]], name: str, which: str, expected: dict[int, float]
) -> None:
    table = anytime(measured(rows))
    assert table[table.name == name].set_index("budget")[which].loc[list(expected)].to_dict() == expected


def test_warm_starts_other_scalings_and_the_floor_do_not_count() -> None:
    rows = [
        *points("a", (0.5, 1e-2)),
        *points("a", (0.5, 1e-9), start="warm"),
        *points("a", (0.5, 1e-9), scaling="raw"),
        *points("null", (0.1, math.nan), status="solver_failed"),
    ]
    table = anytime(measured(rows))
    assert set(table.name) == {"a"}
    assert (table.median_gap == 1e-2).all()


def test_it_says_who_is_exact_and_compares_the_papers_pace_with_what_fits() -> None:
    rows = [*points("a", (0.5, 1e-12)), *points("b", (0.5, 1e-3)), *steps((1, 0.01, 0.9), (15_200, 4.0, 0.1))]
    exact, paper = sentences(anytime(measured(rows)))
    assert exact == (
        "Within one sampling period 1 of 3 solver lanes reach a cost gap of 1e-09 on the median problem; "
        "the closest is a (direct) "
        "with 1.0e-12."
    )
    assert paper.endswith(
        "begins at 9.0e-01 and is at 1.0e-01 after 15200 periods; with as many steps as fit into the "
        "time it is there within 5."
    )


def limited(race: Race, solver: str, lane: str = "direct") -> pd.DataFrame:
    """The rows of limits, by limit."""
    name = "steps" if solver == "projected_difference" else "max_iter"
    rows = race.rows[(race.rows.solver == solver) & (race.rows.lane == lane)]
    rows = rows[(rows.rung < 0) & ~rows.is_default]
    return rows.assign(limit=[json.loads(text)[name] for text in rows.settings]).sort_values("limit")


@pytest.fixture(scope="module")
def race(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    words = ("--race", "anytime", "--lane", "kernel", "--solver", "piqp", "--solver", "projected_difference")
    return raced(piezobench, tmp_path_factory.mktemp("anytime"), "run", *words, "--rounds", 0)


def test_a_race_measures_settings_and_limits_on_scaled_data(race: Race) -> None:
    assert set(race.rows.scaling) == {"scaled"}
    assert set(race.rows[race.rows.rung >= 0].solver) == {"daqp", "osqp", "piqp", "projected_difference"}
    for solver in ("osqp", "piqp"):
        points = limited(race, solver)
        assert len(points) >= 4
        assert points.limit.tolist() == list(AnytimeSettings().iteration_limits[: len(points)])
        assert (points.status == "ok").all()


def test_limits_grow_until_the_solver_is_done(race: Race) -> None:
    points = limited(race, "piqp")
    assert (points.iterations[:-1] == points.limit[:-1]).all()
    assert points.iterations.iloc[-1] < points.limit.iloc[-1]
    assert points.cost_gap.iloc[-1] < 1e-6 < points.cost_gap.iloc[0]


def test_points_of_the_projected_steps_are_exact_gaps_of_its_iterates(race: Race) -> None:
    points = limited(race, "projected_difference", "kernel")
    problem = race.run.problem(points.problem_set.iloc[0], points.problem.iloc[0])
    form = problem.forms["scaled"]
    qp = form.qp
    for limit, gap in zip(points.limit[:5], points.cost_gap[:5], strict=True):
        solver = solvers.get("projected_difference", steps=int(limit))
        solver.setup(qp)
        assert gap == pytest.approx(exact_cost_gap(qp, form.certificate, solver.solve(), form.c).relative, rel=1e-6)


@pytest.mark.slow
def test_the_report_begins_with_the_picture_and_a_one_shot_race_has_it_too(race: Race, browser: Browser) -> None:
    assert race.call.stdout.startswith("Within one sampling period")
    page = race.run.path / "report.html"
    assert browser.sections(page)[0] == "anytime"
    assert (race.run.path / "anytime.svg").is_file()
    names = [figure.name for figure in kinds()["oneshot"].report(race.run).drawn]
    assert (names[0], "anytime" in names) == ("work_precision", True)
    table = anytime(race.found)
    assert set(table.lane) == {"kernel", "direct"}


def test_a_limit_of_iterations_is_put_on_the_tightest_setting(race: Race) -> None:
    osqp = solvers.find("osqp", "direct").load()
    texts = limited(race, "osqp").setting
    assert len(texts) > 1
    for settings in map(json.loads, texts):
        assert settings == osqp.always | osqp.ladder(1.0)[-1] | {"max_iter": settings["max_iter"]}
