"""A panel: sliders made from the model and a live figure, in one widget.

    explore(ball, 12.0)                                   # time plot and phase portrait, all sliders
    explore(ball, 12.0, picture, sliders={"e": (0, 1), "g": False}, verdict=lambda run: f"{len(run.events)} bounces")
    explore(ball, 12.0, picture, presets={"dead": {"e": 0.0}, "on the moon": {"g": 1.62}})

Matplotlib owns the figure, the browser owns sliders and pixels. `panel.js` sends the newest values with a number,
one unanswered message at a time; `Panel` answers each with one picture (or one error) that carries the number.
A picture is what has changed of the figure, as strokes for a canvas: see draw/record.py.
"""

from __future__ import annotations

import os
import re
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import anywidget
import numpy as np
import traitlets

from .controls import SETTINGS, Control, controls_of, rounded
from .draw.curves import Curves
from .draw.figure import CSS_DPI
from .draw.overlay import Handle, Overlay
from .draw.record import Scene
from .draw.sketch import Motion
from .draw.view import Only, Together
from .draw.words import described
from .model import ModelError, System, listed, number, unambiguous
from .run import Run
from .several import Merged, Several
from .solve import FIXED_STEP, simulate

__all__ = ["Control", "Panel", "View", "explore"]

MOST = 3_000_000  # bytes of points; a picture with more of them is sent as a bitmap


class View(Protocol):
    """What a panel needs of a picture: any object with these four, made once by `draw(run)` from the default run.

    figure     made by labkit.draw.figure
    artists    those that `update` changes: drawn anew for every picture, the rest of the figure only once
    relimited  True when the last `update` changed anything else (limits, ticks, a title): the still part is drawn again
    """

    figure: Any
    artists: Iterable[Any]
    relimited: bool

    def update(self, run: Run) -> None: ...


class Panel(anywidget.AnyWidget):
    """Panel(title, controls, compute, view, verdict, run, presets): the widget behind `explore`. compute(values by control key) -> Run."""

    _esm = Path(__file__).with_name("panel.js")
    _css = Path(__file__).with_name("panel.css")
    spec = traitlets.Dict().tag(sync=True)
    first = traitlets.Bytes().tag(
        sync=True
    )  # the default run's picture, sent once: a panel is not empty while later cells run

    def __init__(
        self,
        title: str,
        controls: list[Control],
        compute: Callable[[dict], Run],
        view: View,
        verdict: Callable[[Run], str],
        run: Run,
        presets: Mapping[str, dict] | None = None,
    ):
        self.title, self.controls, self.compute, self.verdict, self.run, self.presets = (
            title,
            controls,
            compute,
            verdict,
            run,
            dict(presets or {}),
        )
        self.defaults = {control.key: control.value for control in controls}
        self.values, self.figure, self.size, self.png = (
            dict(self.defaults),
            view.figure,
            view.figure.css_size,
            view.figure.png(),
        )
        # What follows is on the screen only: handles for the start in each plane, cursor, held run, clicked trajectories.
        views = getattr(view, "views", (view,))
        self.shows = [show for part in views for show in getattr(part, "shows", ())]
        starts = [
            Handle(show.axes, show.x, show.names[0], meaning="start")
            for show in self.shows
            if show.plane
            and any(f"start.{name}" in self.defaults for name in (show.x, *show.names))
        ]
        self.overlay, self.handles = (
            Overlay(self.shows),
            [part for part in (*views, *starts) if isinstance(part, Handle)],
        )
        for handle in starts:
            handle.update(run)
        self.view = Together(*views, self.overlay, *starts)
        self.scene = Scene(self.view)
        self.begun: list[dict[str, float]] = []  # start values of the clicked trajectories
        self.home: dict[Any, tuple] = {}  # limits of the axes that the user has zoomed
        self.t: float | None = None
        self.inches = tuple(view.figure.get_size_inches())
        self.words = str(verdict(run))
        width, height = (float(CSS_DPI * inches) for inches in self.figure.get_size_inches())
        super().__init__(
            first=self.png,
            spec={
                "title": title,
                "width": width,
                "height": height,
                "fixed": FIXED_STEP,
                "verdict": self.words,
                "alt": _in_words(view.figure, title),
                "controls": [asdict(control) for control in controls],
                "presets": self.presets,
                "time": run.system.time,
                "planes": any(s.plane for s in self.shows),
                "handles": [handle.meaning for handle in self.handles],
                "moves": bool(self.shows) or any(isinstance(part, Motion) for part in views),
            },
        )
        self.on_msg(self._receive)

    def _repr_mimebundle_(self, **_: object) -> tuple[dict, dict]:
        """The widget view, and beside it the static picture, which is all that a saved notebook keeps."""
        data, metadata = super()._repr_mimebundle_()
        width, height = self.size
        return {**data, "image/png": self.png, "text/plain": repr(self)}, {
            **metadata,
            "image/png": {"width": width, "height": height},
        }

    def __repr__(self) -> str:
        return f"panel of {self.title!r}"

    def check(self) -> None:
        """panel.check(): compute, update the picture and judge at both ends of every slider, at every choice and preset; errors come out."""
        tries = [
            ({control.key: end}, f"{control.name}{control.index} = {end}")
            for control in self.controls
            for end in control.ends
        ]
        for values, words in [
            *tries,
            *((values, f"preset {name!r}") for name, values in self.presets.items()),
        ]:
            try:
                run = self.compute(self.defaults | values)
                self.view.update(run)
                str(self.verdict(run))
            except Exception as error:
                error.add_note(f"in the panel of {self.title!r}, with {words}")
                raise
        self._show(self.defaults)
        self._picture()
        self.scene.forget()  # nobody has seen this picture

    # -- what the browser asks for --------------------------------------------------------------------------------------

    def _receive(self, _: object, message: dict, __: object) -> None:
        """Every message gets one answer: a picture, or a sentence after an export or when something went wrong."""
        buffers: list[bytes] = []
        kind = message["kind"]
        try:
            if kind == "export":
                answer = {"kind": "said", "text": self.export(message["what"])}
            elif kind not in (
                "ready",
                "set",
                "drag",
                "limits",
                "start",
                "clear",
                "cursor",
                "hold",
                "large",
            ):
                raise ModelError(f"a panel cannot {kind!r}")
            else:
                getattr(self, f"_{kind}")(message)
                self._resize(float(message.get("scale", 1.0)))
                answer, buffers = self._picture(
                    min(max(float(message.get("ratio", 1.0)), 0.3), 3.0),
                    message.get("settled", True),
                    kind == "ready",
                )
        except ModelError as error:
            answer = {"kind": "error", "text": str(error)}
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
        self._show((self.defaults if message.get("reset") else self.values) | message["values"])

    def _drag(self, message: dict) -> None:
        handle = self.handles[message["handle"]]
        found, known = {}, {control.key: control for control in self.controls}
        for name, value in handle.values(*self._data(handle.axes, message)).items():
            key = f"p.{name}" if name in self.run.system.parameters else f"start.{name}"
            if control := known.get(key):
                value = (
                    float(f"{round(value / control.step) * control.step:.12g}")
                    if control.kind == "slider"
                    else float(value)
                )  # a slider's round numbers
                found[key] = min(max(value, control.low), control.high)
            elif name in self.run.system.parameters:
                found[key] = float(value)
        self._show(self.values | found)

    def _limits(self, message: dict) -> None:
        """New limits, linear in pixels (of a logarithmic axis, logarithms); none: those before the first zoom."""
        axes = self.figure.axes[message["axes"]]
        self.home.setdefault(axes, (axes.get_xlim(), axes.get_ylim()))
        if message["limits"] is None:
            x, y = self.home.pop(axes)
        else:
            x, y = (
                axes.transScale.inverted()
                .transform(np.array(message["limits"], dtype=float).reshape(2, 2))
                .T
            )
            if not (
                np.all(np.isfinite((x, y)))
                and np.all(
                    np.abs(np.subtract(*np.array([x, y]).T)) > 1e-9 * np.abs([x, y]).max(axis=1)
                )
            ):
                raise ModelError("this is as far as the zoom goes")
        axes.set(xlim=x, ylim=y)
        self.view.update(self.run)

    def _start(self, message: dict) -> None:
        """A trajectory from a place in a plane; it stays while sliders move, until all are cleared."""
        axes = self.figure.axes[message["axes"]]
        show = next((show for show in self.shows if show.axes is axes and show.plane), None)
        if show is None:
            raise ModelError("trajectories start in a phase plane")
        begin = dict(
            zip((show.x, show.names[0]), map(float, self._data(axes, message)), strict=True)
        )
        self._begin(self.values, [begin])  # raises when it cannot start there
        self.begun.append(begin)
        self.overlay.add(self._begin(self.values, self.begun))

    def _begin(
        self, values: dict, starts: list[dict[str, float]], strict: bool = True
    ) -> list[Run]:
        runs = []
        for start in starts:
            try:
                runs.append(
                    self.compute(values | {f"start.{name}": value for name, value in start.items()})
                )
            except ModelError:
                if strict and len(starts) == 1:
                    raise
        return runs

    def _clear(self, message: dict) -> None:
        self.begun = self.begun[: len(self.begun) - message["last"]] if "last" in message else []
        self.overlay.add(self._begin(self.values, self.begun))

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
        self.overlay.hold(self.run if message["on"] else None)

    def _large(self, message: dict) -> None:
        """For a classroom: large type and thick lines, and limits that stay."""
        self.figure.steady = bool(message["on"])

    def _resize(self, scale: float) -> None:
        """Type and lines relative to the picture: 1.4 times as large in a classroom, larger too where the page shows the picture at a smaller `scale`."""
        zoom = (1.4 if self.figure.steady else 1.0) * min(max(0.85 / max(scale, 0.01), 1.0), 1.6)
        if abs(zoom - self.scene.zoom) > 0.01:
            self.scene.zoom = zoom
            self.figure.set_size_inches(*((1 + 1e-9) * side / zoom for side in self.inches))

    def _data(self, axes: Any, message: dict) -> tuple[float, float]:
        """Pixels of the picture that the page shows -> data coordinates."""
        return tuple(
            axes.transData.inverted().transform(
                (message["x"], self.scene.recorder.height - message["y"])
            )
        )

    # -- the picture ----------------------------------------------------------------------------------------------------

    def _show(self, values: dict) -> None:
        run = self.compute(values)
        words = str(self.verdict(run))
        self.view.update(run)
        self.run, self.values, self.words = run, values, words
        if self.begun:
            self.overlay.add(self._begin(values, self.begun, strict=False))
        self._point()

    def _picture(
        self, ratio: float = 1.0, settled: bool = True, everything: bool = True
    ) -> tuple[dict, list[bytes]]:
        message, buffers = self.scene.picture(ratio, settled, everything)
        if len(buffers[0]) > MOST:
            message, buffers = (
                {"mime": "image/jpeg", "size": message["size"]},
                [self.scene.bitmap()],
            )
        height, t = self.scene.recorder.height, self.run.t
        times = {show.axes for show in self.shows if not show.plane}
        planes = {show.axes for show in self.shows if show.plane}
        axes = [
            {
                "kind": "time" if ax in times else "plane" if ax in planes else "",
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
            "values": self.values,
            "axes": axes,
            "grips": grips,
            "t": self.t,
            "span": [float(t[0]), float(t[-1])],
            "reading": self._reading(),
            "begun": len(self.begun),
            **message,
        }, buffers

    def _reading(self) -> str:
        """Values at the cursor: t = 3.2 s: x = 0.31 m, v = −1 m/s; mode slip"""
        if self.t is None:
            return ""
        if isinstance(self.run, Several):
            return self._readings(self.run)
        system, values = self.run.system, self.run.at(self.t)
        names = list(
            dict.fromkeys(
                name
                for show in self.shows
                for name in (*show.names, *([show.x] if show.plane else []))
                if name in values
            )
        )
        words = ", ".join(
            f"{name} = {values[name]:.4g} {system.unit(name)}".strip()
            for name in names
            if np.isfinite(values[name])
        )
        return f"t = {self.t:.4g} {system.time}: {words}".replace("-", "−") + (
            f"; {values['mode']}" if len(system.modes) > 1 else ""
        )

    def _readings(self, runs: Several) -> str:
        """t = 3.2 s: x = 0.31 m (plain), 0.35 m (warned)"""
        there, said = runs.at(self.t), []
        for name in dict.fromkeys(name for show in self.shows for name in show.names):
            found = [
                f"{values[name]:.4g} {runs.system.unit(name)}".strip() + f" ({label})"
                for label, values in there.items()
                if np.isfinite(values.get(name, np.nan))
            ]
            said += [f"{name} = {', '.join(found)}"] if found else []
        words = f"t = {self.t:.4g} {runs.system.time}" + ": " * bool(said) + "; ".join(said)
        return words.replace("-", "−")

    def export(self, what: str) -> str:
        """panel.export("csv") -> a sentence that says where the run on show went ("csv", "npz", "png"): beside the notebook.

        Never writes over an earlier file. Raises ModelError when the folder cannot be written.
        """
        if what not in ("csv", "npz", "png"):
            raise ModelError(f"a panel exports 'csv', 'npz' or 'png', not {what!r}")
        stem = re.sub(r"\W+", "_", self.title).strip("_").lower() or "run"
        names = (
            Path.cwd() / f"{stem}{suffix}.{what}"
            for suffix in ("", *(f"_{k}" for k in range(2, 1000)))
        )
        path = next((path for path in names if not path.exists()), None)
        if path is None:
            raise ModelError(f"there are 999 files like {stem}.{what} already: delete some")
        if what == "png":
            self.figure.save_png(path, dpi=200)
        else:
            getattr(self.run, f"to_{what}")(path)
        return f"Saved {path}"


@unambiguous
def explore(
    system: System | Mapping[str, System],
    horizon: float,
    draw: Callable[[Any], Any] | None = None,
    *,
    sliders: Mapping[str, object] | Iterable[str] | None = None,
    start: bool | Mapping[str, float] = True,
    method: bool | str = True,
    verdict: Callable[[Run], str] | None = None,
    title: str | None = None,
    choices: Mapping[str, Mapping[str, Mapping[str, object]]] | None = None,
    presets: Mapping[str, Mapping[str, object]] | None = None,
    **options: object,
) -> Panel:
    """explore(system, horizon, draw) -> a panel of sliders and a live figure.

    Let it be the last line of a cell. explore({"plain": system, "warned": other}, horizon): several
    models, one set of sliders, one picture.
    draw      draw(run) -> a View, or a list of Views that share a figure, also Handle and Motion;
              left out: time plot and phase portrait
    sliders   name -> (low, high), (low, high, step) or False (no slider), for parameters, states,
              "t_end", "rtol", "step"; or a list: only these names get a slider. A range left out
              comes from the Parameter or the default run
    start     True: sliders for the initial state; False: none; {"x": 2.0}: that begin there
    method    True: method, tolerance or step, and end time can be chosen; False: not; "RK4":
              chosen, beginning with this one
    verdict   verdict(run) -> a sentence under the picture; left out: how it ended, events, work
    choices   label -> option -> arguments of simulate, also "system": a select between variants,
              the first is the default,
              {"branch": {"x' > 0": {"mode": "rising"}, "x' < 0": {"mode": "falling"}}}
    presets   name -> values of parameters, start values, options: {"resonance": {"omega": 2.0}}; a
              button each, all else as at first
    options   what else simulate takes (points=…, rtol=…, mode=…) and values of parameters

    Of several models, draw and verdict get name -> Run. A parameter or start value that models
    have in common has one slider; where their defaults differ, each keeps its own as long as the
    slider stands where it began, and all take the slider's value as soon as it is moved.

    Raises ModelError for a name that no system has, for parameters of one name with different
    units or ranges, and whatever the default run or picture raises. With LABKIT_CHECK=1 in the
    environment it tries both ends of every slider and lets all errors out (a widget swallows them).
    """
    several = isinstance(system, Mapping)
    whole = Merged(system) if several else system
    models: dict[str, System] = whole.systems if several else {"": system}
    given = start if isinstance(start, Mapping) else {}
    begins = {
        label: {**one.start, **{k: v for k, v in given.items() if not several or k in one.units}}
        for label, one in models.items()
    }
    named = {key: options.pop(key) for key in list(options) if key in whole.parameters}
    ps = {
        label: one.values({k: v for k, v in named.items() if k in one.parameters})._asdict()
        for label, one in models.items()
    }
    horizon = number(horizon, "horizon")
    settings = {
        "t_end": horizon,
        "method": method if isinstance(method, str) else "DOP853",
        "rtol": options.pop("rtol", 1e-8),
        "step": options.pop("step", rounded(horizon / 1000, 1)),
    }
    choices = choices or {}
    taken = {
        key for variants in choices.values() for arguments in variants.values() for key in arguments
    }  # what a choice sets has no slider
    if several and "system" in taken:
        raise ModelError("choices cannot choose a system where several are shown already")
    defaults: dict[str, Any] = {}  # of the sliders, by key: of models that differ, the first one's
    for label in models:
        for group, values in (("p", ps[label]), ("start", begins[label])):
            defaults = {f"{group}.{name}": value for name, value in values.items()} | defaults

    def own(values: Mapping[str, Any], group: str, mine: Mapping[str, float]) -> dict[str, float]:
        """The model's own values, but for sliders that were moved."""
        keys = {name: f"{group}.{name}" for name in mine}
        moved = {n: values[k] for n, k in keys.items() if values.get(k, defaults[k]) != defaults[k]}
        return {**mine, **moved}

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
                parameters = {k: v for k, v in parameters.items() if k in model.parameters}
                where = {k: v for k, v in where.items() if k in model.start}
            arguments = {**options, "start": where, **parameters, **how, **chosen}
            runs[label] = simulate(model, **arguments)
        return Several(whole, runs) if several else runs[""]

    controls = [
        Control(
            f"choice.{label}",
            "variant",
            label,
            "",
            next(iter(variants)),
            "select",
            options=tuple(variants),
        )
        for label, variants in choices.items()
    ]
    first = {control.key: control.value for control in controls}
    run = compute(first)

    def startable(name: str, value: float) -> bool:
        soon = run.t[0] + 1e-6 * (run.t[-1] - run.t[0])
        try:
            compute(first | {f"start.{name}": value, "t_end": soon, "method": "DOP853"})
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
            _sliders_of(one, sliders, whole) if several else sliders,
            taken,
            run[label] if several else run,
            startable,
        ):
            same = made.setdefault(control.key, control)
            if same is control:
                continue
            same.low, same.high = min(same.low, control.low), max(same.high, control.high)
            if same.value != control.value and same.kind != "select":
                apart = f"by default {same.value:g}, in {label} {control.value:g}"
                same.meaning = f"{same.meaning} ({apart})".strip()
    order = ("parameters", "start", "algorithm")
    controls += sorted(made.values(), key=lambda control: order.index(control.group))
    view = (draw or (_together if several else _time_and_phase))(run)
    view = Together(*view) if isinstance(view, tuple | list) else view
    for part in getattr(view, "views", (view,)):
        if isinstance(part, Handle | Motion | Curves):
            part.update(run)
    panel = Panel(
        title or whole.name,
        controls,
        compute,
        view,
        verdict or (_verdicts if several else _verdict),
        run,
        _presets(presets or {}, whole, controls),
    )
    if os.environ.get("LABKIT_CHECK") == "1":
        panel.check()
    return panel


def _sliders_of(system: System, sliders: object, whole: Merged) -> object:
    """Of the author's sliders, those of one model. Raises ModelError for a name that none has."""
    if sliders is None:
        return None
    names = [sliders] if isinstance(sliders, str) else list(sliders)  # type: ignore[call-overload]
    known = [*whole.parameters, *whole.units, *SETTINGS]
    if unknown := [name for name in names if name not in known]:
        raise ModelError(
            f"sliders names {listed(unknown)}, which none of {whole.name} has; there are "
            f"{listed(known)}"
        )
    mine = [name for name in names if name in (*system.parameters, *system.units, *SETTINGS)]
    return {name: sliders[name] for name in mine} if isinstance(sliders, Mapping) else mine


def _presets(
    presets: Mapping[str, Mapping[str, object]], system: System, controls: list[Control]
) -> dict[str, dict]:
    """Values by control key. Raises ModelError for a name that no control and no parameter has."""
    keys = {
        control.key.removeprefix("start.").removeprefix("p.").removeprefix("choice."): control.key
        for control in controls
    }
    keys = (
        {name: f"p.{name}" for name in system.parameters}
        | {name: f"start.{name}" for name in system.units}
        | keys
    )
    for preset, values in presets.items():
        if not isinstance(values, Mapping):
            raise ModelError(
                f"preset {preset!r} must be a dict of names and values, not {values!r}"
            )
        if unknown := [name for name in values if name not in keys]:
            raise ModelError(
                f"preset {preset!r} names {listed(unknown)}, which {system.name!r} does not "
                f"have; there are {listed(keys)}"
            )
    return {
        preset: {keys[name]: value for name, value in values.items()}
        for preset, values in presets.items()
    }


def _verdict(run: Run) -> str:
    """finished at 40 s; 26 events (13 "switch up", 13 "switch down"); 312 steps, 0.4 ms, compiled"""
    counts = Counter(event.transition for event in run.events)
    kinds = ", ".join(f'{count} "{name}"' for name, count in counts.most_common(3)) + (
        ", …" if len(counts) > 3 else ""
    )
    events = (
        f"{len(run.events)} event{'s' * (len(run.events) != 1)} ({kinds})"
        if run.events
        else "no events"
    )
    work = run.work
    return f"{run.stopped} at {run.t[-1]:.6g} {run.system.time}; {events}; {work.steps} steps, {rounded(1000 * work.seconds, 2):.6g} ms, {work.backend}"


def _verdicts(runs: Several) -> str:
    """plain: finished at 40 s, 26 events; warned: finished at 40 s, no events"""
    said = []
    for name, run in runs.items():
        count = len(run.events)
        events = f"{count} event{'s' * (count != 1)}" if count else "no events"
        said.append(f"{name}: {run.stopped} at {run.t[-1]:.6g} {run.system.time}, {events}")
    return "; ".join(said)


def _in_words(figure: Any, title: str) -> str:
    """The alternative text of a picture in a panel."""
    words = described(figure)
    return words if words.startswith(title) else f"{title}: {words}"


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
