"""The page of a live run: Bokeh's server draws what the loop has written on the board, and buttons write requests on
it.

The loop does not depend on the page. The server is bound to this machine by default, answers only at a secret path and
serves its own scripts, so nothing leaves the machine. Whatever name of this machine a browser uses, the data go only to
a page of the same name and port: other sites are refused. A site that lets its own name point to this machine (DNS
rebinding) passes that check, but does not know the path.
"""

import asyncio
import math
import secrets
from collections.abc import Callable
from html import escape
from socket import gethostname
from typing import Any

import numpy as np
from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import Button, ColumnDataSource, Div, Span, TextInput
from bokeh.plotting import figure
from bokeh.server.server import Server
from bokeh.server.views.ws import WSHandler
from bokeh.themes import Theme
from tornado.websocket import WebSocketHandler

from bench.live.board import FOLLOW, Board, State, edges_us
from bench.live.device import DeviceError
from bench.live.task import Task
from bench.report.plot import GREY, PALETTE
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
THEME = Theme(
    json={
        "attrs": {
            "Plot": {
                "height": 260,
                "min_width": 330,
                "sizing_mode": "stretch_width",
                "toolbar_location": None,
                "background_fill_alpha": 0.0,
                "border_fill_alpha": 0.0,
                "outline_line_color": None,
                "styles": {"flex": "1 1 26rem"},
            },
            "Title": {"text_color": GREY},
            "Axis": {"axis_label_text_color": GREY, "major_label_text_color": GREY},
            "Grid": {"grid_line_color": "#80808040"},
            "Legend": {
                "background_fill_alpha": 0.0,
                "border_line_alpha": 0.0,
                "label_text_color": GREY,
                "orientation": "horizontal",
                "padding": 0,
            },
        }
    }
)
TEMPLATE = f"""
{{% block title %}}piezobench live{{% endblock %}}
{{% block postamble %}}<meta name="viewport" content="width=device-width, initial-scale=1">
<style>{STYLE}</style>{{% endblock %}}
"""


def data_of(board: Board, rate: float) -> tuple[dict[str, dict[str, Vector]], tuple[float, float]]:
    """Columns of each source of the plots, and the RMS errors: measured, and of a straight line by the model in use.

    The straight line is a drive proportional to the reference, over the ranges of the model.
    """
    model, samples = board.shown_model(), board.read(max(0, board.head - round(WINDOW_S * rate)))[1]
    s = model.structure
    t, reference, _, measured = samples.T
    line = model.simulate(s.x_centre + s.x_scale * np.clip((reference - s.y_centre) / s.y_scale, -1.0, 1.0))
    window = {
        "t": t,
        "reference": reference,
        "measured": measured,
        "error": measured - reference,
        "line": line,
        "line_error": line - reference,
    }
    thin, edges, counts = max(1, len(samples) // MOST_POINTS), edges_us(), board.service
    bins = np.flatnonzero(counts)
    columns = {
        "window": {name: values[::thin] for name, values in window.items()},
        "weights": {"i": np.arange(model.weights.size), "w": model.weights},
        "service": {"left": edges[bins], "right": edges[bins + 1], "count": counts[bins]},
    }
    return columns, (_rms(window["error"]), _rms(window["line_error"]))


def _rms(error: Vector) -> float:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def _plot(title: str, x: str, y: str, *lines: Any, **options: Any) -> Any:
    """A plot with titles of its axes, and lines: source, columns of x and y, and style of each."""
    plot = figure(title=title, x_axis_label=x, y_axis_label=y, **options)
    for source, x_column, y_column, style in lines:
        plot.line(x_column, y_column, source=source, **style)
    if lines:
        plot.add_layout(plot.legend[0], "below")
    return plot


def plots(task: Task, sources: dict[str, ColumnDataSource]) -> list[Any]:
    """Plots of the sources of :func:`data_of`."""
    unit, window = shown(task.declared.output_unit), sources["window"]
    line = {"color": RED, "alpha": 0.6, "legend_label": "straight line, by the model in use"}
    measured = {"color": BLUE, "legend_label": "measured"}
    reference = {"color": GREY, "line_dash": "dashed", "legend_label": "reference"}
    weights = _plot("Weights in use", "number", "normalised units")
    weights.vbar("i", top="w", width=0.7, source=sources["weights"], color=GREEN)
    service = _plot("Service time, and the deadline", "µs", "samples", x_axis_type="log")
    service.quad(left="left", right="right", top="count", bottom=0, source=sources["service"], color=BLUE, alpha=0.7)
    service.add_layout(Span(location=1e6 / task.rate, dimension="height", line_color=RED, line_dash="dashed"))
    return [
        _plot(
            "Reference and measurement",
            "time, s",
            unit,
            (window, "t", "reference", reference),
            (window, "t", "measured", measured),
        ),
        _plot("Tracking error", "time, s", unit, (window, "t", "line_error", line), (window, "t", "error", measured)),
        _plot(
            "Hysteresis, before and after",
            f"reference, {unit}",
            unit,
            (window, "reference", "line", line),
            (window, "reference", "measured", measured),
        ),
        weights,
        service,
    ]


def controls(task: Task, board: Board) -> list[Any]:
    """Buttons that write requests on the board, the set point's input, and a line for what is wrong with that."""
    (low, high), unit = sorted(task.declared.y_range), shown(task.declared.output_unit)
    value = TextInput(value=f"{0.5 * (low + high):g}", width=110, stylesheets=["input { color: #1b1f24; }"])
    wrong = Div()

    def button(label: str, press: Callable[[], None], kind: str = "default") -> Button:
        made = Button(label=label, button_type=kind, width_policy="min")  # type: ignore[arg-type]
        made.on_click(press)
        return made

    def hold(asked: str | float) -> None:
        try:
            set_point = float(asked)
        except ValueError:
            set_point = math.nan
        known = low <= set_point <= high
        wrong.text = "" if known else f"The set point must be a number from {low:g} to {high:g} {escape(unit)}."
        board.set_point[0] = set_point if known else board.set_point[0]

    learn = [
        button("Learn", lambda: board.set(learning=1)),
        button("Do not learn", lambda: board.set(learning=0)),
    ]
    return [
        button("Stop", lambda: board.set(stop=1), "danger"),
        button("Hold", lambda: hold(min(max(float(board.last[1]), low), high))),
        button("Follow the reference", lambda: board.set_point.fill(FOLLOW)),
        value,
        button(f"Go to set point, {unit}", lambda: hold(value.value)),
        *(learn if task.learn != "off" else ()),
        wrong,
    ]


def status(task: Task, board: Board, rms: tuple[float, float]) -> str:
    """State and performance of the loop, as HTML."""
    measured, line = (escape(quantity(value, task.declared.output_unit, 3)) for value in rms)
    learning = f", learning{'' if board.learning else ' paused'}, {board.hand_overs} hand-overs"
    return (
        f"<b>{escape(str(task.device))}</b>, {escape(task.reference.words)}: "
        f"{STATES[State(board.state)]}{'' if task.learn == 'off' else learning}.<br>Tracking error over the last "
        f"{WINDOW_S:g} s: <b>{measured}</b> RMS, along a straight line {line} by the model in use.<br>"
        f"{board.head} samples at {task.rate:g} Hz, {board.missed} deadlines missed; "
        f"{board.null_missed} of {board.null_samples} by a loop that does nothing."
    )


def document(task: Task, board: Board, doc: Document) -> None:
    """Lay out the document of one browser and keep it up to date."""
    sources = {name: ColumnDataSource(columns) for name, columns in data_of(board, task.rate)[0].items()}
    summary, events = Div(sizing_mode="stretch_width"), Div(sizing_mode="stretch_width")

    def update() -> None:
        columns, rms = data_of(board, task.rate)
        for name, source in sources.items():
            source.data = columns[name]  # type: ignore[assignment]
        summary.text = status(task, board, rms)
        events.text = "<b>Events</b><br>" + "<br>".join(escape(event) for event in reversed(board.last_events()))

    update()
    doc.title, doc.theme = "piezobench live", THEME
    doc.template = TEMPLATE  # type: ignore[assignment]
    doc.add_root(
        column(
            Div(text="<h1 style='font-size:1.4rem;margin:.6rem 0'>A compensator on a stage</h1>"),
            summary,
            row(*controls(task, board), styles={"flex-wrap": "wrap", "gap": ".4rem"}, sizing_mode="stretch_width"),
            row(*plots(task, sources), styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width"),
            events,
            sizing_mode="stretch_width",
        )
    )
    doc.add_periodic_callback(update, EVERY_MS)


def listen(board: Board, task: Task, address: tuple[str, int]) -> Callable[[], None]:
    """Listen at an address, and return a function that serves the page there.

    It prints the page's address once it answers. DeviceError if nobody can listen there.
    """
    (host, port), path = address, f"/{secrets.token_urlsafe(16)}"
    name = f"[{host}]" if ":" in host else host
    asyncio.set_event_loop(asyncio.new_event_loop())
    # Tornado's own check that a request's origin is the host that it asks; Bokeh's compares it with a list of names
    WSHandler.check_origin = WebSocketHandler.check_origin  # type: ignore[method-assign]
    app = Application(FunctionHandler(lambda doc: document(task, board, doc)))
    try:
        server = Server({path: app}, port=port, address=host, use_index=False, redirect_root=False)
    except OSError as error:
        raise DeviceError(
            f"the page cannot be at {name}:{port}: {error.strerror}; --port or --host names another place"
        ) from None

    def serve() -> None:
        server.start()
        server.io_loop.add_callback(
            print, f"Page: http://{gethostname() if host in ('', '0.0.0.0', '::') else name}:{port}{path}", flush=True
        )
        server.io_loop.start()

    return serve
