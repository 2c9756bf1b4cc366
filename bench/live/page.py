"""The page of a live run: a small HTTP server sends what the loop has written on the board, the page draws it with
Vega, as reports do, and its buttons write requests on the board.

The loop does not depend on the page. The server is bound to this machine by default, answers only at a secret path, and
the page holds its own script, so nothing leaves the machine. The browser gives the data to no page of another name or
port, and a request of such a page is refused. A site that lets its own name point to this machine (DNS rebinding)
passes that check, but does not know the path.
"""

import secrets
import socket
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import msgspec
import numpy as np

from bench.live.board import EDGES_US, FOLLOW, Board, State
from bench.live.device import LiveError
from bench.live.settings import LiveSettings, set_point
from bench.rendering import markup_templates
from bench.report import vega
from bench.report.report import GREY, PALETTE
from piezo_model.units import shown

WINDOW_S, MOST_POINTS = 5.0, 400
LONGEST = 100
"""Longest text of a set point that is read."""


def html(settings: LiveSettings) -> bytes:
    """The page, which asks for its :func:`state`."""
    constants = {
        "unit": shown(settings.declared.output_unit),
        "centre": f"{0.5 * sum(settings.declared.y_range):g}",
        "deadline": 1e6 / settings.rate,
        "edges": EDGES_US,
        "colours": {"reference": GREY, "measured": PALETTE[0]},
        "config": vega.CONFIG,
    }
    page = markup_templates("bench.live").get_template("page.html.jinja")
    return page.render(constants=constants, library=vega.library()).encode()


def state(settings: LiveSettings, board: Board) -> bytes:
    """What the page shows now, as JSON; null is a number that is not finite."""
    window = round(WINDOW_S * settings.rate)
    samples = board.read(max(0, board.head - 2 * window))[1]  # the reference that counts may be an earlier one
    errors, tracking = settings.tracking(samples, window)
    drawn = np.column_stack([samples[-window:][:, [0, 1, 3]], errors])
    what = State(board.state).name.lower().replace("_", " ")
    learning = "" if settings.learn == "off" else f", learning, {board.hand_overs} hand-overs"
    return msgspec.json.encode(
        {
            "status": [
                f"{settings.name}, {settings.words}: {what}{learning}.",
                tracking,
                board.timing(settings.rate),
            ],
            "events": board.last_events()[::-1],
            "samples": drawn[:: max(1, len(drawn) // MOST_POINTS)].tolist(),
            "service": list(board.service),
        }
    )


def ask(settings: LiveSettings, board: Board, request: str, text: str) -> str:
    """Write a request of the page on the board, a set point from text; returns what is wrong with it, or ""."""
    unit, y_range = settings.declared.output_unit, settings.declared.y_range
    if request == "stop":
        board.stop = 1
    elif request == "follow":
        board.set_point = FOLLOW
    elif request == "hold":
        board.set_point = min(max(board.last[1], min(y_range)), max(y_range))
    else:
        try:
            board.set_point = set_point(text, unit, y_range, 1.0 / settings.rate)[0][0]
        except LiveError as error:
            return f"{error}."
    return ""


class Page(ThreadingHTTPServer):
    """The server of a run's page, which prints its address; LiveError if nobody can listen there."""

    def __init__(self, settings: LiveSettings, board: Board, host: str, port: int) -> None:
        self.run, self.path = (settings, board), f"/{secrets.token_urlsafe(16)}"
        name, self.address_family = (f"[{host}]", socket.AF_INET6) if ":" in host else (host, socket.AF_INET)
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            raise LiveError(
                f"cannot serve the page at {name}:{port}: {error.strerror}; choose another --port or --host"
            ) from None
        there = socket.gethostname() if self.server_address[0] in ("0.0.0.0", "::") else name
        print(f"Page: http://{there}:{port}{self.path}", flush=True)
        Thread(target=self.serve_forever, daemon=True).start()


class _Handler(BaseHTTPRequestHandler):
    """Answers at the secret path of a run's page."""

    server: Page

    def handle(self) -> None:
        with suppress(ConnectionError):  # a tab was closed
            super().handle()

    def do_GET(self) -> None:
        if self.path == self.server.path:
            self._send(html(self.server.run[0]), "text/html")
        elif self.path == f"{self.server.path}/state":
            self._send(state(*self.server.run), "application/json")
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        (path, _, request), host = self.path.rpartition("/"), self.headers["Host"]
        text = self.rfile.read(min(int(self.headers["Content-Length"] or 0), LONGEST)).decode(errors="replace")
        if path != self.server.path:
            self.send_error(404)
        elif self.headers["Origin"] not in (None, f"http://{host}", f"https://{host}"):
            self.send_error(403)
        else:
            self._send(ask(*self.server.run, request, text).encode(), "text/plain")

    def _send(self, body: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Print nothing."""
