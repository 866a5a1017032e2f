"""A panel: sliders made from the model and a live figure, in one widget.

    explore(ball, 12.0)                                   # time plot and phase portrait, all sliders
    explore(ball, 12.0, picture, sliders={"e": (0, 1), "g": False}, verdict=lambda run: f"{len(run.events)} bounces")

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
import traitlets

from .controls import SETTINGS, Control, controls_of, rounded
from .draw.record import Scene
from .model import ModelError, System, number
from .run import Run
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
    """Panel(title, controls, compute, view, verdict, run): the widget behind `explore`. compute(values by control key) -> Run."""

    _esm = Path(__file__).with_name("panel.js")
    _css = Path(__file__).with_name("panel.css")
    spec = traitlets.Dict().tag(sync=True)
    first = traitlets.Bytes().tag(sync=True)  # the default run's picture, sent once: a panel is not empty while later cells run

    def __init__(self, title: str, controls: list[Control], compute: Callable[[dict], Run], view: View, verdict: Callable[[Run], str], run: Run):
        self.title, self.controls, self.compute, self.view, self.verdict, self.run = title, controls, compute, view, verdict, run
        self.defaults = {control.key: control.value for control in controls}
        self.values, self.png, self.scene = dict(self.defaults), view.figure.png(), Scene(view)
        width, height = view.figure.css_size
        super().__init__(first=self.png, spec={
            "title": title, "width": width, "height": height, "fixed": FIXED_STEP, "verdict": str(verdict(run)),
            "controls": [asdict(control) for control in controls],
        })
        self.on_msg(self._receive)

    def _repr_mimebundle_(self, **_: object) -> tuple[dict, dict]:
        """The widget view, and beside it the static picture, which is all that a saved notebook keeps."""
        data, metadata = super()._repr_mimebundle_()
        width, height = self.view.figure.css_size
        return {**data, "image/png": self.png, "text/plain": repr(self)}, {**metadata, "image/png": {"width": width, "height": height}}

    def __repr__(self) -> str:
        return f"panel of {self.title!r}"

    def check(self) -> None:
        """panel.check(): compute, update the picture and judge at both ends of every slider and at every choice; errors come out."""
        for control in self.controls:
            for end in control.ends:
                try:
                    run = self.compute(self.defaults | {control.key: end})
                    self.view.update(run)
                    str(self.verdict(run))
                except Exception as error:
                    error.add_note(f"in the panel of {self.title!r}, with {control.name}{control.index} = {end}")
                    raise
        self._picture(self.defaults)
        self.scene.forget()  # nobody has seen this picture

    def _picture(self, values: dict, ratio: float = 1.0, settled: bool = True, everything: bool = True) -> tuple[dict, list[bytes]]:
        run = self.compute(values)
        self.view.update(run)
        verdict = str(self.verdict(run))
        message, buffers = self.scene.picture(ratio, settled, everything)
        if len(buffers[0]) > MOST:
            message, buffers = {"mime": "image/jpeg", "size": message["size"]}, [self.scene.bitmap()]
        answer = {"kind": "picture", "verdict": verdict, "values": values, **message}
        self.run, self.values = run, values
        return answer, buffers

    def _receive(self, _: object, message: dict, __: object) -> None:
        """ready and set are answered with a picture, export with a sentence; what goes wrong is answered, too."""
        buffers: list[bytes] = []
        try:
            if message["kind"] == "export":
                answer = {"kind": "said", "text": self.export(message["what"])}
            else:
                ratio = min(max(float(message.get("ratio", 1.0)), 1.0), 2.0)
                answer, buffers = self._picture(self.values | message.get("values", {}), ratio, message.get("settled", True), message["kind"] == "ready")
        except ModelError as error:
            answer = {"kind": "error", "text": str(error)}
        except Exception as error:
            answer = {"kind": "error", "text": f"{type(error).__name__}: {error}", "trace": traceback.format_exc()}
        self.send(answer | {key: message.get(key) for key in ("seq", "view", "settled")}, buffers)

    def export(self, what: str) -> str:
        """panel.export("csv") -> a sentence that says where the run on show went ("csv", "npz", "png"): beside the notebook.

        Never writes over an earlier file. Raises ModelError when the folder cannot be written.
        """
        if what not in ("csv", "npz", "png"):
            raise ModelError(f"a panel exports 'csv', 'npz' or 'png', not {what!r}")
        stem = re.sub(r"\W+", "_", self.title).strip("_").lower() or "run"
        names = (Path.cwd() / f"{stem}{suffix}.{what}" for suffix in ("", *(f"_{k}" for k in range(2, 1000))))
        path = next((path for path in names if not path.exists()), None)
        if path is None:
            raise ModelError(f"there are 999 files like {stem}.{what} already: delete some")
        if what == "png":
            self.view.update(self.run)
            self.view.figure.save_png(path, dpi=200)
        else:
            getattr(self.run, f"to_{what}")(path)
        return f"Saved {path}"


def explore(system: System, horizon: float, draw: Callable[[Run], View] | None = None, *, sliders: Mapping[str, object] | Iterable[str] | None = None,
            start: bool | Mapping[str, float] = True, method: bool | str = True, verdict: Callable[[Run], str] | None = None, title: str | None = None,
            choices: Mapping[str, Mapping[str, Mapping[str, object]]] | None = None, **options: object) -> Panel:
    """explore(system, horizon, draw) -> a panel of sliders and a live figure; let it be the last line of a cell.

    draw      draw(run) -> a View, or a list of Views that share a figure; left out: time plot and phase portrait side by side
    sliders   name -> (low, high), (low, high, step) or False (no slider), for parameters, states, "t_end", "rtol", "step";
              or a list: only these names get a slider. A range left out comes from the Parameter or the default run
    start     True: sliders for the initial state; False: none; {"x": 2.0}: sliders that begin there
    method    True: method, tolerance or step, and end time can be chosen; False: not; "RK4": chosen, beginning with this one
    verdict   verdict(run) -> a sentence under the picture; left out: reason for stopping, events, work done
    choices   label -> option -> arguments of simulate, also "system": a select between variants, the first is the default,
              {"first branch": {"x' > 0": {"mode": "rising"}, "x' < 0": {"mode": "falling"}}}
    options   what else simulate takes (points=…, rtol=…, mode=…) and values of parameters

    Raises ModelError for a name that the system does not have, and whatever the default run or picture raises. With
    LABKIT_CHECK=1 in the environment it tries both ends of every slider and lets all errors out (a widget swallows them).
    """
    begin = {**system.start, **(start if isinstance(start, Mapping) else {})}
    p = system.values({key: options.pop(key) for key in list(options) if key in system.parameters})._asdict()
    horizon = number(horizon, "horizon")
    settings = {"t_end": horizon, "method": method if isinstance(method, str) else "DOP853",
                "rtol": options.pop("rtol", 1e-8), "step": options.pop("step", rounded(horizon / 1000, 1))}
    choices = choices or {}
    taken = {key for variants in choices.values() for arguments in variants.values() for key in arguments}  # what a choice sets has no slider

    def compute(values: Mapping[str, Any]) -> Run:
        chosen: dict[str, Any] = {key: value for label, variants in choices.items() for key, value in variants[values[f"choice.{label}"]].items()}
        model = chosen.pop("system", system)
        parameters = {name: values.get(f"p.{name}", value) for name, value in p.items() if name in model.parameters}
        where = {name: values.get(f"start.{name}", value) for name, value in begin.items() if name in model.start}
        how = settings | {key: values[key] for key in settings if key in values}
        how |= {"atol": options.get("atol", how["rtol"] / 100)}
        for useless in ("rtol", "atol") if how["method"] in FIXED_STEP else ("step",):
            del how[useless]
        return simulate(model, **{**options, "start": where, **parameters, **how, **chosen})

    controls = [Control(f"choice.{label}", "variant", label, "", next(iter(variants)), "select", options=tuple(variants)) for label, variants in choices.items()]
    first = {control.key: control.value for control in controls}
    run = compute(first)

    def startable(name: str, value: float) -> bool:
        try:
            compute(first | {f"start.{name}": value, "t_end": run.t[0] + 1e-6 * (run.t[-1] - run.t[0]), "method": "DOP853"})
        except ModelError:
            return False
        return True

    controls += controls_of(system, p, begin if start and "start" not in taken else {}, settings if method else {}, sliders, taken, run, startable)
    view = (draw or _time_and_phase)(run)
    view = _Together(*view) if isinstance(view, tuple | list) else view
    panel = Panel(title or system.name, controls, compute, view, verdict or _verdict, run)
    if os.environ.get("LABKIT_CHECK") == "1":
        panel.check()
    return panel


def _verdict(run: Run) -> str:
    """finished at 40 s; 26 events (13 "switch up", 13 "switch down"); 312 steps, 0.4 ms, compiled"""
    counts = Counter(event.transition for event in run.events)
    kinds = ", ".join(f'{count} "{name}"' for name, count in counts.most_common(3)) + (", …" if len(counts) > 3 else "")
    events = f"{len(run.events)} event{'s' * (len(run.events) != 1)} ({kinds})" if run.events else "no events"
    work = run.work
    return f"{run.stopped} at {run.t[-1]:.6g} {run.system.time}; {events}; {work.steps} steps, {rounded(1000 * work.seconds, 2):.6g} ms, {work.backend}"


class _Together:
    """_Together(view, view): several views that were drawn into one figure, as one view."""

    def __init__(self, *views: View):
        self.views, self.figure, self.relimited = views, views[0].figure, False

    @property
    def artists(self) -> list[Any]:
        return [artist for view in self.views for artist in view.artists]

    def update(self, run: Run) -> None:
        for view in self.views:
            view.update(run)
        self.relimited = any(view.relimited for view in self.views)


def _time_and_phase(run: Run) -> View:
    from .draw import figure, phase_portrait, time_plot

    if len(run.system.states) < 2:
        return time_plot(run)
    fig = figure(1, 2, widths=[3, 2])
    return _Together(time_plot(run, tuple(run.system.states[:2]), axes=fig.axes[0]), phase_portrait(run, axes=fig.axes[1], title=""))
