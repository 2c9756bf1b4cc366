"""Accuracy within a number of sampling periods: what counts, its sentences, and a race with limits of iterations."""

import json
import math

import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from measured_rows import measured, row
from small_races import Race, raced

import solvers
from bench.derived.anytime import anytime, sentences
from bench.messages.task import PAPER, Row
from bench.races.kind import kinds
from bench.races.oneshot.passes import AnytimeSettings
from bench.timing.schedule import PERIOD_US
from solvers.certificate import exact_cost_gap


def at_limit(solver: str, duration: float, gap: float, **known: object) -> Row:
    """The row of a limit of iterations; the duration of an answer is in sampling periods."""
    return row(solver=solver, solve_us_p50=PERIOD_US * duration, cost_gap=gap, setting=f"{gap}", rung=-1, **known)


def test_warm_starts_other_scalings_and_the_floor_do_not_count() -> None:
    rows = [
        at_limit("a", 0.5, 1e-2),
        at_limit("a", 0.5, 1e-9, start="warm"),
        at_limit("a", 0.5, 1e-9, scaling="raw"),
        at_limit("null", 0.1, math.nan, status="solver_failed"),
    ]
    table = anytime(measured(rows))
    assert set(table.name) == {"a"}
    assert (table.median_gap == 1e-2).all()


def test_the_verdict_names_the_most_accurate_and_compares_the_papers_pace_with_the_number_of_steps_that_fit() -> None:
    paper = [
        at_limit(PAPER, duration, gap, lane="kernel", periods=float(steps), settings=f'{{"steps": {steps}}}')
        for steps, duration, gap in ((1, 0.01, 0.9), (15_200, 4.0, 0.1))
    ]
    rows = [at_limit("a", 0.5, 1e-12), at_limit("b", 0.5, 1e-3), *paper]
    exact, pace = sentences(anytime(measured(rows)))
    assert exact == (
        "Within one sampling period 1 of 3 solver lanes reach a cost gap of 1e-09 on the median problem; the closest "
        "is a (direct) with 1.0e-12."
    )
    assert pace.endswith(
        "begins at 9.0e-01 and is at 1.0e-01 after 15200 periods; with as many steps as fit into the time it is there "
        "within 5."
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
    oneshot = kinds()["oneshot"]
    names = [figure.name for figure in oneshot.report(race.run, oneshot.settings_of(race.run)).drawn]
    assert (names[0], "anytime" in names) == ("work_precision", True)
    table = anytime(race.found)
    assert set(table.lane) == {"kernel", "direct"}


def test_a_limit_of_iterations_is_put_on_the_tightest_setting(race: Race) -> None:
    osqp = solvers.find("osqp", "direct").load()
    texts = limited(race, "osqp").setting
    assert len(texts) > 1
    for settings in map(json.loads, texts):
        assert settings == {**osqp.fixed_settings, **osqp.ladder(1.0)[-1], "max_iter": settings["max_iter"]}
