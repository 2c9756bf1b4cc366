"""The first screen of a race: its short table, sentences and pictures; the committed run has the rest."""

import re
from dataclasses import replace

import pytest
from measured_rows import NAN, ladder, measured, row, steps

from bench.derived import pictures
from bench.derived.ranking import ranking, short_table
from bench.derived.summary import failures, misses, summary
from bench.derived.verdict import verdict, warm_starts
from bench.messages.task import PAPER, Row
from bench.races.figures import figures


def cells(rows: list[Row], own: list[str] | None = None) -> dict[str, list[str]]:
    """The cells of each line for 1e-3, 1e-6, 1e-9, 1e-12, then the stage and the default."""
    shown = short_table(ranking(measured(rows)), own).rows
    return {str(line[0]): [str(cell) for cell in line[2:]] for line in shown}


RIGHT = {"p1": [1e-12], "p2": [1e-12], "p3": [1e-12]}
FIELD = [
    *ladder(RIGHT, solver="box_active_set", lane="kernel", solve_us_p50=0.9114),
    *ladder(RIGHT, solver="box_active_set", solve_us_p50=1.5),
    *ladder(RIGHT, solver="quadprog", solve_us_p50=9.0),
    *ladder(RIGHT, solver="daqp", solve_us_p50=6.573),
    *ladder(RIGHT, solver="daqp", lane="qpsolvers", solve_us_p50=0.1),
    *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1.0]}, solver="lost"),
]
"""Ours and others in two lanes."""
FEWER = [*FIELD, *ladder({"p1": [1e-12]}, solver="slow", lane="cvxpy", solve_us_p50=0.01)]
FAILS_ONCE = ladder({"p1": [1e-12, 1e-12], "p2": [1e-12, 1e-12], "p3": [NAN, 1e-5]})
REFUSED = [{**one, "status": "unsupported", "cost_gap": NAN} for one in steps({"p1": [NAN, NAN]})]
LANES = [
    row(),
    row(solver="quadprog", lane="qpsolvers"),
    row(solver="clarabel", lane="cvxpy"),
    row(solver="box_active_set", lane="kernel"),
]


@pytest.mark.parametrize(
    ("rows", "own", "expected"),
    [
        *(
            pytest.param(
                FAILS_ONCE,
                own,
                {"daqp": ["1", "✗2/3", "✗2/3", "✗2/3", "–"]},
                id="no time for a tier that is not reached but the number of problems that are right",
            )
            for own in (None, [])
        ),
        *(
            pytest.param(
                ladder({"p1": [1e-12]}, solve_us_p50=us), own, {"daqp": [text, "=", "=", "=", "–"]}, id="a time"
            )
            for us, text in ((0.934, "0.934"), (6.57, "6.57"), (1900.0, "1900"), (1.9e6, "1.9e6"), (25_000.0, "25000"))
            for own in (None, [])
        ),
        pytest.param(LANES, None, dict.fromkeys(("daqp", "quadprog", "clarabel", "box_active_set†")), id="a report"),
        pytest.param(LANES, [], dict.fromkeys(("daqp", "box_active_set†")), id="a terminal: lanes with a ladder"),
        pytest.param(
            [*LANES, row(solver="mine", cost_gap=1e-2)],
            ["mine (direct)"],
            dict.fromkeys(("mine", "daqp", "box_active_set†")),
            id="a terminal: one's own solvers first",
        ),
        pytest.param(LANES[1:3], [], dict.fromkeys(("quadprog", "clarabel")), id="a terminal without such lanes"),
        pytest.param(
            [
                *ladder({"p1": [1e-14]}, solve_us_p50=5.0),
                row(start="warm", solve_us_p50=1.0),
                row(scaling="raw", solve_us_p50=2.0),
                row(solver="raw_alone", scaling="raw"),
                row(solver="warm_alone", start="warm"),
            ],
            None,
            {"daqp": ["5", "=", "=", "=", "–"]},
            id="cold rows of the first scaling only",
        ),
        pytest.param([row(), *REFUSED], None, {"daqp": None}, id="the paper's method supports no problem"),
        pytest.param(
            FEWER[-4:], None, {"lost": None, "slow (1 problem)": None}, id="raced on fewer problems, and so the last"
        ),
        pytest.param(
            [
                *FEWER[-4:],
                *(
                    row(problem=name, solver="slow", lane="cvxpy", setting="{}", rung=-1, is_default=True)
                    for name in RIGHT
                ),
            ],
            None,
            {"lost": None, "slow (1 problem)": None},
            id="raced on fewer problems except at its defaults",
        ),
    ],
)
def test_the_table_has_the_times_of_each_lane_in_the_order_of_its_accuracy(
    rows: list[Row], own: list[str] | None, expected: dict[str, list[str] | None]
) -> None:
    found = cells(rows, own)
    assert [*found] == [*expected]
    assert {name: line and found[name] for name, line in expected.items()} == expected


def test_a_tier_that_applies_to_no_problem_has_no_column_and_one_without_a_result_has_a_dash() -> None:
    noisy = ladder({"p1": [1e-14]}, noise_um=0.01, stage_excess=0.0)
    assert short_table(ranking(measured(ladder({"p1": [1e-14]})))).headings[2:] == [
        "to 1e-3",
        "to 1e-6",
        "to 1e-9",
        "to 1e-12",
        "default gap",
    ]
    other = ladder({"p1": [1e-14], "p2": [1e-14]}, solver="osqp", noise_um=0.0)
    assert short_table(ranking(measured([*noisy, *other]))).headings[-2] == "stage"
    assert cells([*noisy, *other])["osqp"][-2] == "–"
    assert short_table(ranking(measured(FAILS_ONCE))).tips == dict.fromkeys(
        ((0, j) for j in (3, 4, 5)), "errs most on p3"
    )


def test_every_gap_of_a_lane_is_that_of_the_timed_answers_where_they_are_worse_than_the_first() -> None:
    honest = ladder({"p1": [1e-14], "p2": [1e-12]}, is_default=True, timed_gap=1e-11)
    cheating = ladder({"p1": [0.0], "p2": [0.0]}, solver="caches", is_default=True, timed_gap=0.3)
    shown, found = cells([*honest, *cheating]), measured([*honest, *cheating])
    assert (shown["daqp"][-1], shown["caches"][-1]) == ("1.0e-11", "3.0e-01")
    for table in (pictures.work_precision(found), summary(found)[["solver", "worst_gap"]].drop_duplicates()):
        assert table.set_index("solver").worst_gap.to_dict() == {"daqp": 1e-11, "caches": 0.3}


def test_a_miss_is_listed_with_its_problem_and_figures_the_nearest_lanes_first_and_hopeless_ones_not() -> None:
    rows = [
        *ladder({"p1": [1e-12], "p2": [1e-12], "p3": [1e-12]}, solver="right"),
        *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1e-4]}, solver="a"),
        *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1e-12]}, solver="near"),
        *ladder({"p1": [1.0], "p2": [1.0], "p3": [1.0]}, solver="hopeless"),
    ]
    table = misses(measured(rows))
    others = [["near", "p2"], ["a", "p2"], ["a", "p3"]]
    assert table[["solver", "problem"]].values.tolist() == others
    assert table.iloc[0].cost_gap == 1e-5
    with_own = misses(replace(measured(rows), own={"hopeless (direct)": 1e-9}))
    assert with_own[["solver", "problem"]].values.tolist() == [*(["hopeless", p] for p in ("p1", "p2", "p3")), *others]


@pytest.mark.parametrize("of", [{"host": "elsewhere"}, {"timed_gap": float("inf")}])
def test_a_lane_that_fails_on_another_host_or_in_a_timed_answer_alone_went_wrong_and_misses(of: Row) -> None:
    rows = [*ladder({"p1": [1e-12], "p2": [1e-12]}), row(problem="p3", solver="other", cost_gap=1e-12)]
    lost = row(**{"problem": "p1", "solver": "other", "status": "crashed", "message": "gone", **of})
    if "timed_gap" in of:
        lost |= {"status": "answered", "message": ""}
    found = measured([*rows, lost])
    assert failures(found.all_rows)[["solver", "such_as"]].values.tolist() == [["other", "paper/p1"]]
    assert misses(found)[["solver", "problem"]].values.tolist() == [["other", "p1"]]


def on_stage(excess: float) -> list[Row]:
    """The paper's method on three problems, its model on the first worse by so much of the sensor's noise."""
    noise = {"noise_um": 0.008, "optimum_error_um": 0.2}
    return [
        *FIELD,
        *steps({"p1": [0.5, 1e-4]}, stage_excess=excess, model_error_um=0.2 + 0.008 * excess, **noise),
        *steps({"p2": [0.5, 1e-4]}, stage_excess=-1.0, model_error_um=0.192, **noise),
        *steps({"p3": [0.5, 1e-4]}, stage_excess=-0.05, model_error_um=0.1996, **noise),
    ]


CORE = "clang 18, AVX2"
TO_1E_6, TO_1E_3 = ladder({"p1": [1e-4, 1e-7]}, solver="osqp"), ladder({"p1": [1e-4]}, solver="scs")
TWO_PERIODS = [
    {**one, "period_us": 5000.0 if one["problem"] == "p2" else one["period_us"]}
    for one in [*FIELD, *steps({"p1": [0.5, 1e-4], "p2": [0.5, 1e-4]})]
]
ONE_SENTENCE = [
    *(
        (ladder({name: RIGHT[name] for name in [*RIGHT][:count]}), f"1e-9 on {problems}; fastest")
        for count, problems in (
            (1, "the problem, each with a setting chosen on the problem it is judged on"),
            (2, "all 2 problems, each with a setting chosen on the problem it is judged on"),
            (3, "all 3 problems"),
        )
    ),
    ([*TO_1E_6, *TO_1E_3], "1 of 2 solver lanes reach 1e-6 on the problem"),
    (TO_1E_3, "1 of 1 solver lane reaches 1e-3 on the problem"),
    (
        [*ladder({"p1": [1e-12, 1.0], "p2": [1.0, 1e-12]}), *ladder({"p1": [NAN], "p2": [NAN]}, solver="osqp")],
        "No solver reaches 1e-3 on all 2 problems with one setting.",
    ),
    ([row(setting="d", rung=-1, is_default=True)], "No solver reaches any accuracy on the problem with one setting."),
    (
        [*ladder({"p1": [1e-12]}, solver="a"), *ladder({"p2": [1e-12], "p3": [1e-12]}, solver="b")],
        "None of 2 solver lanes was raced on all 3 problems",
    ),
    (
        [*ladder(RIGHT, solver="box_active_set", solve_us_p50=5.0), *ladder(RIGHT, solver="daqp", solve_us_p50=2.0)],
        "fastest from Python daqp 2 µs beside box_active_set† 5 µs.",
    ),
]


@pytest.mark.parametrize(
    ("rows", "given", "message"),
    [
        *(pytest.param(rows, (), rf"\A.*{re.escape(said)}.*\Z", id=said) for rows, said in ONE_SENTENCE),
        *(
            pytest.param(FIELD, (CORE, drift), f"daqp {us} µs", id=f"digits at a drift of {drift}")
            for drift, us in ((0.009, "6.57"), (0.05, "6.6"), (0.3, "7"))
        ),
        pytest.param(
            FIELD,
            (CORE, 2.0),
            r"\ACaution: in one fifth of the race the speed of the machine differed by 200 % from that of the whole"
            r".*\n.*box_active_set† 0\.9 µs.*box_active_set† 2 µs beside daqp 7 µs.*\(clang 18, AVX2; drift 200 %\)\."
            r"\Z",
            id="a caution before the figures that it concerns",
        ),
        pytest.param(
            [*FIELD, row(solver="osqp", host="elsewhere")],
            (CORE, 2.0),
            r"\A.*\n.*\(times of here, one of 2 machines; clang 18, AVX2; drift 200 %\)\.\Z",
            id="several machines",
        ),
        pytest.param(FIELD, (CORE, 0.09), r"\A(?!Caution)", id="a quiet machine has no caution"),
        pytest.param(ladder({"p1": [NAN]}), (CORE, 2.0), r"\A.*\Z", id="there is no time that it would concern"),
        *(
            pytest.param(on_stage(excess), (), rf"{message}.*\Z", id=f"a model worse by {excess} of the noise")
            for excess, message in (
                (0.0, "larger than that of the optimum on 0 of 3 problems, smaller on 1 and the same on 2"),
                (0.099, "larger than that of the optimum on 0 of 3 problems"),
                (0.101, "larger than that of the optimum on 1 of 3 problems, smaller on 1 and the same on 1"),
                (5.0, r"differs most on p1: 0\.24 against 0\.2 µm RMS, with a noise of 0\.008 µm"),
            )
        ),
        pytest.param(
            FEWER,
            (),
            r"\A5 of 6 solver lanes reach 1e-9 on all 3 problems.*; 1 solver lane raced on fewer problems and not "
            r"counted\.$",
            id="raced on fewer problems",
        ),
        pytest.param(
            TWO_PERIODS, (), r"after its 15 200 steps \(1\.9 to 76 s, by the rate of the recording\)", id="two periods"
        ),
        pytest.param(on_stage(0.0), (), r"\(1\.9 s\)", id="one period"),
        pytest.param([*FIELD, *REFUSED], (), r"\A(?!(.|\n)*(paper|nan))", id="the paper's method supports no problem"),
    ],
)
def test_the_verdict_is_for_the_first_of_1e_9_1e_6_and_1e_3_that_a_solver_reaches(
    rows: list[Row], given: tuple[str, float], message: str
) -> None:
    assert re.search(message, "\n".join(verdict(measured(rows), *given)), re.MULTILINE)


def test_a_note_compares_warm_starts_with_cold_ones() -> None:
    others = [
        *ladder(RIGHT, solver="osqp", solve_us_p50=10.0),
        *ladder(RIGHT, solver="osqp", start="warm", solve_us_p50=9.0),
    ]
    found = measured([*ladder(RIGHT, solve_us_p50=4.0), *ladder(RIGHT, start="warm", solve_us_p50=2.0), *others])
    (warm,) = warm_starts(summary(found))
    assert warm.startswith(
        "Started from the optimum of the problem before, on scaled data, daqp (direct) is the fastest"
    )
    assert "with 2 µs; a warm solve takes 0.7 times as long as a cold one (median over 2 solver lanes)" in warm


SPEED = {"box_active_set": 1.0, "recursive_active_set": 2.0, "a": 3.0, "b": 4.0, "c": 5.0, "d": 6.0, "e": 7.0, "f": 8.0}


@pytest.mark.parametrize("status", ["solver_failed", "not_run", "crashed", "tampered"])
def test_a_setting_that_fails_was_not_run_or_was_caught_on_any_problem_is_not_in_the_picture(status: str) -> None:
    rows = ladder({"p1": [1e-3, 1e-9, 1e-10], "p2": [1e-3, 1e-9, 1e-10]})
    rows[4]["status"] = status
    assert pictures.work_precision(measured(rows)).rung.tolist() == [0, 2]


def test_a_solver_is_drawn_in_its_best_lane_and_named_at_the_setting_of_the_table_and_a_user_s_own_always() -> None:
    gaps = {"p1": [1e-3, 1e-11, 1e-14], "p2": [1e-3, 1e-11, 1e-14]}
    rows = [
        *ladder(gaps, solver="osqp", solve_us_p50=30.0),
        *ladder(gaps, solver="osqp", lane="qpsolvers", solve_us_p50=300.0),
        *ladder({"p1": [1e-12]}, solver="partial", solve_us_p50=1.0),
        *(one for i in range(pictures.NAMED) for one in ladder(gaps, solver=f"s{i}", solve_us_p50=1.0 + i)),
        *ladder({"p1": [1e-5, 1e-4], "p2": [1e-5, NAN]}, solver="mine", solve_us_p50=500.0),
        *ladder(gaps, solver="osqp", lane="kernel", solve_us_p50=700.0),
        row(solver="lost", status="crashed", answer_us=NAN),
    ]
    found = replace(measured(rows), own=dict.fromkeys(("mine (direct)", "osqp (kernel)", "lost (direct)"), 1e-9))
    table = pictures.work_precision(found).set_index(["solver", "lane"])
    assert set(table.index.unique()) >= {("osqp", "direct"), ("osqp", "kernel"), ("mine", "direct")}
    assert not {("osqp", "qpsolvers"), ("partial", "direct"), ("lost", "direct")} & set(table.index)
    assert {*table[~table.front].index} == {("osqp", "direct")}
    assert table.loc["osqp", "direct"].end.tolist() == [False, True, False]
    assert table.loc["mine", "direct"].drawn.tolist() == [1e-5, pictures.MOST_GAP]
    assert "Not drawn, since they have no time: lost (direct)." in figures(found)[0].definition
    assert pictures.work_precision(measured([each for each in rows if each["solver"] == "osqp"])).front.all()


def timed(solver: str, times: list[float], gaps: list[float]) -> list[Row]:
    return [
        one
        for i, (us, gap) in enumerate(zip(times, gaps, strict=True))
        for one in ladder({f"p{i}": [gap]}, solver=solver, solve_us_p50=us)
    ]


def test_the_performance_profile_is_that_of_dolan_and_more() -> None:
    rows = [
        *timed("a", [1.0, 2.0, 9.0], [0.0] * 3),
        *timed("b", [2.0, 1.0, 3.0], [0.0] * 3),
        *timed("c", [0.1] * 3, [1e-3] * 3),
    ]
    table = pictures.performance_profile(measured(rows)).set_index(["solver", "factor"])
    expected = {
        ("a", 1.0): 1 / 3,
        ("a", 2.0): 2 / 3,
        ("a", 3.0): 1.0,
        ("b", 1.0): 2 / 3,
        ("b", 2.0): 1.0,
        ("b", 3.0): 1.0,
    }
    assert table.share.to_dict() == pytest.approx(expected)


def sized(**change: object) -> list[Row]:
    """Solvers whose time is a multiple of d, in two lanes; "a" is wrong at the largest size."""
    return [
        one
        for solver, speed in SPEED.items()
        for lane in ("direct", "qpsolvers")
        for d in (8, 18, 60)
        for one in ladder(
            {f"d{d}": [1.0 if solver == "a" and d == 60 else 0.0]},
            problem_set="orders",
            d=d,
            solver=solver,
            lane=lane,
            solve_us_p50=speed * d * (1.0 if lane == "direct" else 1.5),
            **change,
        )
    ]


def test_a_size_of_several_problems_has_their_median_if_all_are_right() -> None:
    more = [
        *sized(),
        *ladder({"again": [0.0]}, problem_set="orders", d=8, solver="b", solve_us_p50=100.0),
        *ladder({"again": [1.0]}, problem_set="orders", d=8, solver="c", solve_us_p50=100.0),
    ]
    lines = pictures.sizes(measured(more)).set_index(["name", "d"])
    assert lines.loc[("b (direct)", 8), ["time_us", "problems"]].tolist() == [(32.0 + 100.0) / 2, 2]
    assert ("c (direct)", 8) not in lines.index


def test_solvers_right_at_every_size_come_first_in_the_order_of_their_times() -> None:
    names = pictures.sizes(measured(sized())).name.drop_duplicates().tolist()
    first, last = ["box_active_set† (direct)", "box_active_set† (qpsolvers)"], ["a (direct)", "a (qpsolvers)"]
    assert (names[:2], sorted(names[-2:])) == (first, last)


@pytest.mark.parametrize(
    ("picture", "rows"),
    [
        pytest.param("performance_profile", timed("a", [1.0], [1.0]), id="nothing is right"),
        pytest.param("sizes", [one for one in sized() if one["d"] == 18], id="one size"),
        pytest.param("sizes", [{**one, "solver": PAPER} for one in sized()], id="the paper's method alone"),
    ],
)
def test_a_picture_without_comparable_solvers_is_empty(picture: str, rows: list[Row]) -> None:
    assert getattr(pictures, picture)(measured(rows)).empty
