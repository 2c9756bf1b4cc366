"""The page of a live run: a small HTTP server sends what the loop has written on the board, the page draws it with
Vega, as reports do, and its buttons write requests on the board.

The loop does not depend on the page. The server is bound to this machine by default, answers only at a secret path, and
the page holds its own script, so nothing leaves the machine. The browser gives the data to no page of another name or
port, and a request of such a page is refused. A site that lets its own name point to this machine (DNS rebinding)
passes that check, but does not know the path.
"""

import secrets
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pandas as pd

from bench.live.board import FOLLOW, Board, State, edges_us, rms
from bench.live.device import DeviceError
from bench.live.settings import LiveSettings
from bench.rendering import markup_templates
from bench.report import vega
from bench.report.report import GREY, PALETTE, Axis, Mark, Plot
from piezo_model.units import quantity, shown
from solvers.arrays import Vector

WINDOW_S, MOST_POINTS = 5.0, 400
STATES = {
    State.STARTING: "starting",
    State.FOLLOWING: "following",
    State.RAMPING: "ramping to rest",
    State.ENDED: "at rest; the run is over",
}
REFERENCE, MEASURED = "reference", "measured"
LOOKS = {REFERENCE: (GREY, 5.0), MEASURED: (PALETTE[0], 1.6)}
"""Colour and width of each line; a measurement that follows the reference would hide a narrow one."""
LONGEST = 100
"""Longest text of a set point that is read."""


def plots(settings: LiveSettings) -> dict[str, Plot]:
    """The plots by their titles."""
    unit, time = shown(settings.declared.output_unit), Axis("x", "time, s")

    def lines(*names: str) -> Plot:
        return Plot(
            time,
            Axis("y", unit),
            [Mark("line", "name", where={"name": [name]}, size=LOOKS[name][1], along="k") for name in names],
            colours={name: LOOKS[name][0] for name in names},
            height=200,
        )

    return {
        "Reference and measurement": lines(REFERENCE, MEASURED),
        "Tracking error": lines(MEASURED),
        "Service time, and the deadline": Plot(
            Axis("from_us", "µs", log=True, values=[10.0**k for k in range(-1, 8)]),
            Axis("samples", "samples"),
            (Mark("bar", x2="to_us", y2="zero", colour=PALETTE[0]),),
            rules={"x": 1e6 / settings.rate},
            height=200,
        ),
    }


def tables(settings: LiveSettings, board: Board) -> tuple[list[dict[str, Any]], float]:
    """Columns of the table of each plot, and the RMS of the tracking error; the reference that counts, late by the lag,
    begins a window earlier than what is shown."""
    window = round(WINDOW_S * settings.rate)
    samples = board.read(max(0, board.head - 2 * window))[1]
    late = settings.late(samples[:, 1])
    t, reference, _, measured, late = np.column_stack([samples, late])[-window:].T
    error, thin = measured - late, max(1, t.size // MOST_POINTS)

    def lines(series: Mapping[str, Vector]) -> dict[str, Any]:
        """The lines one after the other, so that the last one is drawn on top."""
        thinned = t[::thin]
        return {
            "name": np.repeat([*series], thinned.size),
            "k": np.tile(np.arange(thinned.size), len(series)),
            "x": np.tile(thinned, len(series)),
            "y": np.concatenate([y[::thin] for y in series.values()]),
        }

    edges, counts = edges_us(), board.service.copy()
    bins = np.flatnonzero(counts)
    return [
        lines({REFERENCE: reference, MEASURED: measured}),
        lines({MEASURED: error}),
        {"from_us": edges[bins], "to_us": edges[bins + 1], "samples": counts[bins], "zero": np.zeros(bins.size)},
    ], rms(error)


def status(settings: LiveSettings, board: Board, error: float) -> list[str]:
    """State and performance of the loop in sentences."""
    measured = quantity(error, settings.declared.output_unit, 3)
    learning = f", learning, {board.hand_overs} hand-overs"
    return [
        f"{settings.device}, {settings.reference.words}: {STATES[State(board.state)]}"
        f"{'' if settings.learn == 'off' else learning}.",
        f"Tracking error{settings.after_lag} over the last {WINDOW_S:g} s: {measured} RMS.",
        board.timing(),
    ]


def state(settings: LiveSettings, board: Board) -> bytes:
    """What the page shows now, as JSON; null is a number that is not finite."""
    columns, error = tables(settings, board)
    return msgspec.json.encode(
        {
            "status": status(settings, board, error),
            "events": board.last_events()[::-1],
            "tables": [{name: values.tolist() for name, values in table.items()} for table in columns],
        }
    )


def ask(settings: LiveSettings, board: Board, request: str, text: str) -> str:
    """Write a request of the page on the board, a set point from text; returns what is wrong with it, or ""."""
    low, high = sorted(settings.declared.y_range)
    if request == "stop":
        board.set(stop=1)
        return ""
    hold = {"follow": FOLLOW, "hold": min(max(float(board.last[1]), low), high)}
    try:
        value = hold[request] if request in hold else float(text)
    except ValueError:
        value = np.nan
    if request != "follow" and not low <= value <= high:
        return f"The set point must be a number from {low:g} to {high:g} {shown(settings.declared.output_unit)}."
    board.set_point[0] = value
    return ""


class _Handler(BaseHTTPRequestHandler):
    """Answers at the secret path of a run's page."""

    protocol_version, disable_nagle_algorithm = "HTTP/1.1", True

    def __init__(self, settings: LiveSettings, board: Board, path: str, *connection: Any) -> None:
        self._run, self._path = (settings, board), path
        super().__init__(*connection)

    def handle(self) -> None:
        with suppress(ConnectionError):  # a tab was closed
            super().handle()

    def do_GET(self) -> None:
        if self.path == self._path:
            self._send(200, html(*self._run), "text/html")
        elif self.path == f"{self._path}/state":
            self._send(200, state(*self._run), "application/json")
        else:
            self._send(404)

    def do_POST(self) -> None:
        (path, _, request), origin = self.path.rpartition("/"), self.headers["Origin"]
        text = self.rfile.read(min(int(self.headers["Content-Length"] or 0), LONGEST)).decode(errors="replace")
        if path != self._path:
            self._send(404)
        elif origin is not None and urlsplit(origin).netloc != self.headers["Host"]:
            self._send(403)
        else:
            self._send(200, ask(*self._run, request, text).encode())

    def _send(self, code: int, body: bytes = b"", kind: str = "text/plain") -> None:
        self.send_response(code)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


class _Server6(ThreadingHTTPServer):
    address_family = socket.AF_INET6


def html(settings: LiveSettings, board: Board) -> bytes:
    """The page."""
    (low, high), unit = sorted(settings.declared.y_range), shown(settings.declared.output_unit)
    drawn = {
        title: vega.specification(pd.DataFrame(table), plot)
        for (title, plot), table in zip(plots(settings).items(), tables(settings, board)[0], strict=True)
    }
    page = markup_templates("bench.live").get_template("page.html.jinja")
    return page.render(plots=drawn, library=vega.library(), centre=f"{0.5 * (low + high):g}", unit=unit).encode()


def listen(settings: LiveSettings, board: Board, address: tuple[str, int]) -> Callable[[], None]:
    """Listen at an address, and return a function that serves the page there and prints its address.

    DeviceError if nobody can listen there.
    """
    (host, port), path = address, f"/{secrets.token_urlsafe(16)}"
    name, server_type = (f"[{host}]", _Server6) if ":" in host else (host, ThreadingHTTPServer)
    try:
        server = server_type(address, partial(_Handler, settings, board, path))
    except OSError as error:
        raise DeviceError(
            f"the page cannot be at {name}:{port}: {error.strerror}; --port or --host names another place"
        ) from None

    def serve() -> None:
        there = socket.gethostname() if host in ("", "0.0.0.0", "::") else name
        print(f"Page: http://{there}:{port}{path}", flush=True)
        server.serve_forever()

    return serve
