"""A panel that moves without Python: every slider's positions and every preset as pictures.

A recording, played by recorded.js, holds the messages that the panel would send: for each slider
some 21 positions, the others at their first values; each choice and preset; the time cursor at some
100 instants of the first run. What pictures have in common is kept once: a frame names its parts, a
part its bitmaps.
"""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .draw.figure import CSS_DPI, STYLE
from .model import ModelError

if TYPE_CHECKING:
    from .controls import Control
    from .panel import Panel

__all__ = ["MIME", "record", "script", "style"]

MIME = "application/vnd.labkit.recording"
POSITIONS, INSTANTS = 21, 100
RATIO = 2.0  # device pixels to one CSS pixel: sharp on a tablet too
GRID = 4  # parts of a pixel that a point is rounded to
ROOM = 848  # CSS pixels that a page has for a picture, and the part of a picture's width that
BESIDE = 0.7  # is shown at least; what is wider has large type, as a panel on a narrow page
LEGIBLE = 8.5  # CSS pixels of the smallest letters: smaller, and the picture is scrolled sideways
FAR = 16383  # the most of them from the corner of the picture, so that differences are short
NEW_STROKE = -32768  # as the difference of x: then y says if the stroke is closed
SAID = (
    "Recorded: one slider at a time, from the values at first; “Play” shows the first run. "
    "In the notebook all move together."
)


def record(panel: Panel, positions: int = POSITIONS) -> bytes:
    """record(panel) -> the recording, packed; the panel is afterwards as it was at first.

    A position that the model refuses keeps its sentence. Raises what the panel's drawing raises.
    """
    controls = [_coarse(one, positions) for one in panel.shown()]
    store, frames = _Store(), []
    panel._resize(min(ROOM / panel.spec["width"], BESIDE))

    def keep(values: dict[str, Any]) -> int:
        panel._as_at_first()  # limits that follow the data calmly would show what came before
        try:
            panel._show(values)
        except ModelError as error:
            frames.append({"error": str(error)})
        else:
            frames.append(store.frame(panel))
        return len(frames) - 1

    first = keep(panel.defaults)
    sliders = {
        one.key: [
            [value, first if value == one.value else keep(panel.defaults | {one.key: value})]
            for value in _positions(one)
        ]
        for one in controls
    }
    presets = {name: keep(panel.defaults | values) for name, values in panel.presets.items()}
    panel._as_at_first()
    panel._show(panel.defaults)
    instants = []
    if panel.spec["moves"]:
        for t in np.linspace(panel.run.t[0], panel.run.t[-1], INSTANTS).tolist():
            panel._cursor({"t": t})
            frames.append(store.frame(panel))
            instants.append([t, len(frames) - 1])
    panel._cursor({"t": None})
    letters = panel.scene.zoom * STYLE["xtick.labelsize"] * CSS_DPI / 72
    panel._resize(1.0)
    panel.scene.forget()  # nobody has seen these pictures
    buttons = [one for one in panel.spec["buttons"] if one[0] in ("play", "reset", "full")]
    least = round(panel.spec["width"] * min(LEGIBLE / letters, 1))
    spec = {"controls": [asdict(one) for one in controls], "buttons": buttons, "handles": []}
    spec |= {"download": True, "recorded": True, "help": SAID, "least": least}
    head = {"spec": panel.spec | spec, "ratio": RATIO, "grid": GRID, "frames": frames}
    head |= {"first": first, "sliders": sliders, "presets": presets, "instants": instants}
    return store.packed(head)


def _coarse(control: Control, positions: int) -> Control:
    """The same slider with a grid of so many positions, one of which is the value at first."""
    if control.kind == "select":
        return control
    at = math.log10 if control.kind == "log" else float
    wide = at(control.high) - at(control.low)
    return replace(control, step=wide / (positions - 1), base=at(control.value))


def _positions(control: Control) -> list[Any]:
    """The values that a coarse slider can set, and its ends."""
    if control.kind == "select":
        return list(control.options)
    log, base, step = control.kind == "log", control.base, control.step
    first, last = (((math.log10(end) if log else end) - base) / step for end in control.ends)
    places = base + step * np.arange(math.ceil(first), math.floor(last) + 1)
    found = {control.nearest(10.0**place if log else place) for place in places.tolist()}
    own = control.nearest(control.value)  # the value at first, perhaps rounded
    return sorted((found - {own}) | {control.value, control.low, control.high})


class _Store:
    """Parts and bitmaps, each kept once."""

    def __init__(self) -> None:
        self.parts: list[dict[str, Any]] = []
        self.points: list[np.ndarray] = []
        self.images: list[bytes] = []
        self.known: dict[bytes, int] = {}

    def frame(self, panel: Panel) -> dict[str, Any]:
        """The picture on show, by the numbers of its parts, and what the page says beside it."""
        message, buffers = panel._picture(RATIO, True, True)
        told = ("verdict", "stopped", "reading", "t", "span", "values", "size")
        said = {key: message[key] for key in told}
        if "mime" in message:  # it has too many points for strokes
            return said | {"mime": message["mime"], "bitmap": self._image(buffers[0])}
        points, pixels = np.frombuffer(buffers[0], "<f4").reshape(-1, 2), buffers[1]
        p = b = 0
        parts = {}
        for name, ops in message["ops"].items():
            start, own = p, []
            for op in ops:
                p += op.get("n", 0) + op.get("at", 0)
                if "image" in op:
                    size = op["image"][2] * op["image"][3] * (4 if op.get("rgba") else 1)
                    op = op | {"bitmap": self._image(pixels[b : b + size])}
                    b += size
                own.append(op)
            parts[name] = self._part(own, points[start:p])
        return said | {"order": [[name, parts[name]] for name in message["order"] if name in parts]}

    def _image(self, pixels: bytes) -> int:
        key = hashlib.sha256(pixels).digest()
        if key not in self.known:
            self.known[key] = len(self.images)
            self.images.append(pixels)
        return self.known[key]

    def _part(self, ops: list[dict[str, Any]], points: np.ndarray) -> int:
        part, coded = {"ops": ops, "points": len(points)}, points[:0].astype("<i2")
        if np.nanmax(np.abs(points), initial=0.0) * GRID > FAR:  # as they are, as an image is kept
            part |= {"points": 0, "raw": self._image(points.tobytes())}
        else:
            coded = _differences(points)
        key = hashlib.sha256(json.dumps(part).encode() + coded.tobytes()).digest()
        if key not in self.known:
            self.known[key] = len(self.parts)
            self.parts.append(part)
            self.points.append(coded)
        return self.known[key]

    def packed(self, head: dict[str, Any]) -> bytes:
        """A line of JSON; then the points' differences, byte by byte apart; then the bitmaps."""
        head = head | {"parts": self.parts, "images": [len(one) for one in self.images]}
        points = np.concatenate([np.zeros((0, 2), "<i2"), *self.points])
        planes = points.T.copy().view(np.uint8).reshape(2, -1, 2).transpose(0, 2, 1)
        text = json.dumps(head, separators=(",", ":")).encode()
        return zlib.compress(text + b"\n" + planes.tobytes() + b"".join(self.images), 9)


def _differences(points: np.ndarray) -> np.ndarray:
    """Points (n, 2) on a grid, as differences to the point before; (NEW_STROKE, y) for a NaN."""
    up = np.isnan(points[:, 0])
    coded = np.empty(points.shape, "<i2")
    coded[up, 0], coded[up, 1] = NEW_STROKE, points[up, 1]
    whole = np.rint(points[~up].astype(float) * GRID).astype(int)
    coded[~up] = np.diff(whole, axis=0, prepend=np.zeros((1, 2), int))
    return coded


def script() -> str:
    """script() -> JavaScript that plays all recordings of a page, to stand at its end."""
    panel, play = (_file(name) for name in ("panel.js", "recorded.js"))
    return f"(() => {{\n{panel.replace('export default { render };', '')}\n{play}}})();\n"


def style() -> str:
    """style() -> the style sheet of panels."""
    return _file("panel.css")


def _file(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")
