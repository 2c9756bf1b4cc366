"""The page of a recording, its findings, and orders by cross-validation."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine

from bench.report import recording_page
from bench.report.fit_review import review
from piezo_model import HysteresisCreepModel, ModelStructure, OperatorState, Recording, identify, plants
from piezo_model.recordings import write_table
from piezo_model.signals import multi_sine

SAMPLE_TIME = 1e-3
COLUMNS = ("<b>t</b>_s", "<script>x</script>_V", "y\"'><img src=x>_um")


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
    call = piezobench.quietly(
        "identify",
        "<u>stage.csv",
        "--time",
        COLUMNS[0],
        "--input",
        COLUMNS[1],
        "--output",
        COLUMNS[2],
        "--out",
        "model.json",
        "--page",
        "stage page.html",
        folder=desk,
    )
    return call.stdout


def recording(x: np.ndarray, y: np.ndarray) -> Recording:
    return Recording.from_arrays(x, y, SAMPLE_TIME, input_unit="V", output_unit="um")


@pytest.mark.usefixtures("output")
def test_the_page_draws_every_plot_of_the_recording_and_shows_names_as_text(browser: Browser, desk: Path) -> None:
    assert {"loops", "error", "weights", "spectrum", "orders"} <= {*browser.sections(desk / "stage page.html")}
    assert len(browser.plots()) == 6
    assert browser.run("return document.title") == "Recording <u>stage.csv"
    assert browser.run("return document.querySelectorAll('main img, main u, main b').length") == 0
    for link in browser.run("return [...document.querySelectorAll('.note a')].map(a => a.getAttribute('href'))"):
        assert (desk / link.replace("%20", " ")).is_file()
    loops = pd.read_csv(desk / "stage page-figures" / "loops.csv").query("name == 'measured'")
    assert loops.x.to_numpy() == pytest.approx(signals()[0][loops["sample"]], abs=1e-6)


def test_what_the_drive_determines_the_orders_and_the_weights_with_intervals_are_those_of_the_model(
    output: str, browser: Browser, desk: Path
) -> None:
    model, said = HysteresisCreepModel.load(desk / "model.json"), " ".join(output.split())
    chosen = f"n = {model.structure.n}, m = {model.structure.dead_zones // 2}"
    assert f"{chosen} has the fewest weights of those within 2 of the smallest" in said
    assert sum(line.rstrip().endswith("chosen") for line in output.splitlines()) == 1
    assert output.rstrip().endswith("Page: stage page.html")
    browser.open(desk / "stage page.html")
    page, report = browser.run("return document.body.innerText"), model.report
    drive = report["drive"]
    assert drive["hysteresis"]
    assert drive["sentence"].startswith("This drive determines hysteresis")
    assert drive["highest_Hz"] == pytest.approx(10.0, abs=4.0)  # three lines of the spectrum
    assert drive["sentence"] in said
    for words in (drive["sentence"], "Excitation is the RMS", "95 % intervals for these orders in brackets"):
        assert words in page
    data = pd.read_csv(desk / "stage page-figures" / "weights.csv")
    assert [*data.columns] == ["weight", "value", "low", "high", "excitation", "standing", "zero"]
    known = data.dropna()
    assert len(known) > 5
    figures = ((value, *report["intervals"]["figures"][name]) for name, value in report["figures"].items())
    for value, low, high in (*known[["value", "low", "high"]].itertuples(index=False), *figures):
        assert low <= value <= high


def test_a_skipped_transient_does_not_flatten_the_error_of_the_rest(browser: Browser, tmp_path: Path) -> None:
    x, y = signals()
    y[:40] += 30.0 * np.exp(-np.arange(40) / 10)
    measured = recording(x, y)
    found = review(measured, identify(measured, n=3, m=1))
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
    x, y = signals()
    y[4000] += 5.0
    measured = recording(x, y)
    found = review(measured, identify(measured, n=3, m=1, creep_rates=()))
    drawn = next(figure.data for figure in recording_page.report("stage", found).figures if figure.name == "error")
    assert drawn.time_s.is_monotonic_increasing
    shown, counted = drawn.error[drawn.counted == "counted"], found.error[found.skipped :]
    assert (shown.min(), shown.max()) == pytest.approx((counted.min(), counted.max()), rel=1e-4)


def test_json_holds_report_and_orders(piezobench: CommandLine, desk: Path, tmp_path: Path) -> None:
    call = piezobench(
        "identify",
        desk / "<u>stage.csv",
        "--time",
        COLUMNS[0],
        "--input",
        COLUMNS[1],
        "--output",
        COLUMNS[2],
        "--out",
        tmp_path / "m.json",
        "--n",
        2,
        "--json",
    )
    found = json.loads(call.stdout)
    assert found["report"] == json.loads((tmp_path / "m.json").read_text())["report"]
    assert found["report"]["selection"]["table"][0]["n"] == 2


def test_the_review_repeats_the_fit_of_the_report() -> None:
    x, y = signals()
    late = recording(x, np.concatenate([y[:1], y[:1], y[:-2]]))
    for lag in ("estimate", "remove"):
        model = identify(late, lag=lag)
        found = review(late, model)
        assert np.sqrt(np.mean(found.error[found.skipped :] ** 2)) == pytest.approx(
            model.report["fit"]["rms"], rel=0.02
        )
    assert "a loop closed by the sensor has it" in " ".join(found.sentences)


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
        fit = identify(made, n=row["n"], m=row["m"], lag="ignore").report["fit"]
        assert row["error_percent"] == pytest.approx(fit["rms_percent"], rel=0.02)


def test_given_orders_and_rates_are_kept() -> None:
    made = recording(*signals())
    for given in ({"n": 3}, {"m": 1}, {"creep_rates": (20.0, 0.2)}, {"n": 4, "m": 0}):
        s = identify(made, lag="ignore", **given).structure
        found = {"n": s.n, "m": s.dead_zones // 2, "creep_rates": s.creep_rates}
        assert {name: found[name] for name in given} == given
    assert "selection" not in identify(made, n=3, m=1, creep_rates=(1.0,), lag="ignore").report
