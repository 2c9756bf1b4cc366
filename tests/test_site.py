"""The documentation builds without a warning, and its pages are drawn on wide and narrow screens, light and dark."""

import functools
import http.server
import re
import threading
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from types import ModuleType

import pytest
from browser import WIDTHS, Browser
from command_line import python
from programs import ALL, library

import piezo_model
import solvers

ROOT = Path(__file__).parent.parent
PAGES = {
    "index": "piezobench",
    "tutorial-telescope": "From one actuator to thousands",
    "mathematics": "The mathematics",
    "api/piezo_model": "piezo_model",
}
WIDE = """
return [...document.querySelectorAll('main *')].filter(part => part.getBoundingClientRect().right > innerWidth + 1
  && !part.closest('pre, table, .md-typeset__scrollwrap, .formula')).map(part => part.outerHTML.slice(0, 80));
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the site, built strictly."""
    library("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    python("-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", folder, folder=ROOT)
    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(http.server.SimpleHTTPRequestHandler, directory=folder)
    ) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_drawn_on_every_screen_and_asks_nothing_of_the_network(
    page: str, site: str, browser: Browser
) -> None:
    for width, dark in [*product(WIDTHS, (False, True))][:: 1 if ALL else 3]:
        browser.open(f"{site}/{page}.html", width, dark)
        assert browser.run("return document.body.dataset.mdColorScheme") == ("slate" if dark else "default")
        assert browser.console() == []
        assert all(address.startswith((site, "data:", "blob:")) for address in browser.requests())
        assert browser.run("return document.documentElement.scrollWidth") <= WIDTHS[width]
        assert browser.run(WIDE) == []
        assert browser.run(
            "const h = document.querySelector('h1'), b = h.getBoundingClientRect();"
            "return [h.firstChild.textContent.trim(), b.width > 0 && b.top < innerHeight];"
        ) == [PAGES[page], True]


@pytest.mark.parametrize("package", [piezo_model, solvers], ids=lambda package: package.__name__)
def test_every_public_name_has_its_place_in_the_reference(package: ModuleType) -> None:
    page = (ROOT / "docs" / "api" / f"{package.__name__}.md").read_text(encoding="utf-8")
    assert set(re.findall(rf"^::: {package.__name__}\.(\w+)$", page, flags=re.MULTILINE)) == set(package.__all__)
