"""Headless Chromium for tests of pages."""

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from command_line import wait_until
from programs import library, program

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-dev-shm-usage",
)
WIDTHS = {"desktop": 1400, "phone": 390}

MARKS = """
return [...document.querySelectorAll('.plot')].map(plot => {
  const box = plot.querySelector('svg')?.getBoundingClientRect();
  const marks = [...plot.querySelectorAll('svg .mark-symbol path, svg .mark-line path, ' +
    'svg .mark-rect path, svg .mark-rule line')];
  const shown = marks.filter(mark => { const b = mark.getBoundingClientRect(); return b.width + b.height > 0; });
  return {drawn: plot.dataset.drawn || '', width: box ? box.width : 0, height: box ? box.height : 0,
    marks: shown.length,
          right: box ? box.right : 0};
});
"""


class Browser:
    """A browser with its own profile."""

    def __init__(self) -> None:
        chromium, driver = program("chromium"), program("chromedriver")
        webdriver = library("selenium.webdriver")
        self.profile = tempfile.mkdtemp(prefix="chromium-")
        options = webdriver.ChromeOptions()
        options.binary_location = chromium
        for flag in (*FLAGS, f"--user-data-dir={self.profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))

    def open(self, page: Path | str, width: str = "desktop", dark: bool = False) -> None:
        """Open a page at an address, or from disk, which must log nothing, and wait until its plots are drawn."""
        self.console(), self.requests()  # drops the entries of the page before
        pixels = WIDTHS[width]
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": pixels, "height": 900, "deviceScaleFactor": 1, "mobile": width == "phone"},
        )
        self.driver.execute_cdp_cmd(
            "Emulation.setEmulatedMedia",
            {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]},
        )
        self.driver.get(page if isinstance(page, str) else page.resolve().as_uri())
        self.wait_until(lambda: all(plot["drawn"] for plot in self.plots()))
        assert isinstance(page, str) or self.console() == []

    def wait_until(self, condition: Callable[[], object]) -> None:
        """Wait until a condition holds; if it never does, the test fails with the state of the page."""
        wait_until(condition, lambda: (self.plots(), self.console()))

    def run(self, script: str, *arguments: Any) -> Any:
        """Run JavaScript and return its result."""
        return self.driver.execute_script(script, *arguments)

    def plots(self) -> list[dict[str, Any]]:
        """State of each plot."""
        return self.run(MARKS)

    def console(self) -> list[str]:
        """Messages on the console since the last call."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses requested since the last call."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        return [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]

    def sections(self, page: Path) -> list[str]:
        """Ids of the sections of a report; asserts that all plots are drawn and the page fits every screen."""
        for width, pixels in WIDTHS.items():
            self.open(page, width)
            assert all(plot["marks"] > 0 for plot in self.plots())
            assert self.run("return document.documentElement.scrollWidth") <= pixels
        found: list[str] = self.run("return [...document.querySelectorAll('section[id]')].map(s => s.id)")
        return found

    def close(self) -> None:
        """Quit the browser."""
        self.driver.quit()
        shutil.rmtree(self.profile, ignore_errors=True)
