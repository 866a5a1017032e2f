"""A panel: sliders made from the model and a live figure, in one widget.

    explore(ball, 12.0, picture, sliders={"e": (0, 1), "g": False},
            verdict=lambda run: f"{len(run.events)} bounces",
            presets={"dead": {"e": 0.0}, "on the moon": {"g": 1.62}})

Matplotlib owns the figure, the browser owns sliders and pixels. `panel.js` sends the newest values
with a number, one unanswered message at a time; `Panel` answers each with one picture (or one
error) that carries the number.
A picture is what has changed of the figure, as strokes for a canvas: see draw/record.py.
"""

from __future__ import annotations

import base64
import io
import mimetypes
import os
import sys
import tempfile
import textwrap
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets
from matplotlib.text import Text
from PIL import Image

from .arguments import unambiguous
from .controls import SETTINGS, Control, controls_of, rounded, symbol_and_index
from .draw.figure import CSS_DPI, PNG_DPI, _palette_png, figure, style
from .draw.overlay import Handle, Overlay
from .draw.record import Scene
from .draw.ticks import said as in_words
from .draw.view import Only, Together, View
from .draw.words import described
from .interrupt import hear_interrupts, interruptible
from .model import ModelError, System, check_names, listed, named, number
from .recorded import MIME, record
from .run import Ended, Run
from .several import Merged, Several, file_name
from .solve import FIXED_STEP, simulate

__all__ = ["Control", "Panel", "explore"]

MOST = 3_000_000  # bytes of points; a picture with more of them is sent as a bitmap
KINDS = {"ready", "set", "drag", "limits", "start", "clear", "cursor", "hold", "large", "undo"}
METHOD, RTOL = "DOP853", 1e-8  # what explore begins with
WIDEST = 1.9  # width over height of the place for a picture in a classroom, of 1280 × 720 pixels


class Panel(anywidget.AnyWidget):
    """Panel(title, controls, compute, views, verdict, run, …): the widget behind `explore`.

    compute(values by control key) -> Run. Of a view it needs `figure`, `artists`, `relimited` and
    `update` (draw/view.py says what they are).
    """

    _esm = Path(__file__).with_name("panel.js")
    _css = Path(__file__).with_name("panel.css")
    spec = traitlets.Dict().tag(sync=True)
    # The default run's picture, sent once: a panel is not empty while later cells run.
    first = traitlets.Bytes().tag(sync=True)

    def __init__(
        self,
        title: str,
        controls: list[Control],
        compute: Callable[[dict], Run],
        views: list[View],
        verdict: Callable[[Run], str],
        run: Run,
        presets: Mapping[str, dict] | None = None,
        taken: Collection[str] = (),
    ):
        self.title, self.controls, self.compute, self.verdict = title, controls, compute, verdict
        self.run, self.presets, self.first_run = run, dict(presets or {}), run
        self.taken = {*taken}  # what a choice sets
        self.defaults = {one.key: Own(one.value) if one.apart else one.value for one in controls}
        self.values, self.figure = dict(self.defaults), views[0].figure
        self.size, self.png = self.figure.css_size, self.figure.png()
        # What follows is on the screen only: handles for the start in each plane, cursor, held run,
        # clicked trajectories.
        self.shows = [show for part in views for show in getattr(part, "shows", ())]
        starts = [
            Handle(show.axes, show.x, show.names[0], meaning="start")
            for show in self.shows
            if show.plane
            and any(f"start.{name}" in self.defaults for name in (show.x, *show.names))
        ]
        self.overlay = Overlay(self.shows)
        self.handles = [part for part in (*views, *starts) if isinstance(part, Handle)]
        for handle in starts:
            handle.update(run)
        self.view = Together(*views, self.overlay, *starts)
        self.scene = Scene(self.view)
        self.begun: list[dict[str, float]] = []  # start values of the clicked trajectories
        self.home: dict[Any, tuple] = {}  # limits of the axes that the user has zoomed
        self.limits = {axes: (axes.get_xlim(), axes.get_ylim()) for axes in self.figure.axes}
        self.kept, self.past = self.values, []  # settings after the last change, and before it
        self.held, self.t = False, None
        self.inches, self.tall = tuple(self.figure.get_size_inches()), False
        self.stopped, self.words = self._judge(run)
        width, height = (float(CSS_DPI * inches) for inches in self.inches)
        moves = bool(self.shows) or any(
            isinstance(part, View) and type(part).at is not View.at for part in views
        )
        # Under Voilà the kernel's folder is not the reader's.
        download = os.environ.get("SERVER_SOFTWARE", "").startswith("voila")
        words = described(self.figure)
        super().__init__(
            first=self.png,
            spec={
                "title": title,
                "width": width,
                "height": height,
                "fixed": FIXED_STEP,
                "verdict": self.words,
                "stopped": self.stopped,
                "alt": words if words.startswith(title) else f"{title}: {words}",
                "controls": [asdict(control) for control in controls],
                "presets": self.presets,
                "time": run.system.time,
                "handles": [handle.meaning for handle in self.handles],
                "moves": moves,
                "help": self._help(moves),
                "buttons": self._buttons(moves, download),
                "download": download,
            },
        )
        self.on_msg(self._receive)
        hear_interrupts()

    def _repr_mimebundle_(self, **_: object) -> tuple[dict, dict]:
        """The widget view, and a picture with its words: all that a saved notebook keeps."""
        data, metadata = super()._repr_mimebundle_()
        (width, height), (stopped, said) = self.size, self._judge(self.first_run)
        if self.verdict is _verdict:  # without its time: the picture is the same in each run
            said = _counted(self.first_run)
        values = [str(one).replace(" ", "\u00a0") for one in self.shown()]  # no line breaks inside
        lines = [", ".join(values), stopped, said, "Run this cell for sliders."]
        png, more = _captioned(self.png, self.inches[0], list(filter(None, lines)))
        if os.environ.get("LABKIT_RECORD") == "1":  # a page is being made (recorded.py)
            data = {**data, MIME: base64.b64encode(record(self)).decode()}
        return {**data, "image/png": png, "text/plain": repr(self)}, {
            **metadata,
            "image/png": {"width": width, "height": height + more, "alt": self.spec["alt"]},
        }

    def shown(self) -> list[Control]:
        """panel.shown() -> the controls that are there at first: of steps or of a tolerance."""
        hidden = "adaptive" if self.defaults.get("method") in FIXED_STEP else "fixed"
        return [control for control in self.controls if control.only != hidden]

    def __repr__(self) -> str:
        return f"panel of {self.title!r}"

    def check(self) -> None:
        """panel.check(): compute, update the picture and judge; errors come out.

        At both ends of every slider, at every choice and preset.
        """
        tries = [
            ({control.key: end}, f"{control.name}{control.index} = {end}")
            for control in self.controls
            for end in control.ends
        ]
        tries += [(values, f"preset {name!r}") for name, values in self.presets.items()]
        for values, words in tries:
            try:
                run = self.compute(self.defaults | values)
                self.view.update(run)
                self._judge(run)
            except Exception as error:
                error.add_note(f"in the panel of {self.title!r}, with {words}")
                raise
        self._as_at_first()
        self._show(self.defaults)
        self._picture()
        self.scene.forget()  # nobody has seen this picture

    def _help(self, moves: bool) -> str:
        """What mouse, fingers and keys do here."""
        planes, ring = any(show.plane for show in self.shows), bool(self.handles)
        arrows = " or ".join(["cursor"] * moves + ["ring"] * ring)
        said = {
            "click in a plane: trajectory from there": planes,
            "drag a ring": ring,
            "click in a map: its values": any(handle.click for handle in self.handles),
            "over a time plot: cursor; click: it stays; a finger sideways moves it": moves,
            "drag: shifts the axes · wheel or two fingers: zoom · double click: back": True,
            "+ − 0: zoom": True,
            "a: next axes": len(self.figure.axes) > 1,
            "Alt-arrows: shift · Ctrl-Z: undo": True,
            f"arrow keys: {arrows}": arrows,
            "Enter: which": moves and ring,
            "Space: play": moves,
            "n: start at the ring": planes and ring,
            "Delete: clear": planes,
        }
        return " · ".join(words for words, does in said.items() if does)

    def _buttons(self, moves: bool, download: bool) -> list[tuple[str, str, str]]:
        """Each by what it does, its words and what it says under the mouse."""
        ghost = "keeps the run on show as a grey ghost, to compare others with it"
        away = "takes away the trajectories that clicks have started (Delete)"
        where = "into the browser's downloads" if download else "beside the notebook"
        return [
            *[("play", "▶ Play", "lets the cursor run through the time (Space)")] * moves,
            ("undo", "Undo", "the settings before the last change (Ctrl-Z)"),
            ("reset", "Reset", "values, axes and cursor as at first"),
            ("home", "Home", "the axes as they were before the zoom (0)"),
            *[("hold", "Hold", ghost)] * moves,
            *[("clear", "Clear", away)] * any(show.plane for show in self.shows),
            ("large", "Classroom", "large letters, thick lines, axes that stay"),
            ("full", "Full screen", "only this panel (Esc: back)"),
            ("code", "Code", "copies these settings as a line of Python"),
            *((what, f"Save {what.upper()}", where) for what in ("csv", "npz", "png")),
        ]

    def _judge(self, run: Run) -> tuple[str, str]:
        """Why the run did not come to its end, and the verdict, which is on complete runs only."""
        if run.ended in (Ended.FINISHED, Ended.TERMINAL):
            return "", str(self.verdict(run))
        return f"The run stopped before its end: {run.stopped}.", ""

    def code(self) -> str:
        """panel.code() -> 'explore(system, 12.0, k=2.3, start={"x": 1.0}, method="RK45")'.

        The settings on show as a line of Python: what differs from the model and from `explore`.
        """
        run, values = self.run, self.values
        one = next(iter(run.values())) if isinstance(run, Several) else run
        system, how = run.system, one.options
        said = [
            f"{name}={_written(value)}"
            for name, value in run.p._asdict().items()
            if value != system.parameters[name].value or self._shared(f"p.{name}")
        ]
        first = [
            f'"{name}": {_written(value)}'
            for name, value in run.start.items()
            if value != system.start.get(name) or self._shared(f"start.{name}")
        ]
        said += ["start={" + ", ".join(first) + "}"] * bool(first)
        if how["method"] != METHOD and "method" not in self.taken:
            said.append(f'method="{how["method"]}"')
        if how["method"] in FIXED_STEP:
            said += [f"step={_written(how['step'])}"] * (not {"method", "step"} & self.taken)
        elif how["rtol"] != RTOL and "rtol" not in self.taken:
            said.append(f"rtol={_written(how['rtol'])}")
        name = _name_of(system, "system")
        if isinstance(run, Several):
            each = [f'"{label}": {_name_of(one, label)}' for label, one in system.systems.items()]
            name = "{" + ", ".join(each) + "}"
        chosen = [
            f"{control.name}: {values[control.key]}"
            for control in self.controls
            if control.key.startswith("choice.") and values[control.key] != control.value
        ]
        line = f"explore({', '.join([name, _written(how['t_end']), *said])})"
        return line + (f"  # {', '.join(chosen)}" if chosen else "")

    def _shared(self, key: str) -> bool:
        """Whether models that begin with different values have been given one."""
        return isinstance(self.defaults.get(key), Own) and not isinstance(self.values[key], Own)

    # -- what the browser asks for -----------------------------------------------------------------

    def _receive(self, _: object, message: dict, __: object) -> None:
        """Every message gets one answer: a picture, or a sentence after an export or an error."""
        buffers: list[bytes] = []
        kind = message["kind"]
        try:
            with interruptible():
                if kind == "export":
                    answer, buffers = self._export(message)
                elif kind not in KINDS:
                    raise ModelError(f"a panel cannot {kind!r}")
                else:
                    getattr(self, f"_{kind}")(message)
                    if kind in ("set", "drag") and message.get("settled", True):
                        self._keep()
                    self._resize(float(message.get("scale", 1.0)))
                    answer, buffers = self._picture(
                        min(max(float(message.get("ratio", 1.0)), 0.3), 3.0),
                        message.get("settled", True),
                        kind == "ready",
                    )
        except ModelError as error:
            answer = {"kind": "error", "text": str(error)}
        except KeyboardInterrupt:
            answer = {"kind": "error", "text": "Interrupted. The picture shows the run before."}
        except Exception as error:
            answer = {
                "kind": "error",
                "text": f"{type(error).__name__}: {error}",
                "trace": traceback.format_exc(),
            }
        self.send(answer | {key: message.get(key) for key in ("seq", "view", "settled")}, buffers)

    def _ready(self, message: dict) -> None:
        """A new page wants the whole picture."""

    def _set(self, message: dict) -> None:
        if message.get("home"):
            self._as_at_first()
        self._show((self.defaults if message.get("reset") else self.values) | message["values"])

    def _as_at_first(self) -> None:
        """Axes and cursor, as before any hand."""
        self.home.clear()
        self.t = None
        for axes, (x, y) in self.limits.items():  # limits that stand are not drawn again
            if axes.get_xlim() != x:
                axes.set_xlim(x, auto=None)
            if axes.get_ylim() != y:
                axes.set_ylim(y, auto=None)

    def _keep(self) -> None:
        """A step that undo takes back: from one settled change to the next."""
        if self.values != self.kept:
            self.past = [*self.past[-99:], self.kept]
            self.kept = self.values

    def _undo(self, message: dict) -> None:
        if self.values == self.kept and self.past:
            self.kept = self.past.pop()
        self._show(self.kept)

    def _drag(self, message: dict) -> None:
        handle, system, found = self.handles[message["handle"]], self.run.system, {}
        sliders = {one.sets: one for one in self.controls if one.kind != "select"}
        places = handle.values(*self._data(handle.axes, message))
        there = dict.fromkeys([*sliders, *system.parameters, *system.units])
        _known(f"the handle {handle.meaning!r}", places, there, system)
        for name, value in places.items():
            if name in sliders:
                found[sliders[name].key] = sliders[name].nearest(float(value))
            elif name in system.parameters:
                found[f"p.{name}"] = float(value)
        self._show(self.values | found)

    def _limits(self, message: dict) -> None:
        """New limits, linear in pixels (logarithms of a logarithmic axis); none: the first ones."""
        axes = self.figure.axes[message["axes"]]
        now = axes.get_xlim(), axes.get_ylim()
        if message["limits"] is None:
            x, y = self.home.pop(axes, now)
        else:
            corners = np.array(message["limits"], dtype=float).reshape(2, 2)
            x, y = axes.transScale.inverted().transform(corners).T
            width = np.abs([x[1] - x[0], y[1] - y[0]])
            if not (
                np.isfinite([x, y]).all() and (width > 1e-9 * np.abs([x, y]).max(axis=1)).all()
            ):
                raise ModelError("this is as far as the zoom goes")
            self.home.setdefault(axes, now)
        axes.set(xlim=x, ylim=y)
        self.view.update(self.run)

    def _start(self, message: dict) -> None:
        """A trajectory from a place in a plane; it stays while sliders move, until cleared."""
        axes = self.figure.axes[message["axes"]]
        show = next((show for show in self.shows if show.axes is axes and show.plane), None)
        if show is None:
            raise ModelError("trajectories start in a phase plane")
        place = map(float, self._data(axes, message))
        begin = dict(zip((show.x, show.names[0]), place, strict=True))
        run = self._from(begin)  # raises when it cannot start there
        self.begun.append(begin)
        self.overlay.add([*self._begin(self.begun[:-1]), run])

    def _from(self, start: Mapping[str, float]) -> Run:
        return self.compute(self.values | {f"start.{name}": x for name, x in start.items()})

    def _begin(self, starts: list[dict[str, float]]) -> list[Run]:
        """The runs from these places, but for those where the values on show allow none."""
        runs = []
        for start in starts:
            with suppress(ModelError):
                runs.append(self._from(start))
        return runs

    def _clear(self, message: dict) -> None:
        self.begun = self.begun[: len(self.begun) - message["last"]] if "last" in message else []
        self.overlay.add(self._begin(self.begun))

    def _cursor(self, message: dict) -> None:
        """The cursor at the instant t, or where a point of a time plot is; none takes it away."""
        t = message.get("t")
        if "x" in message:
            t = self._data(self.figure.axes[message["axes"]], message)[0]
        self.t = None if t is None else float(np.clip(t, self.run.t[0], self.run.t[-1]))
        self._point()

    def _point(self) -> None:
        if self.t is not None:
            self.t = float(np.clip(self.t, self.run.t[0], self.run.t[-1]))
            self.view.at(self.run, self.t)
        self.overlay.point(self.run, self.t)

    def _hold(self, message: dict) -> None:
        self.held = bool(message["on"])
        self.overlay.hold(self.run if self.held else None)

    def _large(self, message: dict) -> None:
        """For a classroom: large type and thick lines, and limits that stay."""
        self.figure.steady = bool(message["on"])

    def _resize(self, scale: float) -> None:
        """Type and lines relative to the picture, which the page shows at `scale`.

        Larger where the picture is small; in a classroom the smallest word is 20 pixels high, and
        a low picture takes the height that a projector has for it.
        """
        zoom = min(max(0.85 / max(scale, 0.01), 1.0), 1.6)
        if self.figure.steady:
            words = [text for text in self.figure.findobj(Text) if text.get_text()]
            sizes = [
                vars(one).get("given", one.get_fontsize()) for one in words if one.get_visible()
            ]
            least = min(sizes, default=9.5)  # not of words made smaller for want of room
            zoom = min(max(20 / (least * CSS_DPI / 72 * max(scale, 0.01)), zoom), 2.6)
        if abs(zoom - self.scene.zoom) > 0.01 or self.figure.steady != self.tall:
            self.scene.zoom, self.tall = zoom, self.figure.steady
            width, height = ((1 + 1e-9) * side / zoom for side in self.inches)
            if self.tall and height < width / WIDEST:
                height = _tall(self.figure, width, height, width / WIDEST)
            self.figure.set_size_inches(width, height)

    def _data(self, axes: Any, message: dict) -> tuple[float, float]:
        """Pixels of the picture that the page shows -> data coordinates."""
        place = message["x"], self.scene.recorder.height - message["y"]
        return tuple(axes.transData.inverted().transform(place))

    # -- the picture -------------------------------------------------------------------------------

    def _show(self, values: dict) -> None:
        run = self.compute(values)
        stopped, words = self._judge(run)
        self.view.update(run)
        self.run, self.values, self.stopped, self.words = run, values, stopped, words
        if self.begun:
            self.overlay.add(self._begin(self.begun))
        self._point()

    def _picture(
        self, ratio: float = 1.0, settled: bool = True, everything: bool = True
    ) -> tuple[dict, list[bytes]]:
        message, buffers = self.scene.picture(ratio, settled, everything)
        if len(buffers[0]) > MOST:
            message = {"mime": "image/jpeg", "size": message["size"]}
            buffers = [self.scene.bitmap()]
        height, t = self.scene.recorder.height, self.run.t
        times = {show.axes for show in self.shows if not show.plane}
        planes = {show.axes for show in self.shows if show.plane}
        click = {handle.axes: k for k, handle in enumerate(self.handles) if handle.click}
        axes = [
            {
                "kind": "time" if ax in times else "plane" if ax in planes else "",
                "click": click.get(ax, -1),
                "box": [box.x0, height - box.y1, box.width, box.height],
                "home": ax not in self.home,
                "limits": ax.transScale.transform(np.column_stack([ax.get_xlim(), ax.get_ylim()]))
                .ravel()
                .tolist(),
            }
            for ax in self.figure.axes
            for box in [ax.bbox]
        ]
        grips = [
            [float(x), float(height - y)]
            for handle in self.handles
            for x, y in [handle.axes.transData.transform(handle.at_place)]
        ]
        return {
            "kind": "picture",
            "verdict": self.words,
            "stopped": self.stopped,
            "values": self.values,
            "axes": axes,
            "grips": grips,
            "t": self.t,
            "span": [float(t[0]), float(t[-1])],
            "reading": self._reading(),
            "begun": len(self.begun),
            "undo": len(self.past),
            "hold": self.held,
            "large": self.figure.steady,
            "code": self.code(),
            **message,
        }, buffers

    def _reading(self) -> str:
        """Values at the cursor: t = 3.2 s: x = 0.31 m, v = −1 m/s; mode slip

        Of several models: t = 3.2 s: x = 0.31 m (plain), 0.35 m (warned); v = …
        """
        if self.t is None:
            return ""
        several, system, there = isinstance(self.run, Several), self.run.system, self.run.at(self.t)
        each = there if several else {"": there}
        names = (n for show in self.shows for n in (*show.names, *[show.x] * show.plane))
        said = []
        for name in dict.fromkeys(names):
            found = [
                f"{in_words(values[name])} {system.unit(name)}".strip() + f" ({label})" * several
                for label, values in each.items()
                if np.isfinite(values.get(name, np.nan))
            ]
            said += [f"{''.join(symbol_and_index(name))} = {', '.join(found)}"] if found else []
        words = f"t = {in_words(self.t)} {system.time}" + ": " * bool(said)
        mode = f"; {there['mode']}" if len(system.modes) > 1 else ""
        return words + ("; " if several else ", ").join(said) + mode

    def _export(self, message: dict) -> tuple[dict, list[bytes]]:
        if not self.spec["download"]:
            return {"kind": "said", "text": self.export(message["what"])}, []
        with tempfile.TemporaryDirectory() as folder:
            paths = self._save(message["what"], folder)
            name, data = paths[0].name, paths[0].read_bytes()
            if len(paths) > 1:
                name, whole = "runs.zip", io.BytesIO()
                with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
                    for path in paths:
                        archive.write(path, path.name)
                data = whole.getvalue()
        mime = mimetypes.guess_type(name)[0] or "application/octet-stream"
        said = {"kind": "said", "text": f"Downloaded {name}", "name": name, "mime": mime}
        return said, [data]

    def export(self, what: str, folder: str | os.PathLike = ".") -> str:
        """panel.export("csv") -> a sentence that says where the run on show went.

        "csv", "npz" or "png", into the folder, by default the notebook's; of several runs a file
        each. Never writes over an earlier file. Raises ModelError when it cannot be written.
        """
        return f"Saved {', '.join(map(str, self._save(what, folder)))}"

    def _save(self, what: str, folder: str | os.PathLike) -> list[Path]:
        if what not in ("csv", "npz", "png"):
            raise ModelError(f"a panel exports 'csv', 'npz' or 'png', not {what!r}")
        stem = file_name(self.title) or "run"
        several = isinstance(self.run, Several) and what != "png"
        for suffix in ("", *(f"_{k}" for k in range(2, 1000))):
            path = Path(folder).absolute() / f"{stem}{suffix}.{what}"
            paths = self.run.files(path) if several else [path]
            if not any(one.exists() for one in paths):
                break
        else:
            raise ModelError(f"there are 999 files like {stem}.{what} already: delete some")
        if what == "png":
            self.figure.save_png(path, dpi=200)
        else:
            getattr(self.run, f"to_{what}")(path)
        return paths


def _tall(figure: Any, width: float, low: float, high: float) -> float:
    """The least height with which axes of one scale are as large as they can be; others: all."""
    square = [ax for ax in figure.axes if ax.axison and ax.get_aspect() != "auto"]
    sides = {}
    for height in np.linspace(low, high, 6 if square else 1).tolist():
        figure.set_size_inches(width, height)
        figure.arrange()
        sides[height] = min((ax.get_position().height * height for ax in square), default=0.0)
    most = max(sides.values())
    return next(height for height, side in sides.items() if side >= 0.97 * most) if most else high


class Own(float):
    """What a slider shows while models that differ in it keep each its own; equal to no number."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Own) and float(self) == float(other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = float.__hash__


@unambiguous
def explore(
    system: System | Mapping[str, System],
    horizon: float,
    draw: Callable[[Any], Any] | None = None,
    *,
    sliders: Mapping[str, object] | Iterable[str] | None = None,
    start: bool | Mapping[str, float] | None = True,
    method: bool | str | None = True,
    verdict: Callable[[Run], str] | None = None,
    title: str | None = None,
    choices: Mapping[str, Mapping[str, Mapping[str, object]]] | None = None,
    presets: Mapping[str, Mapping[str, object]] | None = None,
    **options: object,
) -> Panel:
    """explore(system, horizon, draw) -> a panel of sliders and a live figure.

    Let it be the last line of a cell. explore({"plain": system, "warned": other}, horizon): several
    models, one set of sliders, one picture.
    draw      draw(run) -> a View, or a list of Views that share a figure, also Handle, Motion and
              mode_diagram(system, axes=…);
              left out: time plot and phase portrait
    sliders   name -> (low, high), (low, high, step) or False (no slider), for parameters, states,
              "t_end", "rtol", "step"; or a list: only these get a slider, in this order. A range
              left out comes from the Parameter or the default run
    start     True: sliders for the initial state; False, None, {}: none; {"x": 2.0}: that begin
              there
    method    True: method, tolerance or step, and end time can be chosen; False, None: not;
              "RK4": chosen, beginning with this one
    verdict   verdict(run) -> a sentence under the picture; left out: how it ended, events, work
    choices   label -> option -> arguments of simulate, also "system": a select between variants,
              the first is the default,
              {"branch": {"x' > 0": {"mode": "rising"}, "x' < 0": {"mode": "falling"}}}
    presets   name -> values of parameters, start values, options: {"resonance": {"omega": 2.0}}; a
              button each, all else as at first
    options   what else simulate takes (points=…, rtol=…, mode=…) and values of parameters

    Of several models, draw and verdict get name -> Run. A parameter or start value that models
    have in common has one slider; where their defaults differ, each keeps its own until the slider
    is moved or a preset names it, and then all take that value.

    Raises ModelError for a name that no system has, for parameters of one name with different
    units or ranges, and whatever the default run or picture raises. With LABKIT_CHECK=1 in the
    environment it tries both ends of every slider and lets all errors out (a widget swallows them).
    """
    several = isinstance(system, Mapping)
    whole = Merged(system) if several else system
    models: dict[str, System] = whole.systems if several else {"": system}
    form = "{name: value}, True or False"
    given = {} if start is True or not start else named(start, "start", form)
    given = {name: number(value, f"start of {name!r}") for name, value in given.items()}
    _known("start", given, whole.units, whole)
    begins = {label: one.start | _among(given, one.units) for label, one in models.items()}
    values = {key: options.pop(key) for key in list(options) if key in whole.parameters}
    ps = {
        label: one.values(_among(values, one.parameters))._asdict() for label, one in models.items()
    }
    horizon = number(horizon, "horizon")
    wide = horizon - number(options.get("t0", 0.0), "t0")
    settings = {
        "t_end": horizon,
        "method": METHOD if method is None or isinstance(method, bool) else method,
        "rtol": options.pop("rtol", RTOL),
        "step": options.pop("step", rounded(wide / 1000, 1)),
    }
    choices = {  # a page says them as texts
        str(label): {str(option): arguments for option, arguments in variants.items()}
        for label, variants in (choices or {}).items()
    }
    taken = {
        key for variants in choices.values() for arguments in variants.values() for key in arguments
    }  # what a choice sets has no slider
    if several and "system" in taken:
        raise ModelError("choices cannot choose a system where several are shown already")
    known = [*whole.parameters, *whole.units, *SETTINGS]
    ranges = sliders if isinstance(sliders, Mapping) else {}
    listing = [] if sliders is None else [sliders] if isinstance(sliders, str) else list(sliders)
    _known("sliders", listing, known, whole)
    wanted = {
        name
        for name in (known if sliders is ranges or sliders is None else [*listing, *SETTINGS])
        if name not in taken and ranges.get(name, True) is not False
    }

    def own(values: Mapping[str, Any], group: str, mine: Mapping[str, float]) -> dict[str, float]:
        """The model's own values, but for those that all models were given."""
        found = {name: values.get(f"{group}.{name}", value) for name, value in mine.items()}
        return {n: mine[n] if isinstance(value, Own) else value for n, value in found.items()}

    def compute(values: Mapping[str, Any]) -> Any:
        chosen: dict[str, Any] = {
            key: value
            for label, variants in choices.items()
            for key, value in variants[values[f"choice.{label}"]].items()
        }
        variant = chosen.pop("system", None)
        how = settings | {key: values[key] for key in settings if key in values}
        del how["rtol" if how["method"] in FIXED_STEP else "step"]
        runs = {}
        for label, one in models.items():
            model = variant or one
            parameters = own(values, "p", ps[label])
            where = own(values, "start", begins[label])
            if variant is not None:
                parameters = _among(parameters, model.parameters)
                where = _among(where, model.start)
            arguments = {**options, "start": where, **parameters, **how, **chosen}
            runs[label] = simulate(model, **arguments)
        return Several(whole, runs) if several else runs[""]

    controls = []
    for label, variants in choices.items():
        each = tuple(variants)
        controls.append(
            Control(f"choice.{label}", "variant", label, "", each[0], "select", options=each)
        )
    first = {control.key: control.value for control in controls}
    run = compute(first)

    def startable(name: str, value: float) -> bool:
        soon = run.t[0] + 1e-6 * (run.t[-1] - run.t[0])
        try:
            compute(first | {f"start.{name}": value, "t_end": soon, "method": METHOD})
        except ModelError:
            return False
        return True

    made: dict[str, Control] = {}
    for label, one in models.items():
        for control in controls_of(
            one,
            ps[label],
            begins[label] if start and "start" not in taken else {},
            settings if method else {},
            wanted,
            ranges,
            run[label] if several else run,
            startable,
        ):
            same = made.setdefault(control.key, control)
            if same is control:
                continue
            same.low, same.high = min(same.low, control.low), max(same.high, control.high)
            if same.value != control.value and same.kind != "select":
                same.apart = True
                apart = f"by default {same.value:g}, in {label} {control.value:g}"
                same.meaning = f"{same.meaning} ({apart})".strip()
    order = ("parameters", "start", "algorithm")
    place = {} if sliders is ranges else {name: k for k, name in enumerate(listing)}

    def standing(control: Control) -> tuple[int, int]:  # a list is an order, too
        return order.index(control.group), place.get(control.sets, len(place))

    controls += sorted(made.values(), key=standing)
    view = (draw or (_together if several else _time_and_phase))(run)
    parts = view if isinstance(view, tuple | list) else (view,)
    if not parts or not all(hasattr(part, "figure") for part in parts):
        raise ModelError(f"draw must return a View, or a list of them, not {view!r:.60}")
    views = [view for part in parts for view in getattr(part, "views", (part,))]
    for view in views:
        if not getattr(view, "ready", True):
            view.update(run)
    panel = Panel(
        title or whole.name,
        controls,
        compute,
        views,
        verdict or (_verdicts if several else _verdict),
        run,
        _presets(presets or {}, whole, controls),
        taken,
    )
    if os.environ.get("LABKIT_CHECK") == "1":
        panel.check()
    return panel


def _among(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}


def _known(what: str, names: Iterable[str], there: Collection[str], system: Any) -> None:
    """A ModelError for names that the system has not, or none of several."""
    several = isinstance(system, Merged)
    has = f"none of {system.name} has" if several else f"{system.name!r} does not have"
    check_names(names, there, f"{what} names {{}}, which {has}")


def _presets(
    presets: Mapping[str, Mapping[str, object]], system: Any, controls: list[Control]
) -> dict[str, dict]:
    """Values by control key. Raises ModelError for an unknown name and a wrong value."""
    keys = {name: f"p.{name}" for name in system.parameters}
    keys |= {name: f"start.{name}" for name in system.units}
    keys |= {control.sets: control.key for control in controls}
    options = {control.key: control.options for control in controls if control.options}
    found: dict[str, dict] = {}
    for preset, values in presets.items():
        if not isinstance(values, Mapping):
            raise ModelError(
                f"preset {preset!r} must be a dict of names and values, not {values!r}"
            )
        _known(f"preset {preset!r}", values, keys, system)
        found[preset] = {}
        for name, value in values.items():
            key, what = keys[name], f"{name!r} of preset {preset!r}"
            if key not in options:
                value = number(value, what)
            elif (value := str(value)) not in options[key]:
                raise ModelError(f"{what} must be one of {listed(options[key])}, not {value!r}")
            for one in getattr(system, "systems", {"": system}).values():
                if key == f"p.{name}" and name in one.parameters:
                    try:
                        one.values({name: value})
                    except ModelError as error:
                        raise ModelError(f"preset {preset!r}: {error}") from None
            found[preset][key] = value
    return found


def _verdict(run: Run) -> str:
    """finished at 40 s; 2 events (1 "up", 1 "down"); 312 steps, 0.4 ms, compiled"""
    work = run.work
    return f"{_counted(run)}, {rounded(1000 * work.seconds, 2):.6g} ms, {work.backend}"


def _counted(run: Run) -> str:
    """What of it is the same whenever and wherever it runs."""
    counts = Counter(event.transition for event in run.events)
    kinds = ", ".join(f'{count} "{name}"' for name, count in counts.most_common(3))
    kinds = f" ({kinds}{', …' * (len(counts) > 3)})" if counts else ""
    return f"{_end(run)}; {_many(run)}{kinds}; {run.work.steps} steps"


def _verdicts(runs: Several) -> str:
    """plain: finished at 40 s, 26 events; warned: finished at 40 s, no events"""
    return "; ".join(f"{name}: {_end(run)}, {_many(run)}" for name, run in runs.items())


def _end(run: Run) -> str:
    return f"{run.stopped} at {run.t[-1]:.6g} {run.system.time}"


def _many(run: Run) -> str:
    count = len(run.events)
    return f"{count} event{'s' * (count != 1)}" if count else "no events"


def _name_of(system: System, otherwise: str) -> str:
    """What the notebook calls it."""
    names = vars(sys.modules["__main__"]).items()
    return next((key for key, value in names if value is system and key[0] != "_"), otherwise)


def _written(value: float) -> str:
    """_written(2) -> '2.0': a number as Python reads it."""
    return repr(float(f"{value:.12g}"))


def _captioned(png: bytes, width: float, lines: list[str]) -> tuple[bytes, int]:
    """A picture `width` inches wide with words below; and by how many CSS pixels it has grown."""
    rows = [row for line in lines for row in textwrap.wrap(line, int(12.5 * width))]
    fig = figure(0, width=width, height=0.12 + 0.19 * len(rows))
    with style():
        fig.text(0.01, 0.5, "\n".join(rows), va="center", parse_math=False, linespacing=1.25)
        fig.canvas.draw()
    above = Image.open(io.BytesIO(png))
    below = Image.fromarray(np.asarray(fig.canvas.buffer_rgba()))
    both = Image.new("RGB", (above.width, above.height + below.height), "white")
    both.paste(above.convert("RGB"), (0, 0))
    both.paste(below.convert("RGB"), (0, above.height))
    return _palette_png(both), round(below.height * CSS_DPI / PNG_DPI)


def _time_and_phase(run: Run) -> View:
    from .draw import figure, phase_portrait, time_plot

    if len(run.system.states) < 2:
        return time_plot(run)
    fig = figure(1, 2, widths=[3, 2])
    return Together(
        time_plot(run, tuple(run.system.states[:2]), axes=fig.axes[0]),
        phase_portrait(run, axes=fig.axes[1], title=""),
    )


def _together(runs: Several) -> View:
    """What the models have in common laid over each other; what they have not, each for itself."""
    from .draw import figure, time_plot

    every = [{**run.system.units, **run.system.outputs} for run in runs.values()]
    common = [name for name in every[0] if all(name in names for names in every)]
    if common:
        return time_plot(runs, *common[:2], title="")
    axes = figure(len(runs), 1, height=1.2 + 1.9 * len(runs), sharex=True).axes
    return Together(
        *(
            Only(name, time_plot(run, run.system.states[0], axes=ax, title=name))
            for (name, run), ax in zip(runs.items(), axes, strict=True)
        )
    )
