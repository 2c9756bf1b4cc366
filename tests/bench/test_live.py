"""A compensator on a running stage: refusals, the end of a run at rest, its recording, and its page in a browser."""

import http.client
import math
import os
import re
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import msgspec
import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import (
    LIVE,
    PATIENCE_S,
    STAGES,
    CommandLine,
    free_port,
    hears_its_terminal,
    spawned,
    wait_until,
)
from exported_loops import a_model

from bench.live.board import CAPACITY, State, new_board
from bench.live.device import Declared, SimulatedStage
from bench.live.loop import Loop
from bench.live.session import record
from bench.live.settings import Learn, LiveSettings, first_model, of_file, sine
from piezo_model import Compensator, Dynamics, HysteresisCreepModel, plants
from piezo_model.recordings import write_table
from piezo_model.signals import decaying_triangle, multi_sine
from piezo_model.units import UnitError, quantity

RATE, LIMIT = 500, 150.0


STALLS = """
import time
class Stage:
    input_unit, output_unit, x_limits, y_range = "V", "um", (0.0, 150.0), (0.0, 20.0)
    rate_limit, rest, reopens, count = 5000.0, 0.0, False, 0
    def open(self): pass
    def exchange(self, x):
        self.count += 1
        time.sleep(0.3 if self.count % 100 == 0 else 0.0)
        return x * 20.0 / 150.0
    def close(self): pass
"""


def test_due_times_that_a_stall_skips_are_missed_deadlines_and_a_reference_out_of_reach_is_followed_and_said_to_be(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    file, record = tmp_path / "stalls.py", tmp_path / "run.parquet"
    file.write_text(STALLS)
    words = ("--rate", 1000, "--seconds", 2, "--sine", "1Hz:30um", "--record", record)
    ended = piezobench.run("live", "--device", file, "--no-page", *words)
    assert re.search(
        r"The reference goes from -20 µm to 40 µm, and the stage, by its model, from 0.* the time is over\.", ended.said
    )
    samples, missed = (
        int(re.search(what, ended.stdout)[1]) for what in (r"(\d+) samples at", r"deadlines missed: (\d+)")
    )
    k = np.rint(1000.0 * pd.read_parquet(record).time_s.to_numpy()).astype(int)
    skipped = k[-1] + 1 - samples
    assert 5 * 290 < skipped <= missed <= skipped + samples


def test_a_stage_that_cannot_be_opened_again_is_left_with_a_message(piezobench: CommandLine, tmp_path: Path) -> None:
    call = piezobench.start("live", "--simulate", "duhem", "--no-page", "--record", tmp_path / "run.parquet")
    wait_until((tmp_path / "run.arrow").exists)
    os.kill(spawned(call.pid)[0], signal.SIGKILL)  # the loop is the first that a run starts
    ended = call.wait()
    left = "and the stage cannot be opened by another process: its last drive was"
    assert (ended.status, left in ended.stdout) == (1, True)


@pytest.mark.slow
def test_the_recording_of_a_run_gives_a_model_as_good_as_that_of_an_open_loop_recording(
    tmp_path: Path, piezobench: CommandLine
) -> None:
    record, rate = tmp_path / "run.parquet", 200
    wanted = multi_sine(duration_s=20.0, sample_time=1.0 / rate, low=-16.8, high=16.5, highest_Hz=1.0)
    write_table(tmp_path / "wanted.csv", {"time_s": np.arange(wanted.size) / rate, "reference_um": wanted})
    call = piezobench.run(
        "live", "--simulate", "relay_preisach", "--rate", rate, "--seconds", 20, "--reference", tmp_path / "wanted.csv",
        "--no-page", "--record", record,
    )  # fmt: skip
    assert "The stage is at rest; the time is over." in call.stdout
    plant = plants.get("relay_preisach", sample_time=1.0 / rate)
    found = pd.read_parquet(record)
    samples = np.rint(found.time_s.to_numpy() * rate).astype(int)
    held = found.drive_V.to_numpy()[np.searchsorted(samples, np.arange(samples[-1] + 1), side="right") - 1]
    over_that_range = multi_sine(duration_s=20.0, sample_time=1.0 / rate, low=10.0, high=140.0, highest_Hz=1.0)
    for name, x in (("same_drive.csv", held), ("same_range.csv", over_that_range)):
        sensor = plants.Sensor(plants.get("relay_preisach", sample_time=1.0 / rate), noise_um=0.002, seed=1)
        write_table(
            tmp_path / name, {"time_s": np.arange(x.size) / rate, "drive_V": x, "displacement_um": sensor.run(x)}
        )

    def error_of_model(name: str, *words: object) -> float:
        made = tmp_path / f"{name}.json"
        known = ("--input", "drive_V", "--output", "displacement_um", "--n", 5, "--m", 3, "--rates", "10,1,0.1")
        piezobench.run("identify", tmp_path / name, *known, *words, "--out", made)
        plant.reset()
        drive = decaying_triangle(duration_s=10.0, sample_time=1.0 / rate, low=20.0, high=130.0)
        error = HysteresisCreepModel.load(made).simulate(drive) - plant.run(drive)
        return float(np.std(error[2 * rate :]))

    of_run = error_of_model("run.parquet", "--resample", 1.0 / rate)
    assert of_run <= 1.1 * error_of_model("same_drive.csv")
    if len(found) >= 0.99 * held.size:  # a machine that holds the loop up makes it record another, poorer signal
        assert of_run <= 1.1 * error_of_model("same_range.csv")


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("--sine", "5Hz:19um"),
        pytest.param(("--rate", 1, "--set-point", 0, "--seconds", 2), id="slower than its timeout"),
    ],
)
def test_a_reference_that_the_stage_can_reach_is_followed_without_a_word_of_it(
    words: tuple[object, ...], piezobench: CommandLine
) -> None:
    said = piezobench.run("live", "--simulate", "duhem", "--no-page", "--seconds", 0.1, *words).stdout
    assert ("The reference goes from" in said, "The stage is at rest; the time is over." in said) == (False, True)


@pytest.mark.parametrize(("x_range", "is_said"), [((0.0, 150.0), False), ((60.0, 80.0), True)])
def test_a_reference_beyond_the_range_of_the_model_is_said_to_be(x_range: tuple[float, float], is_said: bool) -> None:
    declared = Declared("V", "um", (0.0, 150.0), (-20.0, 20.0), 3_333.0, 0.0)
    y_range = tuple(float(x) * 40.0 / 150.0 - 20.0 for x in x_range)
    model = first_model(None, Declared("V", "um", x_range, y_range, 3_333.0, 0.0), 1e-3)
    settings = LiveSettings(
        SimpleNamespace, "", declared, model, True, "off", 0.0, np.array([-15.0, 15.0]), "", 1e3, 0.0
    )
    said = "The reference goes from -15 µm to 15 µm, and the stage, by its model, from -4 µm to 1.33 µm."
    assert settings.out_of_reach() == said * is_said


def test_a_simulated_stage_follows_the_clock_if_the_loop_is_late() -> None:
    stage = SimulatedStage("maxwell_slip", sample_time=0.05, noise_um=0.0)
    stage.exchange(100.0)
    time.sleep(0.2)
    y = stage.exchange(120.0)
    assert y in [  # creep moved on for 0.2 s, or longer on a busy machine
        plants.get("maxwell_slip", sample_time=0.05).run(np.append(np.full(held, 100.0), 120.0))[-1]
        for held in range(4, 24)
    ]


@pytest.mark.parametrize("learn", ["off", "continuous"])
def test_a_stage_gets_the_drives_of_its_compensator_to_the_last_bit_at_the_rate_limit_too(learn: Learn) -> None:
    plant = plants.Sensor(plants.get("relay_preisach", sample_time=1e-3), noise_um=0.002, seed=1)
    declared = Declared("V", "um", plant.x_range, plant.y_range, 3_333.0, plant.x_range[0])
    y_ref = 12.0 * np.sin(0.1 * np.arange(3000))
    settings = LiveSettings(
        SimulatedStage, "", declared, first_model(None, declared, 1e-3), False, learn, 0.0, y_ref, "", 1e3, 0.0
    )
    board, x, y = new_board(), [], [math.nan]
    board.drive, board.state = declared.rest, State.FOLLOWING
    loop = Loop(settings, board, SimpleNamespace(exchange=plant.step), settings.compensator())
    for wanted in y_ref.tolist():
        loop.exchange(loop.next_drive(wanted))
        x.append(board.drive)
        y.append(loop._y)
    alone = settings.compensator()
    np.testing.assert_array_equal(
        x, alone.run(y_ref) if isinstance(alone, Compensator) else alone.replay(y_ref, y[:-1])
    )
    assert np.count_nonzero(np.abs(np.diff(x)) > 3.332) > 100


def test_a_reference_and_a_model_in_other_units_are_converted_to_those_of_the_stage(tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    write_table(path, {"time_s": np.arange(4) * 1e-3, "reference_nm": [0.0, 1000.0, 2000.0, -500.0]})
    y_ref, said = of_file(path, "µm", (-20.0, 20.0), 1e-3)
    assert (y_ref.tolist(), said) == ([0.0, 1.0, 2.0, -0.5], f"{path}: the reference is converted from nm to µm")
    with pytest.raises(UnitError, match=r"path\.csv: the reference is in nm, which cannot be converted to V;"):
        of_file(path, "V", (-20.0, 20.0), 1e-3)
    model, x = a_model(), np.linspace(0.0, 100.0, 50)
    s = model.structure
    model.save(tmp_path / "model.json")
    declared = Declared("mV", "nm", (0.0, 1e5), (-1e4, 1e4), 1.0, 0.0)
    assert first_model(tmp_path / "model.json", declared, 0.3 * s.sample_time).structure.sample_time == pytest.approx(
        0.3 * s.sample_time
    )
    converted = first_model(tmp_path / "model.json", declared, s.sample_time)
    assert (converted.structure.input_unit, converted.structure.output_unit) == ("mV", "nm")
    np.testing.assert_allclose(converted.simulate(1e3 * x), 1e3 * model.simulate(x), rtol=1e-9, atol=1e-9)
    with pytest.raises(UnitError, match=r"model\.json: the output is in µm, which cannot be converted to mrad;"):
        first_model(tmp_path / "model.json", msgspec.structs.replace(declared, output_unit="mrad"), s.sample_time)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "rest = 3_000.0, 0.0 -> rest = 3_000.0, 200.0",
            "stage.py: x_start must be within the limits of the drive, 0 to 150",
        ),
        (
            "x_limits, y_range = (0.0, 150.0) -> x_limits, y_range = (150.0, 0.0)",
            "x_range must be two finite numbers in ascending order, not (150.0, 0.0)",
        ),
        (
            "rate_limit, rest = 3_000.0 -> rate_limit, rest = 0.0",
            "the field 'rate_limit' is wrong: expected `float` > 0.0",
        ),
        ("timeout_s = 0.5 -> timeout_s = 'long'", "the field 'timeout_s' is wrong: expected `float`, got `str`"),
        ("timeout_s = 0.5 -> timeout_s = 1e6", "the field 'timeout_s' is wrong: expected `float` <= 3600.0"),
        ("input_unit, output_unit -> a_unit, output_unit", "the field 'input_unit' is missing"),
        ("def exchange -> def swap", "must define one class with the methods open, exchange, close, and defines 0"),
        ("import os -> import no_such_module", "cannot be run: ModuleNotFoundError"),
    ],
)
def test_the_declarations_of_a_stage_are_checked_before_the_first_sample(
    change: str, message: str, tmp_path: Path, piezobench: CommandLine
) -> None:
    old, new = change.split(" -> ")
    file = tmp_path / "stage.py"
    file.write_text((STAGES / "tcp_stage.py").read_text().replace(old, new, 1))
    assert message in piezobench("live", "--device", file, "--no-page").refusal


def test_the_board_hands_over_samples_and_events_in_their_order_and_a_recording_says_which_it_lacks(
    tmp_path: Path,
) -> None:
    board, over, sent = new_board(), Event(), CAPACITY + 1000
    for k in range(sent):
        board.write((0.1 * k, 1.0, 2.0, float(k)))
    start, samples = board.read(0)
    np.testing.assert_array_equal(samples[:, 3], np.arange(start, sent))
    board.log("fünf " * 100)
    assert board.last_events()[0].startswith(f"{0.1 * (sent - 1):.3f} s: fünf")
    over.set()
    path = tmp_path / "run.parquet"
    assert record(board, path, Declared("V", "um", (0.0, 1.0), (0.0, 1.0), 1.0, 0.0), over) == (
        f"Recording: {path}, without samples that the disk was too slow for: {start} before {0.1 * start:.3f} s"
    )
    np.testing.assert_array_equal(pd.read_parquet(path).displacement_um, samples[:, 3])


def test_tracking_errors_count_after_the_lag_of_the_inverse_between_the_ramps_to_the_reference_and_to_rest(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    model, dynamics = a_model(), Dynamics((20.0,), (0.02,), (1.0,), 0.01)
    replace(model, dynamics=dynamics).save(tmp_path / "model.json")
    (tmp_path / "stage.py").write_text(f"""
from piezo_model import HysteresisCreepModel, OperatorState
class Stage:
    input_unit, output_unit, x_limits, y_range = "V", "um", (0.0, 150.0), (-20.0, 20.0)
    rate_limit, rest, reopens = 1000.0, 0.0, False  # ramps of many samples
    def open(self):
        model = HysteresisCreepModel.load({str(tmp_path / "model.json")!r}).at(0.01)
        self.static, self.state = model.static, OperatorState.settled_at(model.structure, 0.0)
        self.g = model.dynamics.stream(0.01, self.static.simulate([0.0], self.state)[0])
    def exchange(self, x):
        y, self.state = self.static.advance([x], self.state)
        return float(self.g(y)[0])
    def close(self): pass
""")
    words = (
        "--rate",
        100,
        "--seconds",
        3,
        "--no-page",
        "--learn",
        "off",
        "--sine",
        "2Hz:5um",
        "--record",
        "run.parquet",
    )
    call = piezobench.run("live", "model.json", "--device", "stage.py", *words, folder=tmp_path)
    lag_s, table = dynamics.lag_s(0.01), pd.read_parquet(tmp_path / "run.parquet")
    assert f"The output lags the reference by {quantity(lag_s, 's', 3)}" in call.stdout
    errors = table.displacement_um - np.interp(table.index - 100.0 * lag_s, table.index, table.reference_um)
    followed = errors[table.time_s < 3.0]
    rms = float(np.sqrt(np.mean(followed[len(followed) - len(followed) // 2 :] ** 2)))
    assert re.search(f"Tracking error after the lag over the last .* s: {quantity(rms, 'um', 3)} RMS", call.stdout)
    assert rms < 0.1 < np.sqrt(np.mean(errors**2))
    assert 5.0 * 2.0 * np.pi * 2.0 * lag_s > 1.0  # what counting at once would have said


@pytest.mark.parametrize("frequency", [3.0, 99.0, 0.37, math.pi])
def test_a_sine_has_the_given_frequency_whatever_the_number_of_samples_in_a_period(frequency: float) -> None:
    samples, _ = sine(f"{frequency!r}Hz:2um", "um", (0.0, 2.0), 5e-3)
    expected = 1.0 + 2.0 * np.sin(2.0 * np.pi * frequency * 5e-3 * np.arange(10_000))
    assert np.resize(samples, 10_000) == pytest.approx(expected, abs=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("descending", [False, True])
def test_a_stage_whose_output_falls_is_not_learned_unless_its_range_is_in_descending_order(
    descending: bool, piezobench: CommandLine, tmp_path: Path
) -> None:
    (tmp_path / "stage.py").write_text(
        "from bench.live.device import SimulatedStage\nMADE = SimulatedStage('relay_preisach', 2e-3)\nclass Stage:\n"
        "    input_unit, output_unit, x_limits, rate_limit, rest = 'V', 'um', MADE.x_limits, 5000.0, 0.0\n"
        f"    y_range, timeout_s = {'MADE.y_range[::-1]' if descending else 'MADE.y_range'}, 5.0\n"
        "    def open(self): pass\n    def exchange(self, x): return sum(MADE.y_range) - MADE.exchange(x)\n"
        "    def close(self): pass\n"
    )
    words = ("--rate", RATE, "--seconds", 8, "--sine", "2Hz:12um", "--record", "run.parquet", "--no-page")
    assert (
        "the output falls as the input rises"
        in piezobench.run("live", "--device", "stage.py", *words, folder=tmp_path).said
    ) == (not descending)
    recorded = pd.read_parquet(tmp_path / "run.parquet").iloc[-3 * RATE : -RATE // 2]
    error = recorded["displacement_um"] - recorded["reference_um"]
    assert (np.sqrt(np.mean(error**2)) < 1.0) == descending
    assert (recorded["drive_V"] < LIMIT).all()


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the page of a run whose stage's file has markup in its name."""
    file = tmp_path_factory.mktemp("watched") / "<img src=x onerror=document.title='run'>.py"
    file.write_text(
        "from bench.live.device import SimulatedStage\nMADE = SimulatedStage('relay_preisach', 2e-3)\n"
        "class Stage:\n    input_unit, output_unit, x_limits, y_range, rate_limit, rest = 'V', 'um', MADE.x_limits, "
        "MADE.y_range, 5000.0, 0.0\n    def open(self): pass\n    def exchange(self, x): return MADE.exchange(x)\n"
        "    def close(self): pass\n"
    )
    run = subprocess.Popen(
        [*LIVE, "--device", file, "--rate", str(RATE), "--sine", "1Hz:10um", "--port", str(free_port())],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=hears_its_terminal,
    )
    address = run.stdout.readline().split()[1]
    assert urllib.request.urlopen(address, timeout=20.0).status == 200
    yield address
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=PATIENCE_S)


def text_of(browser: Browser) -> str:
    """All text of the page."""
    return browser.run("return document.body.innerText")


def press(browser: Browser, label: str) -> None:
    browser.run(
        "[...document.querySelectorAll('button')].find(button => button.textContent === arguments[0]).click()", label
    )


@pytest.mark.needs("chromium", "chromedriver")
@pytest.mark.parametrize("width", ["desktop", "phone"])
@pytest.mark.parametrize("dark", [False, True])
def test_the_page_is_live_has_buttons_that_work_shows_names_as_text_and_requests_nothing_from_other_machines(
    watched: str, browser: Browser, width: str, dark: bool
) -> None:
    browser.open(watched, width, dark)
    browser.wait_until(lambda: "samples at 500 Hz" in text_of(browser))
    first = re.search(r"(\d+) samples", text_of(browser))
    browser.wait_until(lambda: re.search(r"(\d+) samples", text_of(browser)).group(1) != first.group(1))
    assert "<img src=x onerror=document.title='run'>.py" in text_of(browser)
    assert browser.run("return document.title") == "piezobench live"
    for label, message in (
        ("Hold", "s: holds"),
        ("Go to set point, µm", "s: holds 0"),
        ("Follow the reference", "s: follows sine 1Hz:10um"),
    ):
        press(browser, label)
        browser.wait_until(lambda message=message: message in text_of(browser))
    hosts = {
        re.sub(r"^\w+://([^/:]*).*", r"\1", address)
        for address in browser.requests()
        if not address.startswith(("data:", "blob:", "chrome:"))
    }
    assert hosts <= {"127.0.0.1"}
    assert browser.run(  # nothing is cut off
        f"return document.documentElement.scrollWidth <= {1400 if width == 'desktop' else 390} && "
        "[...document.querySelectorAll('section')].every((section) => section.scrollHeight <= section.clientHeight)"
    )


def holds(browser: Browser) -> set[str]:
    """The set points among the last events, with their times."""
    return set(re.findall(r"[\d.]+ s: holds [^ ]+", text_of(browser)))


def go_to(browser: Browser, text: str) -> None:
    """Type a set point and go there."""
    browser.run("document.querySelector('input').value = arguments[0]", text)
    press(browser, "Go to set point, µm")


@pytest.mark.needs("chromium", "chromedriver")
@pytest.mark.parametrize("text", ["", "-", "abc", "300", "1e999", "nan", "-inf", "1,5"])
def test_a_set_point_that_is_no_number_in_the_range_moves_nothing_and_is_named(
    watched: str, browser: Browser, text: str
) -> None:
    browser.open(watched)
    browser.wait_until(lambda: "samples at" in text_of(browser))
    held = holds(browser)
    go_to(browser, text)
    browser.wait_until(lambda: "the set point must be a number from -20 to 20 µm, not" in text_of(browser))
    assert holds(browser) <= held
    go_to(browser, "1.5")
    browser.wait_until(lambda: holds(browser) - held)
    assert "the set point must be" not in text_of(browser)
    press(browser, "Follow the reference")


def status_of(port: int, host: str, origin: str | None, path: str) -> int:
    """HTTP status of a button's request at this machine."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
    connection.request("POST", path, headers={"Host": host, **({} if origin is None else {"Origin": origin})})
    status = connection.getresponse().status
    connection.close()
    return status


@pytest.mark.slow
@pytest.mark.needs("chromium", "chromedriver")
@pytest.mark.parametrize("host", ["0.0.0.0", "localhost", "::1"])
def test_a_page_is_live_under_every_name_of_its_machine_and_other_sites_are_refused(
    host: str, browser: Browser, piezobench: CommandLine
) -> None:
    port = free_port()
    call = piezobench.start("live", "--simulate", "duhem", "--rate", 100, "--host", host, "--port", port)
    wait_until(lambda: call.stdout.read_text().endswith("\n"))
    address = call.stdout.read_text().split()[1]
    shown, token = {"0.0.0.0": socket.gethostname(), "::1": "[::1]"}.get(host, host), address.rpartition("/")[2]
    assert address == f"http://{shown}:{port}/{token}"
    for name in (shown, *(["localhost", "127.0.0.1", "127.0.0.2"] if host == "0.0.0.0" else [])):
        browser.open(f"http://{name}:{port}/{token}")
        browser.wait_until(lambda: "samples at 100 Hz" in text_of(browser))
        first = re.search(r"(\d+) samples", text_of(browser)).group(1)
        browser.wait_until(lambda first=first: re.search(r"(\d+) samples", text_of(browser)).group(1) != first)
    if host == "0.0.0.0":
        expected = {
            f"http://stage.lab:{port}": 200,
            None: 200,  # no browser
            **dict.fromkeys(
                ("http://evil.example", f"http://stage.lab:{port + 1}", f"http://evil.example:{port}", "null"), 403
            ),
        }
        path = f"/{token}/follow"
        assert {origin: status_of(port, f"stage.lab:{port}", origin, path) for origin in expected} == expected
    os.kill(call.pid, signal.SIGINT)
    ended = call.wait()
    assert (ended.status, ended.stderr) == (130, "")


@pytest.mark.parametrize("data", [None, b""], ids=["GET", "POST"])
@pytest.mark.parametrize("path", ["/", "/guess", "/guess/state"])
def test_requests_without_the_token_are_refused(watched: str, path: str, data: bytes | None) -> None:
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(watched.rpartition("/")[0] + path, data, timeout=20.0)
