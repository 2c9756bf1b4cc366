"""The page of a live run: what the loop has written on the board, drawn by Bokeh's server, and buttons that write
commands on it.

It only reads and asks, so the loop goes on whatever becomes of it. The server is bound to this machine unless told
otherwise, answers only at a path that nobody can guess, and serves its own scripts, so nothing leaves the machine.
"""

import asyncio
import math
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import Button, ColumnDataSource, Div, NumericInput, Span
from bokeh.plotting import figure
from bokeh.server.server import Server
from tornado.netutil import bind_sockets

from bench.live.board import FOLLOW, Board, State, edges_us
from bench.live.device import DeviceError
from bench.live.task import Task
from bench.report.plot import GREY, PALETTE
from piezo_model import HysteresisCreepModel
from piezo_model.units import quantity, shown
from solvers.arrays import Vector

EVERY_MS = 200
WINDOW_S, MOST_POINTS = 5.0, 1_200
BLUE, RED, GREEN = PALETTE[:3]
STATES = {
    State.STARTING: "starting",
    State.FOLLOWING: "following",
    State.RAMPING: "ramping to rest",
    State.ENDED: "at rest; the run is over",
}
STYLE = """
:root { color-scheme: light dark; }
body { margin: 0 auto; max-width: 88rem; padding: 0 .8rem 2rem;
 background: light-dark(#fff, #15181c); color: light-dark(#1b1f24, #e3e6ea);
  font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; }
"""
TEMPLATE = f"""
{{% block title %}}piezobench live{{% endblock %}}
{{% block postamble %}}<meta name="viewport" content="width=device-width, initial-scale=1">
<style>{STYLE}</style>{{% endblock %}}
"""


def straight_line(model: HysteresisCreepModel, y_ref: Vector) -> Vector:
    """What the model in use says of a drive along the straight line through its ranges, shape (N,)."""
    s = model.structure
    line: Vector = model.simulate(s.x_centre + s.x_scale * np.clip((y_ref - s.y_centre) / s.y_scale, -1.0, 1.0))
    return line


def _rms(error: Vector) -> float:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def document(task: Task, board: Board, doc: Document) -> None:
    """One browser's document."""
    d, unit = task.declared, shown(task.declared.output_unit)
    sources = {
        name: ColumnDataSource({column: [] for column in columns})
        for name, columns in {
            "time": ("t", "reference", "measured", "error", "line_error"),
            "loop": ("reference", "measured", "line"),
            "weights": ("i", "w"),
            "service": ("left", "right", "count"),
        }.items()
    }
    status, events = Div(sizing_mode="stretch_width"), Div(sizing_mode="stretch_width")

    def plot(title: str, x: str, y: str, **options: Any) -> Any:
        made = figure(
            title=title,
            x_axis_label=x,
            y_axis_label=y,
            height=260,
            min_width=330,
            sizing_mode="stretch_width",
            toolbar_location=None,
            background_fill_alpha=0.0,
            border_fill_alpha=0.0,
            styles={"flex": "1 1 26rem"},
            **options,
        )
        for part in (made.xaxis, made.yaxis):
            part.axis_label_text_color = part.major_label_text_color = GREY
        made.title.text_color = GREY
        made.grid.grid_line_color, made.outline_line_color = "#80808040", None
        return made

    follow = plot("Reference and measurement", "time, s", unit)
    follow.line("t", "reference", source=sources["time"], color=GREY, line_dash="dashed", legend_label="reference")
    follow.line("t", "measured", source=sources["time"], color=BLUE, legend_label="measured")
    error = plot("Tracking error", "time, s", unit)
    error.line(
        "t",
        "line_error",
        source=sources["time"],
        color=RED,
        alpha=0.6,
        legend_label="straight line, by the model in use",
    )
    error.line("t", "error", source=sources["time"], color=BLUE, legend_label="measured")
    loops = plot("Hysteresis, before and after", f"reference, {unit}", unit)
    loops.line(
        "reference",
        "line",
        source=sources["loop"],
        color=RED,
        alpha=0.6,
        legend_label="straight line, by the model in use",
    )
    loops.line("reference", "measured", source=sources["loop"], color=BLUE, legend_label="measured")
    weights = plot("Weights in use", "number", "unit amplitudes")
    weights.vbar("i", top="w", width=0.7, source=sources["weights"], color=GREEN)
    service = plot("Service time, and the deadline", "µs", "samples", x_axis_type="log")
    service.quad(left="left", right="right", top="count", bottom=0, source=sources["service"], color=BLUE, alpha=0.7)
    service.add_layout(Span(location=1e6 / task.rate, dimension="height", line_color=RED, line_dash="dashed"))
    for each in (follow, error, loops):
        each.legend.update(
            background_fill_alpha=0.0, border_line_alpha=0.0, label_text_color=GREY, orientation="horizontal", padding=0
        )
        each.add_layout(each.legend[0], "below")

    value = NumericInput(
        mode="float",
        value=0.5 * (d.y_range[0] + d.y_range[1]),
        width=110,
        stylesheets=["input { color: #1b1f24; }"],
        low=d.y_range[0],
        high=d.y_range[1],
    )

    def button(label: str, press: Callable[[], None], kind: str = "default") -> Button:
        made = Button(label=label, button_type=kind, width_policy="min")  # type: ignore[arg-type]
        made.on_click(press)
        return made

    def hold(set_point: float) -> None:
        if not math.isnan(set_point):
            board.set_point[0] = min(max(set_point, d.y_range[0]), d.y_range[1])

    def follow_reference() -> None:
        board.set_point[0] = FOLLOW

    buttons = [
        button("Stop", lambda: board.note(stop=1), "danger"),
        button("Hold", lambda: hold(board.last[1])),
        button("Follow the reference", follow_reference),
        value,
        button(f"Go to set point, {unit}", lambda: hold(value.value or 0.0)),
    ]
    if task.learn != "off":
        buttons += [
            button("Learn", lambda: board.note(learning=1)),
            button("Do not learn", lambda: board.note(learning=0)),
        ]

    def update() -> None:
        model = board.shown_model()
        window = board.read(max(0, board.head - round(WINDOW_S * task.rate)))[1]
        line = straight_line(model, window[:, 1])
        rms, line_rms = (quantity(_rms(y - window[:, 1]), d.output_unit, 3) for y in (window[:, 3], line))
        thin = slice(None, None, max(1, len(window) // MOST_POINTS))
        t, reference, _, measured = window[thin].T
        line = line[thin]
        sources["time"].data = {
            "t": t,
            "reference": reference,
            "measured": measured,
            "error": measured - reference,
            "line_error": line - reference,
        }
        sources["loop"].data = {"reference": reference, "measured": measured, "line": line}
        sources["weights"].data = {"i": np.arange(model.weights.size), "w": model.weights}
        edges, counts = edges_us(), board.service
        there = np.flatnonzero(counts)
        sources["service"].data = {"left": edges[there], "right": edges[there + 1], "count": counts[there]}
        learning = (
            ""
            if task.learn == "off"
            else (", learning" if board.learning else ", learning waits") + f", {board.hand_overs} hand-overs"
        )
        status.text = (
            f"<b>{escape(str(task.device))}</b>, {escape(task.reference.words)}: "
            f"{STATES[State(board.state)]}{learning}.<br>Tracking error over the last {WINDOW_S:g} s: "
            f"<b>{escape(rms)}</b> RMS, along a straight line {escape(line_rms)} by the model in "
            f"use.<br>{board.head} samples at {task.rate:g} Hz, {board.missed} deadlines missed; "
            f"{board.late_null} of {board.null_samples} by a loop that does nothing."
        )
        events.text = "<b>Events</b><br>" + "<br>".join(escape(event) for event in reversed(board.said()))

    update()
    doc.title = "piezobench live"
    doc.template = TEMPLATE  # type: ignore[assignment]
    doc.add_root(
        column(
            Div(text="<h1 style='font-size:1.4rem;margin:.6rem 0'>A compensator on a stage</h1>"),
            status,
            row(*buttons, styles={"flex-wrap": "wrap", "gap": ".4rem"}, sizing_mode="stretch_width"),
            row(follow, error, loops, weights, service, styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width"),
            events,
            sizing_mode="stretch_width",
        )
    )
    doc.add_periodic_callback(update, EVERY_MS)


def check_address(host: str, port: int) -> None:
    """See that a page can be there; DeviceError says why it cannot."""
    try:
        for listening in bind_sockets(port, host):
            listening.close()
    except OSError as error:
        raise DeviceError(
            f"the page cannot be at {host}:{port}: {error.strerror}; --port or --host names another place"
        ) from None


def serve(board: Board, task: Task, address: tuple[str, int], token: str, told: Callable[[str], None]) -> None:
    """Serve the page in this thread, and tell its address once it answers."""
    asyncio.set_event_loop(asyncio.new_event_loop())
    host, port = address
    app = Application(FunctionHandler(lambda doc: document(task, board, doc)))
    local = [f"localhost:{port}"] if host == "127.0.0.1" else []
    server = Server(
        {f"/{token}": app},
        port=port,
        address=host,
        use_index=False,
        redirect_root=False,
        allow_websocket_origin=[f"{host}:{port}", *local],
    )
    server.start()
    told(f"Page: http://{host}:{port}/{token}")
    server.io_loop.start()
