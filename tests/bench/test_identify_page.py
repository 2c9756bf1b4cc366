"""The page of a recording, its findings, and orders by cross-validation.

``piezobench inspect`` and ``excite``; the options of reading, two files and repairs reach every verb that opens a
recording."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine, in_process
from recording_files import text_file

from bench.report import recording_page
from bench.report.fit_review import Review, review
from piezo_model import HysteresisCreepModel, ModelStructure, OperatorState, Recording, identify, plants
from piezo_model.recordings import read_reference, write_table
from piezo_model.signals import multi_sine

SAMPLE_TIME = 1e-3
COLUMNS = ("<b>t</b>_s", "<script>x</script>_V", "y\"'><img src=x>_um")
IDENTIFY = ("identify", "<u>stage.csv", "--time", COLUMNS[0], "--input", COLUMNS[1], "--output", COLUMNS[2])


def signals(
    plant: str = "relay_preisach", low: float = 0.0, high: float = 150.0, duration_s: float = 6.0
) -> tuple[np.ndarray, np.ndarray]:
    x = multi_sine(duration_s=duration_s, sample_time=SAMPLE_TIME, low=low, high=high, highest_Hz=10.0)
    return x, plants.get(plant, sample_time=SAMPLE_TIME).run(x)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("<i>desk")
    x, y = signals()
    write_table(folder / "<u>stage.csv", dict(zip(COLUMNS, (np.arange(x.size) * SAMPLE_TIME, x, y), strict=True)))
    return folder


@pytest.fixture(scope="module")
def output(piezobench: CommandLine, desk: Path) -> str:
    """Output of identify, which writes the page and the model."""
    return piezobench.quietly(*IDENTIFY, "--out", "model.json", "--page", "stage page.html", folder=desk).stdout


def recording(x: np.ndarray, y: np.ndarray) -> Recording:
    return Recording.from_arrays(x, y, SAMPLE_TIME, input_unit="V", output_unit="um")


@pytest.mark.usefixtures("output")
def test_the_page_draws_every_plot_of_the_recording_and_shows_names_as_text(browser: Browser, desk: Path) -> None:
    assert {"loops", "error", "weights", "spectrum"} <= {*browser.sections(desk / "stage page.html")}
    assert (len(browser.plots()), browser.run("return document.title")) == (5, "Recording <u>stage.csv")
    assert browser.run("return document.querySelectorAll('main img, main u, main b').length") == 0
    assert all(
        (desk / link.replace("%20", " ")).is_file()
        for link in browser.run("return [...document.querySelectorAll('.note a')].map(a => a.getAttribute('href'))")
    )
    loops = pd.read_csv(desk / "stage page-figures" / "loops.csv").query("name == 'measured'")
    assert loops.x.to_numpy() == pytest.approx(signals()[0][loops["sample"]], abs=1e-6)
    assert (loops.y.min(), loops.y.max()) == pytest.approx((signals()[1].min(), signals()[1].max()), abs=1e-6)


def test_what_the_drive_determines_the_orders_and_the_weights_with_intervals_are_those_of_the_model(
    output: str, browser: Browser, desk: Path
) -> None:
    model, said = HysteresisCreepModel.load(desk / "model.json"), " ".join(output.split())
    chosen = f"n = {model.structure.n}, m = {model.structure.dead_zones // 2}"
    assert all(words in said for words in (f"{chosen} has the fewest weights of those", model.report["data_sheet"]))
    assert sum(line.rstrip().endswith("chosen") for line in output.splitlines()) == 1
    assert output.rstrip().endswith("Page: stage page.html")
    browser.open(desk / "stage page.html")
    page, report = browser.run("return document.body.innerText"), model.report
    drive = report["drive"]
    assert drive["hysteresis"]
    assert drive["sentence"].startswith("This drive determines hysteresis")
    assert drive["highest_Hz"] == pytest.approx(10.0, abs=4.0)  # three lines of the spectrum
    assert drive["sentence"] in said
    assert [
        words
        for words in (drive["sentence"], "Excitation is the RMS", "95 % intervals for these orders in brackets")
        if words not in page
    ] == []
    data = pd.read_csv(desk / "stage page-figures" / "weights.csv")
    assert [*data.columns] == ["weight", "value", "low", "high", "excitation", "standing", "zero"]
    known = data.dropna()
    assert len(known) > 5
    figures = ((value, *report["intervals"]["figures"][name]) for name, value in report["figures"].items())
    for value, low, high in (*known[["value", "low", "high"]].itertuples(index=False), *figures):
        assert low <= value <= high


def reviewed(start: int, added: np.ndarray, **options: object) -> Review:
    """The review of a fit to a recording with something added to its output."""
    x, y = signals()
    y[start : start + added.size] += added
    measured = recording(x, y)
    return review(measured, identify(measured, n=3, m=1, **options))


def test_a_skipped_transient_does_not_flatten_the_error_of_the_rest(browser: Browser, tmp_path: Path) -> None:
    found = reviewed(0, 30.0 * np.exp(-np.arange(40) / 10))
    assert found.skipped
    assert np.abs(found.error).max() > 5.0 * np.abs(found.error[found.skipped :]).max()
    browser.open(recording_page.write(tmp_path / "page.html", "stage.csv", found))
    share = browser.run(
        """
        const plot = document.querySelector('#error svg');
        const counted = plot.querySelector('.mark-line.role-mark path[stroke="#1f86c7"]');
        return counted.getBoundingClientRect().height / plot.getBoundingClientRect().height;
    """
    )
    assert 0.3 < share < 1.0


def test_the_error_is_a_curve_through_its_largest_values() -> None:
    found = reviewed(4000, np.array([5.0]), creep_rates=())
    drawn = next(figure.data for figure in recording_page.report("stage", found).figures if figure.name == "error")
    assert drawn.time_s.is_monotonic_increasing
    shown, counted = drawn.error[drawn.counted == "counted"], found.error[found.skipped :]
    assert (shown.min(), shown.max()) == pytest.approx((counted.min(), counted.max()), rel=1e-4)


def test_json_holds_report_and_orders(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    words = (*IDENTIFY, "--out", tmp_path / "m.json", "--n", 2, "--json")
    report = json.loads(piezobench(*words, folder=desk).stdout)["report"]
    assert report == json.loads((tmp_path / "m.json").read_text())["report"]
    assert report["selection"]["table"][0]["n"] == 2


@pytest.mark.parametrize("lag", ["estimate", "remove"])
def test_the_review_repeats_the_fit_of_the_report(lag: str) -> None:
    x, y = signals()
    late = recording(x, np.concatenate([y[:1], y[:1], y[:-2]]))
    model = identify(late, lag=lag)
    found = review(late, model)
    assert np.sqrt(np.mean(found.error[found.skipped :] ** 2)) == pytest.approx(model.report["fit"]["rms"], rel=0.02)
    assert "a loop closed by the sensor has it" in " ".join(found.sentences) or lag != "remove"


def test_thresholds_that_were_never_reached_are_named_in_a_finding() -> None:
    x, y = signals(low=60.0, high=90.0)
    plant = plants.get("relay_preisach", sample_time=SAMPLE_TIME)
    structure = ModelStructure.equidistant(5, 3, plant.x_range, plant.y_range, (10.0, 1.0), SAMPLE_TIME, offset=True)
    found = review(recording(x, y), identify(recording(x, y), structure=structure))
    unreached = pd.DataFrame(found.weights).query("standing == 'never reached'").weight
    assert len(unreached) > 0
    assert f"The drive never reached the thresholds of {', '.join(unreached)}, " in " ".join(found.sentences)


def test_the_orders_are_those_of_the_data_and_errors_of_candidates_those_of_their_forward_fits() -> None:
    """Those of a true model of n = 2, m = 0 over many tones."""
    structure = ModelStructure.equidistant(2, 0, (0.0, 150.0), (-20.0, 20.0), (), SAMPLE_TIME)
    truth = HysteresisCreepModel.from_weights(structure, [0.5, 0.4, 1.0])
    x = multi_sine(duration_s=16.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0, highest_Hz=5.0)
    y = truth.simulate(x, OperatorState.settled_at(structure, x[0]))
    made = recording(x, y + np.random.default_rng(0).normal(0.0, 0.01, x.size))
    model = identify(made, lag="ignore")
    assert (model.structure.n, model.structure.dead_zones, model.structure.creep_rates) == (2, 1, ())
    table = model.report["selection"]["table"]
    assert (table[0]["n"], table[0]["m"], table[0]["standing"]) == (2, 0, "chosen")
    assert [row["bic"] for row in table] == sorted(row["bic"] for row in table)
    assert len(table) == model.report["selection"]["tried"] > 20
    for row in table[:3]:
        again = identify(made, n=row["n"], m=row["m"], lag="ignore")
        assert row["error_percent"] == pytest.approx(again.report["fit"]["rms_percent"], rel=0.02)


@pytest.mark.parametrize(
    "given",
    [{"n": 3}, {"m": 1}, {"creep_rates": (20.0, 0.2)}, {"n": 4, "m": 0}, {"n": 3, "m": 1, "creep_rates": (1.0,)}],
    ids=str,
)
def test_given_orders_and_rates_are_kept_and_an_order_that_is_not_given_is_selected(given: dict[str, object]) -> None:
    model = identify(recording(*signals()), lag="ignore", **given)
    s = model.structure
    assert given.items() <= {"n": s.n, "m": s.dead_zones // 2, "creep_rates": s.creep_rates}.items()
    assert ("selection" in model.report) == (not {"n", "m"} <= given.keys())


LINES = [
    f"{t:.3f};{np.round(50 + 50 * np.sin(20 * t), 4)};{np.round(-3 * np.sin(20 * t - 0.3), 4)}"
    for t in (np.arange(600) * 1e-3).tolist()
]


def test_a_file_is_described_with_its_columns_units_and_roles(tmp_path: Path) -> None:
    shown = in_process("inspect", text_file(tmp_path, "time [s];drive [V];height [um]", *LINES)).stdout
    assert "separated by semicolons, header in row 1; 600 samples over 0.599 s, one every 1 ms by 'time [s]'" in shown
    assert "input 'drive [V]' from 0.0005 to 100 V, output 'height [um]' from -3 to 3 µm" in shown
    assert [line.split()[-1] for line in shown.splitlines()[-3:]] == ["time", "input", "output"]


def test_a_file_whose_roles_are_not_clear_is_shown_with_the_question(tmp_path: Path) -> None:
    call = in_process(
        "inspect", text_file(tmp_path, "time,a,b,c", *(f"{k},{k % 3},{k % 5},{k % 7}" for k in range(50)))
    )
    assert "cannot tell which column is the input and which the output" in call.refusal
    assert [line.split() for line in call.stdout.splitlines()[-3:]] == [
        ["2", "a", "0", "2"],
        ["3", "b", "0", "4"],
        ["4", "c", "0", "6"],
    ]


def test_options_supply_what_the_file_lacks(tmp_path: Path) -> None:
    path = text_file(tmp_path, *(line.split(";", 1)[1].replace(".", ",") for line in LINES))
    words = ("--sample-rate", 1000, "--decimal", ",", "--header-row", 0, "--input", 1, "--output", 2)
    document = json.loads(in_process("inspect", path, "--json", *words).stdout)
    assert (document["sample_time_s"], document["samples"], document["input"], document["output"]) == (
        1e-3,
        600,
        "column 1",
        "column 2",
    )


FIT = ("--n", 3, "--m", 1, "--rates", "10")


@pytest.fixture
def shelf(tmp_path: Path) -> Path:
    """One recording whole, in two files, and with faults."""
    x, y = signals(duration_s=4.0)
    t = np.arange(x.size) * SAMPLE_TIME
    for name, columns in {
        "whole.csv": {"time_s": t, "voltage_V": x, "position_um": y},
        "u.csv": {"t": t, "a": x},
        "y.csv": {"t": t, "noise": np.cos(9 * x), "b": y},
    }.items():
        write_table(tmp_path / name, columns)
    y[[9, 700]] = np.nan
    pd.DataFrame({"time_s": t, "voltage_V": x, "position_um": y}).to_parquet(tmp_path / "bad.parquet")
    return tmp_path


def test_a_recording_in_two_files_is_inspected_identified_and_validated(piezobench: CommandLine, shelf: Path) -> None:
    two = ("--input", "u.csv", "--output", "y.csv:b", "--input-unit", "V", "--output-unit", "um")
    shown = json.loads(piezobench("inspect", *two, "--json", folder=shelf).stdout)
    assert (shown["samples"], shown["refused"], shown["guessed"]) == (
        4000,
        None,
        {"time": "by name", "input": "as the only one left", "time_unit": "seconds"},
    )
    for verb in (("identify", "--out", "m.json", *FIT), ("validate", "m.json")):
        call = piezobench.run(*verb, *two, "--page", f"{verb[0]}.html", folder=shelf)
        assert "u.csv and y.csv: two files" in call.stdout
    report = json.loads((shelf / "m.json").read_text())["report"]
    assert (report["remarks"], report["recording"]) == (
        ["seconds are assumed, since no unit of the times is stated"],
        Recording.open(shelf / "whole.csv").digest(),
    )
    assert "Seconds are assumed" in (shelf / "identify.html").read_text()


def test_repairs_are_printed_stored_and_on_the_page_and_strict_refuses_them_in_every_verb(
    piezobench: CommandLine, shelf: Path
) -> None:
    call = piezobench("identify", "bad.parquet", *FIT, "--out", "m.json", "--page", "page.html", folder=shelf)
    remark = "column 'position_um' is missing in data row 10, data row 701: 2 of 4000 samples"
    assert remark in call.said, call.stderr
    assert remark in json.loads((shelf / "m.json").read_text())["report"]["remarks"][0]
    assert "is missing in data row 10" in (shelf / "page.html").read_text()
    for words in (
        ("identify", "bad.parquet", "--out", "n.json"),
        ("validate", "m.json", "bad.parquet"),
        ("simulate", "m.json", "bad.parquet", "--input", "position_um", "--out", "y.csv2.csv"),
        ("compensate", "m.json", "bad.parquet", "--reference", "position_um", "--out", "x.csv"),
        ("inspect", "bad.parquet"),
        ("race", "--recording", "bad.parquet", "--solver", "box_active_set", "--out", shelf),
    ):
        assert "without --strict it is repaired" in piezobench(*words, "--strict", folder=shelf).refusal
    assert not (shelf / "n.json").exists()


def test_a_part_of_a_recording_is_identified(piezobench: CommandLine, shelf: Path) -> None:
    part = ("--from", 1, "--to", 3, "--decimate", 2, "--time-unit", "s")
    said = piezobench.run("identify", "whole.csv", *part, *FIT, "--out", "m.json", folder=shelf).said
    assert "1001 samples over 2 s, one every 2 ms" in said
    assert "read from row 1002 (data row 1001) on, one row in 2" in said


def test_the_drive_stays_in_its_range_and_has_its_rate_its_holds_and_a_picture(tmp_path: Path) -> None:
    out, page = tmp_path / "drive.csv", tmp_path / "drive.html"
    call = in_process("excite", "--range", "-20:100", "--rate", 500, "--out", out, "--page", page)
    read = read_reference(out, role="input")
    assert (read.sample_time, read.values.size, read.unit) == (2e-3, 30_000, "V")
    assert read.values.min() == read.values[0] == read.values[-1] == -20.0
    assert 99.0 < read.values.max() <= 100.0
    edges = np.flatnonzero(np.diff(read.values, prepend=np.nan, append=np.nan) != 0.0)
    assert np.sort(np.diff(edges))[-2:] * read.sample_time == pytest.approx(10.0, abs=0.1)
    assert "two holds of 10 s for creep" in call.stdout
    assert "<svg" in page.read_text() or "vega" in page.read_text()


@pytest.mark.sample(2)
@pytest.mark.parametrize("plant", plants.names())
def test_hysteresis_and_creep_of_every_plant_are_found_from_its_recording(tmp_path: Path, plant: str) -> None:
    drive = tmp_path / "drive.csv"
    in_process("excite", "--range", "0:100", "--rate", 200, "--out", drive)
    x, period = read_reference(drive, role="input").values, 5e-3
    y = plants.get(plant, x_range=(0.0, 100.0), sample_time=period).run(x)
    y += np.random.default_rng(0).normal(0.0, 1e-3 * np.ptp(y), y.size)
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * period, "drive_V": x, "position_um": y})
    model = identify(Recording.open(tmp_path / "stage.csv"))
    report, determined = model.report, model.report["drive"]
    assert report["hysteresis"]
    assert model.structure.creep_rates
    assert report["fit"]["rms_percent"] < 1.0
    assert [determined[what] for what in ("hysteresis", "creep", "drift")] == [True] * 3
    assert determined["highest_Hz"] > 0.95 * 10.0  # a twentieth of the rate is announced
    assert determined["sentence"] in report["sentences"]
