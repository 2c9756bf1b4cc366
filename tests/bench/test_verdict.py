"""Sentences of a race: digits by the drift of the machine, reservations first, and cases that the committed run does
not have."""

import pytest
from measured_rows import ladder, measured, row, steps

from bench.derived.ranking import ranking, short_table
from bench.derived.summary import summary
from bench.derived.verdict import notes, verdict
from bench.messages.task import Row

NAN = float("nan")
RIGHT = {"p1": [1e-12], "p2": [1e-12], "p3": [1e-12]}
CORE = "clang 18, AVX2"


def field() -> list[Row]:
    """Ours and others in two lanes."""
    return [
        *ladder(RIGHT, solver="box_active_set", lane="kernel", solve_us_p50=0.9114),
        *ladder(RIGHT, solver="box_active_set", solve_us_p50=1.5),
        *ladder(RIGHT, solver="quadprog", solve_us_p50=9.0),
        *ladder(RIGHT, solver="daqp", solve_us_p50=6.573),
        *ladder(RIGHT, solver="daqp", lane="qpsolvers", solve_us_p50=0.1),
        *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1.0]}, solver="lost"),
    ]


def test_if_another_solver_is_fastest_ours_is_named_beside_it() -> None:
    (sentence,) = verdict(
        measured(
            [
                *ladder(RIGHT, solver="box_active_set", solve_us_p50=5.0),
                *ladder(RIGHT, solver="daqp", solve_us_p50=2.0),
                *ladder(RIGHT, solver="quadprog", solve_us_p50=3.0),
            ]
        )
    )
    assert sentence.endswith("fastest from Python daqp 2 µs beside box_active_set† 5 µs.")


@pytest.mark.parametrize(("drift", "time"), [(0.009, "6.57 µs"), (0.05, "6.6 µs"), (0.3, "7 µs")])
def test_figures_have_as_many_digits_as_the_drift_allows(drift: float, time: str) -> None:
    assert f"daqp {time}" in " ".join(verdict(measured(field()), CORE, drift))


def test_a_reservation_comes_before_the_figures_that_it_concerns_and_a_quiet_machine_has_none() -> None:
    first, second = verdict(measured(field()), CORE, 2.0)
    assert first.startswith(
        "With reservation: in one fifth of the race the machine took 200 % more or less time for a fixed piece of work"
    )
    assert second.endswith("(clang 18, AVX2; drift 200 %).")
    assert "box_active_set† 0.9 µs" in second
    assert "box_active_set† 2 µs beside daqp 7 µs" in second
    assert not any("reservation" in sentence for sentence in verdict(measured(field()), CORE, 0.09))
    assert len(verdict(measured(ladder({"p1": [NAN]})), CORE, 2.0)) == 1  # there is no time that it would concern


@pytest.mark.parametrize(
    ("count", "message"),
    [
        (1, "on the problem, each with a setting chosen on the problem it is judged on; fastest"),
        (2, "on all 2 problems, each with a setting chosen on the problem it is judged on; fastest"),
        (3, "on all 3 problems; fastest"),
    ],
)
def test_below_three_problems_the_verdict_states_that_settings_are_judged_on_the_problems_of_their_choice(
    count: int, message: str
) -> None:
    problems = {name: RIGHT[name] for name in [*RIGHT][:count]}
    assert message in verdict(measured(ladder(problems)))[0]


def test_the_accuracy_of_the_verdict_is_the_first_of_1e_9_1e_6_and_1e_3_that_a_solver_reaches() -> None:
    loose = [*ladder({"p1": [1e-4, 1e-7]}, solver="osqp"), *ladder({"p1": [1e-4]}, solver="scs")]
    assert verdict(measured(loose))[0].startswith("1 of 2 solver lanes reach 1e-6 on the problem")
    assert verdict(measured(loose[-1:]))[0].startswith("1 of 1 solver lane reaches 1e-3 on the problem")


def test_a_field_without_a_solver_that_reaches_a_tier_has_a_sentence_of_its_own() -> None:
    rows = [*ladder({"p1": [1e-12, 1.0], "p2": [1.0, 1e-12]}), *ladder({"p1": [NAN], "p2": [NAN]}, solver="osqp")]
    assert verdict(measured(rows)) == ["No solver reaches 1e-3 on all 2 problems with one setting."]
    assert verdict(measured([row(setting="d", rung=-1, is_default=True)])) == [
        "No solver reaches any accuracy on the problem with one setting."
    ]


@pytest.mark.parametrize(
    ("excess", "message"),
    [
        (0.0, "larger than that of the optimum on 0 of 3 problems, smaller on 1 and the same on 2"),
        (0.099, "larger than that of the optimum on 0 of 3 problems"),
        (0.101, "larger than that of the optimum on 1 of 3 problems, smaller on 1 and the same on 1"),
        (5.0, "differs most on p1: 0.24 against 0.2 µm RMS, with a noise of 0.008 µm"),
    ],
)
def test_the_papers_model_is_worse_better_or_the_same_by_a_tenth_of_the_sensors_noise(
    excess: float, message: str
) -> None:
    noise = {"noise_um": 0.008, "optimum_error_um": 0.2}
    rows = [
        *field(),
        *steps({"p1": [0.5, 1e-4]}, stage_excess=excess, model_error_um=0.2 + 0.008 * excess, **noise),
        *steps({"p2": [0.5, 1e-4]}, stage_excess=-1.0, model_error_um=0.192, **noise),
        *steps({"p3": [0.5, 1e-4]}, stage_excess=-0.05, model_error_um=0.1996, **noise),
    ]
    *_, sentence = verdict(measured(rows))
    assert message in sentence


def test_a_lane_that_was_raced_on_fewer_problems_is_not_counted_and_comes_last_with_their_number() -> None:
    rows = [*field(), *ladder({"p1": [1e-12]}, solver="slow", lane="cvxpy", solve_us_p50=0.01)]
    sentence = verdict(measured(rows))[0]
    assert sentence.startswith("5 of 6 solver lanes reach 1e-9 on all 3 problems")
    assert sentence.endswith("; 1 solver lane raced on fewer problems and not counted.")
    table = ranking(measured(rows))
    assert [line.partial for line in table] == [0] * 6 + [1]
    assert short_table(table, "").rows[-1][0] == "slow (1 problem)"


def test_lanes_of_which_none_was_raced_on_all_problems_are_not_said_to_reach_anything_on_all() -> None:
    rows = [*ladder({"p1": [1e-12]}, solver="a"), *ladder({"p2": [1e-12], "p3": [1e-12]}, solver="b")]
    (sentence,) = verdict(measured(rows))
    assert sentence.startswith("None of 2 solver lanes was raced on all 3 problems")
    assert [line.partial for line in ranking(measured(rows))] == [1, 2]


def test_the_papers_steps_take_the_time_of_each_problems_own_samples() -> None:
    rows = [*field(), *steps({"p1": [0.5, 1e-4], "p2": [0.5, 1e-4]})]
    found = measured([{**one, "period_us": 5000.0 if one["problem"] == "p2" else one["period_us"]} for one in rows])
    assert "after its 15 200 steps (1.9 to 76 s, by the rate of the recording)" in " ".join(verdict(found))
    assert found.shortest_period_us == 125.0
    assert "(1.9 s)" in " ".join(verdict(measured(rows)))


def noted(rows: list[Row]) -> list[str]:
    found = measured(rows)
    return notes(found, summary(found))


def test_the_paper_s_method_is_left_out_if_it_supports_no_problem() -> None:
    refused = [{**one, "status": "unsupported", "cost_gap": NAN} for one in steps({"p1": [NAN, NAN]})]
    text = " ".join(verdict(measured([*field(), *refused])))
    assert "paper" not in text
    assert "nan" not in text


def test_a_note_compares_warm_starts_with_cold_ones() -> None:
    (warm,) = noted([*ladder(RIGHT, solve_us_p50=4.0), *ladder(RIGHT, start="warm", solve_us_p50=2.0)])
    assert warm.startswith(
        "Started from the optimum of the problem before, on scaled data, daqp (direct) is the fastest"
    )
    assert "takes 0.5 times as long as a cold one" in warm


def test_a_wrapper_that_has_other_defaults_than_the_library_is_named_with_what_differs() -> None:
    rows = [
        row(is_default=True, settings='{"eps": 1e-6}'),
        row(lane="qpsolvers", is_default=True, settings='{"eps": 1e-6, "raise_error": false}'),
        row(lane="cvxpy", is_default=True, settings='{"eps": 1e-5}'),
    ]
    assert noted(rows) == [
        "The default settings of daqp in the lane cvxpy differ from those in the lane direct: eps "
        "1e-05; direct: eps 1e-06."
    ]


def test_a_sentence_says_which_of_the_known_libraries_reach_the_tier_and_how_far_the_others_get() -> None:
    rows = [
        *ladder(RIGHT, solver="daqp"),
        *ladder(RIGHT, solver="osqp"),
        *ladder({**RIGHT, "p1": [1e-5]}, solver="scs"),
        *ladder({"p1": [1e-5], "p2": [1e-5], "p3": [1e-5]}, solver="scs", lane="cvxpy"),
    ]
    assert "Of the libraries that people know first, daqp and osqp reach it on all problems and scs on 2." in verdict(
        measured(rows)
    )
    assert not any("people know first" in sentence for sentence in verdict(measured(rows[:6])))
