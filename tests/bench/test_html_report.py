"""The report's page in a real browser, opened from disk."""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browser import WIDTHS, Browser
from command_line import CommandLine
from hostile_files import hostile_texts, make_hostile
from small_races import Race

from bench.derived.summary import summary
from bench.messages.task import Status
from bench.race_table import ROWS
from bench.races.runs import write
from bench.report import vega
from bench.report.report import BEST, Axis, Figure, Mark, Plot, Report, best_lines
from bench.report.words import marked
from bench.report.writing import write_page
from bench.store import Run


def column(browser: Browser, heading: str) -> list[str]:
    """Texts of a column of the large table in the rows that are shown."""
    return browser.run(
        """
        const grid = document.querySelectorAll('.grid')[1];
        const heads = [...grid.querySelectorAll('th')];
        const at = heads.findIndex(head => head.innerText.trim().replace(/ [▲▼]$/, '') === arguments[0]);
        const rows = [...grid.querySelectorAll('tbody tr')].filter(row => !row.hidden);
        return rows.map(row => row.cells[at].textContent);""",
        heading,
    )


def click(browser: Browser, heading: str) -> None:
    browser.run(
        """[...document.querySelectorAll('.grid')[1].querySelectorAll('th button')]
        .find(button => button.textContent.trim() === arguments[0]).click()""",
        heading,
    )


def choose(browser: Browser, label: str, value: str) -> None:
    browser.run(
        """
        const box = [...document.querySelectorAll('.grid')[1].querySelectorAll('label')]
            .find(label => label.textContent.trim().startsWith(arguments[0]));
        const choice = box.querySelector('select');
        choice.value = arguments[1]; choice.dispatchEvent(new Event('input', {bubbles: true}));""",
        label,
        value,
    )


@pytest.fixture(scope="module")
def page(wide_race: Race) -> Path:
    return wide_race.run.path / "report.html"


@pytest.mark.sample(1)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("dark", [False, True])
def test_the_page_opens_without_an_error_and_without_the_network_and_draws_every_plot(
    browser: Browser, page: Path, width: str, dark: bool
) -> None:
    browser.open(page, width, dark)
    assert {address for address in browser.requests() if not address.startswith(("data:", "blob:", "chrome:"))} == {
        page.resolve().as_uri()
    }
    plots = browser.plots()
    assert len(plots) == 3
    for beside_table, plot in zip([width == "desktop", *[False] * len(plots)], plots, strict=False):
        assert min(plot["marks"], plot["height"]) > 0
        assert (0.35 if beside_table else 0.5) * WIDTHS[width] < plot["width"]
        assert max(plot["width"], plot["right"]) <= WIDTHS[width]
    assert browser.run("return document.documentElement.scrollWidth") <= WIDTHS[width]


@pytest.mark.parametrize("width", WIDTHS)
def test_names_of_the_first_picture_are_apart_and_any_point_has_one_and_the_table_beside_it_fits(
    browser: Browser, page: Path, width: str
) -> None:
    browser.open(page, width)
    boxes = browser.run("""document.querySelector('#work_precision svg').scrollIntoView({block: 'center'});
        return [...document.querySelectorAll('#work_precision .mark-text.role-mark text')]
        .filter(text => text.getAttribute('opacity') !== '0').map(text => text.getBoundingClientRect())
        .map(b => [b.left, b.right, b.top + 4, b.bottom - 4])""")
    assert len(boxes) >= 3
    assert all(
        right <= a or b <= left or bottom <= c or d <= top
        for i, (left, right, top, bottom) in enumerate(boxes)
        for a, b, c, d in boxes[:i]
    )
    assert width == "phone" or browser.run(
        "const s = document.querySelector('.first .scroll'); return s.scrollWidth <= s.clientWidth"
    )
    x, y, label = (
        browser.run("""const grey = document.querySelector('#work_precision .mark-symbol path[fill="#999999"]');
        const b = grey.getBoundingClientRect();
        return [(b.left + b.right) / 2 + 4, (b.top + b.bottom) / 2, grey.getAttribute('aria-label')]""")
    )
    name = re.search("name: ([^;]*);", label)[1]
    browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": x, "y": y})
    tip = "return document.querySelector('#vg-tooltip-element')?.textContent || ''"
    browser.wait_until(lambda: name in browser.run(tip))


def test_the_table_is_sorted_by_its_headings_unknown_values_last_and_filtered_by_its_choices_and_a_search(
    browser: Browser, page: Path, wide_race: Race
) -> None:
    browser.open(page)
    table = summary(wide_race.found)
    for heading, values in (("solve, µs", table.solve_us_p50), ("worst gap", table.worst_gap)):
        known = values.notna().sum()
        for falling in (False, True):
            click(browser, heading)
            shown = column(browser, heading)
            numbers = [float(text) for text in shown[:known]]
            assert (numbers, set(shown[known:]) - {"–"}) == (sorted(numbers, reverse=falling), set())
    click(browser, "solver")
    assert column(browser, "solver") == sorted(column(browser, "solver"))
    assert len(column(browser, "lane")) == len(table)
    for label, value in {"lane": "direct", "tier": "high", "scaling": "scaled", "problem set": "orders"}.items():
        choose(browser, label, value)
        table = table[table[label.replace(" ", "_")] == value]
    assert len(table) >= 3
    assert sorted(column(browser, "solver")) == sorted(table.solver.map(marked))
    choose(browser, "status", "answered")
    assert sorted(column(browser, "solver")) == sorted(table[table.status == "answered"].solver.map(marked))
    browser.run("""const search = document.querySelectorAll('.grid')[1].querySelector('input');
        search.value = 'DAQP'; search.dispatchEvent(new Event('input'))""")
    assert set(column(browser, "solver")) == {"daqp"}
    assert browser.run("return document.querySelectorAll('.grid')[1].querySelector('output').textContent").startswith(
        "1 of "
    )


@pytest.mark.parametrize(
    ("seen", "action", "change"),
    [
        pytest.param(
            "return getComputedStyle(document.body).backgroundColor",
            "document.getElementById('colours').click()",
            None,
            id="the button switches from light to dark",
        ),
        pytest.param(
            """return [...document.querySelectorAll('#work_precision svg .mark-symbol path')]
            .map(point => point.getAttribute('transform')).join()""",
            """const s = document.querySelector('#work_precision select');
            s.value = 'raw data'; s.dispatchEvent(new Event('change'))""",
            None,
            id="a choice of the view redraws a plot",
        ),
        pytest.param(
            """const strong = [...document.querySelectorAll('#work_precision .mark-line path')].filter(line =>
            line.getAttribute('stroke-width') === '3.5' && line.getAttribute('opacity') !== '0').length;
            return strong === 0 ? 'none' : strong < 5 ? 'few' : 'many'""",
            """const sought = document.querySelector('#work_precision input[type=search]');
            sought.value = 'DAQP'; sought.dispatchEvent(new Event('input'))""",
            ["none", "few"],
            id="a typed name is highlighted among the lines of a plot",
        ),
    ],
)
def test_a_control_of_the_page_changes_what_is_seen(
    browser: Browser, page: Path, seen: str, action: str, change: list[str] | None
) -> None:
    browser.open(page)
    before = browser.run(seen)
    browser.run(action)
    browser.wait_until(lambda: browser.run(seen) != before)
    assert change in (None, [before, browser.run(seen)])


def test_the_page_is_one_small_file_that_links_to_the_data_of_each_plot(browser: Browser, page: Path) -> None:
    assert page.stat().st_size < 6_000_000
    assert "default-src 'none'" in page.read_text(encoding="utf-8")
    browser.open(page)
    links = browser.run("return [...document.querySelectorAll('.note a')].map(link => link.getAttribute('href'))")
    assert len(links) == 3
    assert all(len(pd.read_csv(page.parent / link)) for link in links)


def test_a_race_without_answers_has_a_page(browser: Browser, wide_race: Race, tmp_path: Path) -> None:
    numbers = [name for name in wide_race.rows.select_dtypes("floating").columns if name != "noise_um"]
    lost = {**dict.fromkeys(numbers, np.nan), "status": str(Status.CRASHED), "message": "gone"}
    browser.open(write(wide_race.copied(tmp_path / "lost", lambda rows: rows.assign(**lost)))[1].with_suffix(".html"))
    assert browser.plots() == []
    assert set(column(browser, "status")) <= {"crashed", "floor"}
    assert browser.run("return document.querySelector('.verdict').textContent") == (
        "No solver reaches 1e-3 on all 4 problems with one setting."
    )


@pytest.mark.parametrize("values", [(0.134, 0.169), (0.9, 1.1), (1e-9, 1.2e-9), (0.1, 3.0)])
def test_a_logarithmic_axis_has_labels_however_short_it_is(values: tuple[float, float]) -> None:
    table = pd.DataFrame({"error": values, "solver": ["one", "other"]})
    drawn = vega.svg(table, [Plot(Axis("error", "error", log=True), Axis("solver"), [Mark("point")])])
    assert len({*re.findall(r">(\d[\d.]*(?:e.\d+)?)</text>", drawn)}) > 1


def test_the_best_lines_of_a_crowd_have_names_and_colours_that_differ_and_the_others_none(
    browser: Browser, tmp_path: Path
) -> None:
    names = [f"solver {i:02}" for i in range(30)]
    table = pd.DataFrame(
        [
            {"name": name, "x": float(x), "y": float(i + x), "front": i < BEST}
            for i, name in enumerate(names)
            for x in (1, 2, 3)
        ]
    )
    figure = Figure("crowd", "Crowd", "Many lines.", table, [Plot(Axis("x", "x"), Axis("y", "y"), best_lines("x"))])
    browser.open(write_page(Report(["Lines."], figures=[figure], title="Crowd"), tmp_path / "page.html"))
    assert (
        browser.run("return [...document.querySelectorAll('.role-legend-label text')].map(text => text.textContent)")
        == names[:BEST]
    )
    strokes = browser.run("""return [...document.querySelectorAll('.mark-line.role-mark path')]
        .map(path => [path.getAttribute('stroke'), path.getAttribute('stroke-dasharray')].join())""")
    counts = pd.Series(strokes).value_counts()
    assert (len(counts), counts["#999999,"]) == (BEST + 2, len(names))
    assert (counts.drop(["#999999,", "currentColor,"]) == 1).all()


@pytest.mark.parametrize("together", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_no_text_of_a_one_shot_race_is_evaluated_in_its_report_but_shown_as_text(
    piezobench: CommandLine, browser: Browser, wide_race: Race, tmp_path: Path, together: bool
) -> None:
    for number, (columns, payloads) in enumerate(hostile_texts(ROWS, together)):
        copy = Run(tmp_path / f"<img src=x onerror=document.title='run'>{number}")
        shutil.copytree(wide_race.run.path, copy.path)
        make_hostile(copy, "rows.parquet", columns, payloads)
        call = piezobench("report", copy.path, folder=tmp_path)
        assert not list(tmp_path.rglob("HARMED")), (columns, payloads)
        if call.status:
            assert call.refusal
            continue
        browser.open(copy.path / "report.html")
        assert browser.run("return document.title") == f"Race {copy.path.name}"
        if "solver" in columns:
            for texts in (
                column(browser, "solver"),
                browser.run("return [...document.querySelectorAll('.plot svg text')].map(text => text.textContent)"),
            ):
                assert any(payloads[0].replace("/", "")[:16] in text for text in texts)
