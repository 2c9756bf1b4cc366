"""What ``piezobench perf`` says of a bank of compensators."""

from time import perf_counter_ns

import numpy as np
from command_line import CommandLine

from bench.bank_figures import Loop, paced, where_memory_takes_over


def test_a_step_begins_when_it_is_due_and_the_one_after_a_long_one_at_once() -> None:
    calls = []

    def step(y_ref: np.ndarray, y: np.ndarray) -> np.ndarray:
        calls.append(y_ref)
        end = perf_counter_ns() + (2_500_000 if len(calls) == 3 else 0)
        while perf_counter_ns() < end:
            pass
        return np.full(4, 75.0)

    service, response = paced(step, Loop(4, 100.0), 6, 2_000_000)
    assert len(calls) == 6
    assert service[2] >= 2_500_000
    assert response[2] > 2_000_000, "the third ends after the fourth is due"
    assert response[3] >= response[2] - 2_000_000
    assert np.all(response >= service)


def test_memory_takes_over_where_the_cost_rises_for_good() -> None:
    rows = [("8", "900.0", "950.0", "6600"), ("800", "50.0", "70.0", "6600"), ("7000", "53.0", "90.0", "6600")]
    assert where_memory_takes_over(rows) == ("Memory takes over, the cost above 1.15 times the lowest: with 10 optima a second not up to "
                                             "7000 actuators; with 100 optima a second between 800 and 7000 actuators.")


def test_a_bank_is_stepped_in_real_time_beside_a_null_step(piezobench: CommandLine) -> None:
    said = piezobench("perf", "--bank", "9", "--rate", "500", "--seconds", "0.1", "--threads", "2").stdout
    assert said.partition("a bank of 9, 2 threads")[2].split()[1:3] == ["–", "–"], "50 steps support a median alone"
    assert "a null step as long, the machine's floor" in said
    assert "Period 2000 µs, 10 exact optima a second of each" in said
