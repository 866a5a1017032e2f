"""A panel: sliders made from the model and a live figure, in one widget.

    explore(ball, 12.0)                                   # time plot and phase portrait, all sliders
    explore(ball, 12.0, picture, sliders={"e": (0, 1), "g": False}, verdict=lambda run: f"{len(run.events)} bounces")

Matplotlib owns the figure, the browser owns sliders and pixels. `panel.js` sends the newest values with a number,
one unanswered message at a time; `Panel` answers each with one picture (or one error) that carries the number.
Which bytes make a picture is the business of `Bitmap` alone.
"""

from __future__ import annotations

import io
import math
import os
import re
import traceback
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import anywidget
import numpy as np
import traitlets
from PIL import Image

from .draw.figure import CSS_DPI, style, symbol
from .model import ModelError, System, listed, number
from .run import Run
from .solve import FIXED_STEP, METHODS, simulate

__all__ = ["Bitmap", "Control", "Panel", "View", "explore"]

SETTINGS = ("t_end", "method", "rtol", "step")
JPEG_QUALITY = 88


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


class Bitmap:
    """bitmap.update(run); bitmap.encode(ratio, sharp) -> (mime type, bytes): the picture of a run, only the moving artists drawn anew.

    `ratio` is the number of picture pixels to one CSS pixel. `sharp` gives a PNG (the slider was let go), else a JPEG.
    """

    def __init__(self, view: View):
        self.view, self.figure = view, view.figure
        self.still: dict[float, Any] = {}  # ratio -> saved pixels of the still part

    def update(self, run: Run) -> None:
        same = False
        try:
            self.view.update(run)
            same = not self.view.relimited
        finally:
            if not same:
                self.still.clear()

    def encode(self, ratio: float = 1.0, sharp: bool = True) -> tuple[str, bytes]:
        dpi, self.figure.dpi = self.figure.dpi, CSS_DPI * ratio
        try:
            artists = sorted(self.view.artists, key=lambda artist: artist.get_zorder())
            if ratio not in self.still:
                self.still[ratio] = self._draw_still(artists)
            renderer = self.figure.canvas.get_renderer()
            renderer.restore_region(self.still[ratio])
            for artist in artists:
                artist.draw(renderer)
            size = int(renderer.width), int(renderer.height)
            image = Image.frombuffer("RGBX", size, bytes(renderer.buffer_rgba()), "raw", "RGBX", 0, 1)
        finally:
            self.figure.dpi = dpi
        file = io.BytesIO()
        if sharp:
            image.convert("RGB").save(file, "PNG", compress_level=1)
        else:
            image.save(file, "JPEG", quality=JPEG_QUALITY, subsampling=0)  # full colour resolution: thin coloured lines stay clean
        return ("image/png" if sharp else "image/jpeg"), file.getvalue()

    def _draw_still(self, moving: list[Any]) -> Any:
        for artist in moving:
            artist.set_animated(True)
        try:
            with style():
                self.figure.canvas.draw()
        finally:
            for artist in moving:
                artist.set_animated(False)
        return self.figure.canvas.copy_from_bbox(self.figure.bbox)


@dataclass
class Control:
    """One slider or select. `key` is "p.g", "start.y", "choice.…" or an option of simulate; a log slider has `step` in decades."""

    key: str
    group: str
    name: str
    index: str  # subscript of the name
    value: float | str
    kind: str = "slider"  # "slider", "log" or "select"
    low: float = 0.0
    high: float = 1.0
    step: float = 0.01
    unit: str = ""
    meaning: str = ""
    options: tuple[str, ...] = ()
    only: str = ""  # shown with "fixed" or with "adaptive" methods only

    @property
    def ends(self) -> tuple[float | str, ...]:
        return self.options if self.kind == "select" else (self.low, self.high)


class Panel(anywidget.AnyWidget):
    """Panel(title, controls, compute, view, verdict, run): the widget behind `explore`. compute(values by control key) -> Run."""

    _esm = Path(__file__).with_name("panel.js")
    _css = Path(__file__).with_name("panel.css")
    spec = traitlets.Dict().tag(sync=True)
    first = traitlets.Bytes().tag(sync=True)  # the default run's picture, sent once: a panel is not empty while later cells run

    def __init__(self, title: str, controls: list[Control], compute: Callable[[dict], Run], view: View, verdict: Callable[[Run], str], run: Run):
        self.title, self.controls, self.compute, self.view, self.verdict, self.run = title, controls, compute, view, verdict, run
        self.defaults = {control.key: control.value for control in controls}
        self.values, self.ratio, self.bitmap, self.png = dict(self.defaults), 1.0, Bitmap(view), view.figure.png()
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
                    self.bitmap.update(run)
                    str(self.verdict(run))
                except Exception as error:
                    error.add_note(f"in the panel of {self.title!r}, with {control.name}{control.index} = {end}")
                    raise
        self._picture(self.defaults, False)

    def _picture(self, values: dict, sharp: bool) -> tuple[dict, bytes]:
        run = self.compute(values)
        self.bitmap.update(run)
        mime, picture = self.bitmap.encode(self.ratio if sharp else 1.0, sharp)
        answer = {"kind": "picture", "mime": mime, "verdict": str(self.verdict(run)), "values": values}
        self.run, self.values = run, values
        return answer, picture

    def _receive(self, _: object, message: dict, __: object) -> None:
        """ready and set are answered with a picture, export with a sentence; what goes wrong is answered, too."""
        buffers = []
        try:
            if message["kind"] == "export":
                answer = {"kind": "said", "text": self.export(message["what"])}
            else:
                self.ratio = min(max(float(message.get("ratio", self.ratio)), 1.0), 2.0)
                answer, picture = self._picture(self.values | message.get("values", {}), message.get("sharp", True))
                buffers = [picture]
        except ModelError as error:
            answer = {"kind": "error", "text": str(error)}
        except Exception as error:
            answer = {"kind": "error", "text": f"{type(error).__name__}: {error}", "trace": traceback.format_exc()}
        self.send(answer | {key: message.get(key) for key in ("seq", "view")}, buffers)

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
            self.bitmap.update(self.run)
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
                "rtol": options.pop("rtol", 1e-8), "step": options.pop("step", _rounded(horizon / 1000, 1))}
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

    controls += _controls(system, p, begin if start and "start" not in taken else {}, settings if method else {}, sliders, taken, run, startable)
    view = (draw or _time_and_phase)(run)
    view = _Together(*view) if isinstance(view, tuple | list) else view
    panel = Panel(title or system.name, controls, compute, view, verdict or _verdict, run)
    if os.environ.get("LABKIT_CHECK") == "1":
        panel.check()
    return panel


def _controls(system: System, p: Mapping[str, float], begin: Mapping[str, float], settings: Mapping[str, Any], sliders: object, taken: set[str],
              run: Run, startable: Callable[[str, float], bool]) -> list[Control]:
    """The sliders in their groups, with the range that the author, the Parameter or the default run gives each."""
    only = None if sliders is None or isinstance(sliders, Mapping) else [sliders] if isinstance(sliders, str) else list(sliders)
    ranges = {} if only is not None or sliders is None else dict(sliders)
    known = [*system.parameters, *system.units, *SETTINGS]
    if unknown := [name for name in (only or ranges) if name not in known]:
        raise ModelError(f"sliders names {listed(unknown)}, which {system.name!r} does not have; there are {listed(known)}")
    wanted = [name for name in known if (only is None or name in (*only, *SETTINGS)) and ranges.get(name, True) is not False and name not in taken]
    controls = []
    for name in (name for name in p if name in wanted):
        made = system.parameters[name]
        low, high = _span(p[name], made.low, made.high)
        controls.append(Control(f"p.{name}", "parameters", *_symbol(name, made.symbol), p[name], low=low, high=high, unit=made.unit, meaning=made.meaning))
    for name in (name for name in begin if name in wanted):
        seen = np.append(run[name][np.isfinite(run[name])], begin[name])
        reach = _rounded(1.5 * np.abs(seen).max(), 1) or 1.0
        wide = (-reach if seen.min() < -1e-6 * reach else 0.0), (reach if seen.max() > 1e-6 * reach or seen.min() >= 0 else 0.0)  # a sign that is kept
        here = np.append(run[name][run.mode_index == run.mode_index[0]], begin[name])  # where the run was in its first mode
        low, high = (next(end for end in ends if end == begin[name] or startable(name, end)) for ends in
                     ((wide[0], _rounded(here.min(), 3), float(here.min()), begin[name]), (wide[1], _rounded(here.max(), 3), float(here.max()), begin[name])))
        meaning = system.meanings[name] or "at the start"
        controls.append(Control(f"start.{name}", "start", *_symbol(name), begin[name], low=low, high=high, unit=system.unit(name), meaning=meaning))
    if settings:
        end = settings["t_end"]
        controls += [
            Control("t_end", "algorithm", "t", "end", end, low=_rounded(end / 10, 1), high=_rounded(2 * end, 2), unit=system.time, meaning="end of the run"),
            Control("method", "algorithm", "method", "", settings["method"], "select", options=tuple(METHODS), meaning="how a step is made"),
            Control("rtol", "algorithm", "rtol", "", settings["rtol"], "log", 1e-12, 1e-2, 1.0, meaning="relative tolerance", only="adaptive"),
            Control("step", "algorithm", "h", "", settings["step"], "log", _rounded(end / 20_000, 1), _rounded(end / 20, 1), 0.1, system.time,
                    "size of a step", only="fixed"),
        ]
    for control in controls:
        name = control.key.rpartition(".")[2]
        step = None
        if not isinstance(ranges.get(name, True), bool):
            try:
                control.low, control.high, *step = (number(limit, f"slider of {name!r}") for limit in ranges[name])
            except TypeError:
                raise ModelError(f"slider of {name!r} must be (low, high), (low, high, step) or False, not {ranges[name]!r}") from None
        if control.kind != "select":
            control.low, control.high = min(control.low, control.value), max(control.high, control.value)
            if control.low >= control.high or (control.kind == "log" and control.low <= 0):
                raise ModelError(f"the slider of {name!r} cannot run from {control.low:g} to {control.high:g}: give sliders={{{name!r}: (low, high)}}")
        if control.kind == "slider":
            control.step = step[0] if step else _nice((control.high - control.low) / 250)
    return [control for control in controls if control.key.rpartition(".")[2] in wanted]


def _span(value: float, low: float | None, high: float | None) -> tuple[float, float]:
    """The declared range; an end that is not declared lies near the value and, unless the value is 0, on its side of zero."""
    near = sorted((_rounded(0.2 * value, 1), _rounded(2.5 * value, 2))) if value else (-1.0, 1.0)
    reach = max(near[1] - near[0], abs(value))
    below, above = (near[0] if high is None else min(near[0], high - reach)), (near[1] if low is None else max(near[1], low + reach))
    return (below if low is None else low), (above if high is None else high)


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")


def _nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return _rounded(power * max(factor for factor in (1, 2, 5) if factor <= value / power * (1 + 1e-12)), 1)


def _symbol(name: str, latex: str | None = None) -> tuple[str, str]:
    """_symbol("omega0") -> ("ω", "0"): letter and index as plain text for the page, from the symbol that equations and axes use."""
    text = re.sub(r"\\(?:mathrm|text|mathit)\{([^{}]*)\}", r"\1", (latex or symbol(name)).strip("$"))
    text = re.sub(r"\\([A-Za-z]+) ?", lambda found: _greek(found[1]), text)
    base, _, index = text.partition("_")
    index = index.strip("{}")
    return (name, "") if re.search(r"[\\{}^]", base + index) else (base, index)


def _greek(word: str) -> str:
    size = "CAPITAL" if word[0].isupper() else "SMALL"
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {word.upper().replace('LAMBDA', 'LAMDA').removeprefix('VAR')}")
    except KeyError:
        return "\\" + word


def _verdict(run: Run) -> str:
    """finished at 40 s; 26 events (13 "switch up", 13 "switch down"); 312 steps, 0.4 ms, compiled"""
    counts = Counter(event.transition for event in run.events)
    kinds = ", ".join(f'{count} "{name}"' for name, count in counts.most_common(3)) + (", …" if len(counts) > 3 else "")
    events = f"{len(run.events)} event{'s' * (len(run.events) != 1)} ({kinds})" if run.events else "no events"
    work = run.work
    return f"{run.stopped} at {run.t[-1]:.6g} {run.system.time}; {events}; {work.steps} steps, {_rounded(1000 * work.seconds, 2):.6g} ms, {work.backend}"


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
