"""python -m tests.benchmarks latency [technique …].

How long after a slider's event the new picture is there.

A real slider of a real JupyterLab is dragged for 5 s by a mouse that moves 60 times a second, and a
key is pressed 40 times (labkit's wheel is turned and its portrait clicked too), in a headless
browser that shares the machine with server and kernel. The picture: a time plot of 2 curves, a
portrait of 40 trajectories of 300 points, 400 arrows, nullclines, an equilibrium with its type in
words; the integration is in the time. Side by side: the floor (a number that the kernel echoes,
without any picture), labkit's panel, the same Matplotlib figure under ipywidgets' `interact` and
under ipympl, and its data in bqplot (pip install ipympl bqplot; what is missing is left out). The
kernel's column is processor time. All others are by one clock: the page logs slider events and
changes of the picture, the kernel logs when it begins and ends a computation and for which value; a
picture is the first change after the end of a computation.
"""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import statistics
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from websocket import create_connection

from ..lab import open_browser, open_notebook, run_all, running_lab

SETUP = """\
import json, math, time
import numpy as np
from labkit import Mode, Parameter, System, explore, figure, phase_portrait
from labkit import simulate, simulate_many, time_plot
from labkit.draw.layers import DirectionField
from labkit.draw.view import Together

def flow(t, s, p):
    return s.v, -p.omega**2 * math.sin(s.x) - 2 * p.delta * s.v

omega, delta = Parameter(2.0, "rad/s"), Parameter(0.2, "1/s", "damping", 0.1, 1.1)
system = System("pendulum", {"x": "rad", "v": "rad/s"}, {"omega": omega, "delta": delta},
                [Mode("swing", flow)], start={"x": 1.5, "v": 0.0})
LIMITS = ((-3, 3), (-4, 4))

def draw(run):
    fig = figure(1, 2, width=9, height=3.8)
    where = {"limits": LIMITS, "axes": fig.axes[1]}
    plane = phase_portrait(system, "x", "v", starts=40, run=run, direction_field=False, title="",
                           **where)
    field = DirectionField(fig.axes[1], plane.plane)
    return [time_plot(run, ("x", "v"), axes=fig.axes[0], title=""), plane, field]

simulate(system, 10.0, backend="compiled")
log = open("log.json", "w", buffering=1)

def logged(function, value):
    def timed(*arguments, **options):
        begin, used = time.time(), time.process_time()
        result = function(*arguments, **options)
        times = begin, time.time(), time.process_time() - used
        log.write(json.dumps([value(*arguments, **options), *times]) + "\\n")
        return result
    return timed
"""
CELLS = {
    "floor": """\
from anywidget import AnyWidget
class Echo(AnyWidget):
    _esm = '''export default { render({ model, el }) {
        const range = Object.assign(document.createElement("input"), {
            type: "range", className: "labkit-range", min: 0.1, max: 1.1, step: 0.002, value: 0.2,
        });
        const canvas = document.createElement("canvas");
        range.style.width = "400px";
        el.append(range, canvas);
        let [flying, next] = [false, null];
        const post = () => {
            if (flying || next === null) return;
            model.send({ value: next });
            [flying, next] = [true, null];
        };
        const moved = () => { next = range.valueAsNumber; post(); };
        range.addEventListener("input", moved);
        range.addEventListener("keydown", (event) => {
            event.preventDefault();
            range.stepUp();
            moved();
        });
        model.on("msg:custom", ({ value }) => {
            flying = false;
            canvas.dataset.seq = value;
            post();
        });
    } };'''
echo = Echo()
back = lambda widget, message, buffers: widget.send(message)
echo.on_msg(logged(back, lambda _, message, __: message["value"]))
echo
""",
    "labkit": """\
from labkit.panel import Panel
Panel._receive = logged(Panel._receive, lambda self, _, message, __: self.values["p.delta"])
sliders = {"delta": (0.1, 1.1, 0.002), "omega": False}
explore(system, 10.0, draw, sliders=sliders, start=False, method=False)
""",
    "@interact": """\
import io
from ipywidgets import FloatSlider, interact
from IPython.display import Image, display
def show(delta):
    fig = draw(simulate(system, 10.0, delta=delta))[0].figure
    fig.set_dpi(96)
    fig.canvas.print_png(file := io.BytesIO())
    display(Image(file.getvalue()))
slider = FloatSlider(
    0.2, min=0.1, max=1.1, step=0.002, readout_format=".3f", layout={"width": "400px"}
)
interact(logged(show, lambda delta: delta), delta=slider);
""",
    "ipympl": """\
from ipympl.backend_nbagg import Canvas, FigureManager
from ipywidgets import FloatSlider
from IPython.display import display
view = Together(*draw(simulate(system, 10.0)))
view.figure.dpi = 96
canvas = Canvas(view.figure)
FigureManager(canvas, 0)
slider = FloatSlider(
    0.2, min=0.1, max=1.1, step=0.002, readout_format=".3f", layout={"width": "400px"}
)
def show(change):
    view.update(simulate(system, 10.0, delta=change["new"]))
    canvas.draw_idle()
slider.observe(logged(show, lambda change: change["new"]), "value")
display(slider, canvas)
""",
    "bqplot": """\
from bqplot import Axis, Figure, LinearScale, Lines
from ipywidgets import FloatSlider, HBox
from IPython.display import display
view = Together(*draw(simulate(system, 10.0)))
starts = view.views[1].starts
def data(delta):
    run = simulate(system, 10.0, delta=delta)
    runs = simulate_many(system, 10.0, start=starts, delta=delta)
    view.views[2].update(run)
    field = view.views[2].lines[0].get_xydata().reshape(-1, 7, 2)[:, [0, 1, 3, 4, 5]]
    return run.t, np.array([run["x"], run["v"]]), runs["x"], runs["v"], field[..., 0], field[..., 1]
t, curves, X, V, FX, FV = data(0.2)
def plane(low, high, bottom, top):
    x, y = LinearScale(min=low, max=high), LinearScale(min=bottom, max=top)
    return {"x": x, "y": y}, [Axis(scale=x), Axis(scale=y, orientation="vertical")]
one, axes_one = plane(0.0, 10.0, -3.0, 3.0)
two, axes_two = plane(*LIMITS[0], *LIMITS[1])
lines = Lines(x=t, y=curves, scales=one)
paths = Lines(x=X, y=V, scales=two, stroke_width=1, colors=["#0072B2"])
field = Lines(x=FX, y=FV, scales=two, stroke_width=1, colors=["#AAAAAA"])
slider = FloatSlider(
    0.2, min=0.1, max=1.1, step=0.002, readout_format=".3f", layout={"width": "400px"}
)
def show(change):
    t, curves, X, V, FX, FV = data(change["new"])
    with lines.hold_sync(), paths.hold_sync(), field.hold_sync():
        lines.y, paths.x, paths.y, field.x, field.y = curves, X, V, FX, FV
slider.observe(logged(show, lambda change: change["new"]), "value")
form = {"layout": {"width": "430px", "height": "360px"}, "animation_duration": 0}
display(slider, HBox([Figure(marks=[lines], axes=axes_one, **form),
                      Figure(marks=[field, paths], axes=axes_two, **form)]))
""",
}
NEEDS = {"ipympl": "ipympl", "bqplot": "bqplot"}
WATCH = """() => {
    window.moves = []; window.changes = [];
    const now = () => (performance.timeOrigin + performance.now()) / 1000;
    const slider = document.querySelector('.jp-Notebook')
        .querySelector('.labkit-range, .noUi-target');
    const area = slider.closest('.jp-Cell-outputArea');
    const range = area.querySelector('.labkit-range');
    const readout = area.querySelector('.widget-readout');
    const moved = (when = now()) => moves.push([when, range.valueAsNumber]);
    if (range) range.addEventListener('input', () => moved(), true);
    if (range) range.addEventListener('keydown', () => {
        const pressed = now();
        setTimeout(() => moved(pressed));
    }, true);
    if (readout) new MutationObserver(() => moves.push([now(), Number(readout.textContent)]))
        .observe(readout, { childList: true, characterData: true, subtree: true });
    const seen = (node) => ['IMG', 'path', 'CANVAS'].includes(node.nodeName)
        || node.querySelector?.('img, canvas');
    new MutationObserver((changed) => {
        const hit = changed.find(
            ({ target, addedNodes }) => seen(target) || [...addedNodes].some(seen));
        if (!hit) return;
        const image = [...area.querySelectorAll('.jp-OutputArea img')].pop();
        if (image && !image.complete) image.addEventListener('load', () => changes.push(now()));
        else changes.push(now());
    }).observe(area, {
        subtree: true, childList: true, attributes: true, attributeFilter: ['data-seq', 'd', 'src'],
    });
    const draw = CanvasRenderingContext2D.prototype.drawImage;
    if (!range) CanvasRenderingContext2D.prototype.drawImage = function (...all) {
        if (area.contains(this.canvas)) changes.push(now());
        return draw.apply(this, all);
    };
}"""


class Mouse:
    """A mouse that does not wait until the page has answered, as `page.mouse` does.

    Its events go to the browser's debugging port.
    """

    def __init__(self, port: int, address: str):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
            page = next(page for page in json.load(answer) if page["url"].startswith(address))
        self.socket = create_connection(page["webSocketDebuggerUrl"], suppress_origin=True)

    def __call__(self, kind: str, x: float, y: float) -> None:
        held = (
            {"button": "left", "buttons": 1, "clickCount": 1}
            if kind != "mouseMoved"
            else {"button": "left", "buttons": 1}
        )
        self.socket.send(
            json.dumps(
                {
                    "id": 1,
                    "method": "Input.dispatchMouseEvent",
                    "params": {"type": kind, "x": x, "y": y, **held},
                }
            )
        )


def measure(
    page, lab, name: str, port: int, seconds: float = 5.0, presses: int = 40
) -> dict[str, float]:
    """measure(page, lab, "labkit", port) -> the figures of one technique, times in ms.

    `port` is the browser's for debugging.
    """
    lab.write("latency", [SETUP, CELLS[name]])
    open_notebook(page, lab, "latency")
    run_all(page)
    time.sleep(2)
    page.evaluate(WATCH)
    track = page.locator(".labkit-range, .noUi-target").last
    track.evaluate("node => node.scrollIntoView({ block: 'end' })")
    time.sleep(1)
    box = track.bounding_box()
    y = box["y"] + box["height"] / 2

    def at(share: float) -> float:
        return box["x"] + (0.1 + 0.8 * share) * box["width"]

    page.mouse.move(at(0.0), y)
    mouse = Mouse(port, lab.address)
    begun = time.time()
    mouse("mousePressed", at(0.0), y)
    for k in range(1, int(60 * seconds)):
        time.sleep(max(0.0, begun + k / 60 - time.time()))
        mouse("mouseMoved", at(abs((2 * k / (60 * seconds) + 1) % 2 - 1)), y)  # there and back
    mouse("mouseReleased", at(0.0), y)
    released = time.time()
    time.sleep(2.5)
    dragged = read(page, lab, begun)
    (
        page.locator(".labkit-range").last
        if name in ("floor", "labkit")
        else page.locator(".noUi-handle").last
    ).focus()
    page.keyboard.press("ArrowRight")  # Lab's first key takes half a second, whatever it does
    time.sleep(2)
    pressed = time.time()
    for _ in range(presses):
        page.keyboard.press("ArrowRight")
        time.sleep(0.4)
    keys = read(page, lab, pressed)
    moving = [picture for _, picture, _ in dragged if picture <= released]
    hands = {hand: touched(page, hand) for hand in ("zoom", "click") if name == "labkit"}
    return (
        {hand: quantile(found, 0.5) for hand, found in hands.items()}
        | {f"{hand} 95": quantile(found, 0.95) for hand, found in hands.items()}
        | {
            "key": quantile(keys, 0.5),
            "key 95": quantile(keys, 0.95),
            "drag": quantile(dragged, 0.5),
            "drag 95": quantile(dragged, 0.95),
            "pictures/s": len(moving) / seconds,
            "lag": 1000
            * max(0.0, max((picture for _, picture, _ in dragged), default=released) - released),
            "kernel": 1000 * statistics.median(work for *_, work in dragged)
            if dragged
            else float("nan"),
        }
    )


def touched(page, hand: str, times: int = 20) -> list[tuple[float, float, float]]:
    """(event, picture, 0) of turns of the wheel over the portrait ("zoom"), or of clicks that start
    a trajectory there ("click").
    """
    canvas = page.locator(".labkit-panel canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = box["x"] + 0.7 * box["width"], box["y"] + 0.4 * box["height"]
    event = "wheel" if hand == "zoom" else "click"
    canvas.evaluate(f"""canvas => {{
        window.hands = [];
        canvas.focus();
        const now = () => (performance.timeOrigin + performance.now()) / 1000;
        canvas.addEventListener('{event}', () => hands.push(now()), true);
    }}""")
    for k in range(times):
        page.mouse.move(x + 10 * k, y)
        if hand == "zoom":
            page.mouse.wheel(0, 60 if k % 2 else -60)
        else:
            page.mouse.click(x + 10 * k, y)
        time.sleep(1)
    events, changes = page.evaluate("[hands, changes]")
    return [
        (event, picture, 0.0)
        for event in events
        if (picture := next((change for change in sorted(changes) if change > event), None))
    ]


def read(page, lab, since: float) -> list[tuple[float, float, float]]:
    """(slider event, picture, processor time of the kernel) of every picture since an instant, in
    seconds.

    A picture that was never shown, because the next one was there before it could be, is none; nor
    is a second one of the same value (the hand rests).
    """
    moves, changes = page.evaluate("[moves, changes]")
    works = [json.loads(line) for line in (lab.folder / "log.json").read_text().splitlines()]
    works = [work for work in works if work[1] >= since]
    works = [work for k, work in enumerate(works) if not k or work[0] != works[k - 1][0]]
    found = []
    for (value, begin, end, used), (*_, overtaken, _) in zip(
        works, [*works[1:], (0.0, 0.0, float("inf"), 0.0)], strict=True
    ):
        picture = next((change for change in sorted(changes) if change >= end), None)
        event = max(
            (
                when
                for when, shown in moves
                if since - 0.1 <= when <= begin and abs(shown - value) <= 0.00101
            ),
            default=None,
        )
        if picture is not None and picture < overtaken and event is not None:
            found.append((event, picture, used))
    return found


def quantile(pictures: list[tuple[float, float, float]], share: float) -> float:
    delays = sorted(1000 * (picture - event) for event, picture, _ in pictures)
    return delays[min(int(share * len(delays)), len(delays) - 1)] if delays else float("nan")


def main(names: list[str] | None = None) -> int:
    names = names or [word for word in sys.argv[1:] if word in CELLS] or list(CELLS)
    missing = [
        name for name in names if name in NEEDS and importlib.util.find_spec(NEEDS[name]) is None
    ]
    for name in missing:
        print(f"left out: {name} (pip install {NEEDS[name]})")
    print(
        f"{os.cpu_count()} processors; load before it began: {os.getloadavg()[0]:.1f}"
        if hasattr(os, "getloadavg")
        else f"{os.cpu_count()} processors"
    )
    rows = {}
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (
        tempfile.TemporaryDirectory() as folder,
        open_browser(f"--remote-debugging-port={port}") as browser,
    ):
        (Path(folder) / "notebooks").mkdir()
        with running_lab(Path(folder)) as lab:
            for name in (name for name in names if name not in missing):
                page = browser.new_page(viewport={"width": 1300, "height": 1000})
                page.set_default_timeout(90_000)
                rows[name] = measure(page, lab, name, port)
                page.close()
                lab.end_kernels()
                print_row(name, rows[name], head=len(rows) == 1)
    if "labkit" in rows:
        print(
            "labkit after a turn of the wheel: {zoom:.0f} / {zoom 95:.0f} ms; "
            "after a click that starts a trajectory: {click:.0f} / {click 95:.0f} ms".format(
                **rows["labkit"]
            )
        )
    if "labkit" in rows and rows.get("@interact", {}).get("pictures/s"):
        print(
            f"labkit shows {rows['labkit']['pictures/s'] / rows['@interact']['pictures/s']:.1f} "
            "times as many pictures a second as @interact"
        )
    return 0


def print_row(name: str, row: dict[str, float], head: bool) -> None:
    if head:
        print(
            f"{'ms':12}{'key press':>16}{'dragging':>16}{'pictures/s':>12}{'lag':>8}{'kernel':>8}"
        )
    print(
        f"{name:12}{row['key']:9.0f} /{row['key 95']:5.0f}{row['drag']:9.0f} "
        f"/{row['drag 95']:5.0f}{row['pictures/s']:12.1f}{row['lag']:8.0f}{row['kernel']:8.1f}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
