"""Phase portraits.

phase_portrait(system, "x", "v", starts=40, horizon=10.0)
view = phase_portrait(system, "x", "v", run=run, limits=((-3, 3), (-2, 2)), mu=1.5)
view.update(other_run)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.text import Text
from numpy.typing import ArrayLike

from ..arguments import unambiguous
from ..model import OPTIONS, ModelError, System, listed
from ..run import Run
from ..runs import Runs
from .figure import GREY, head, on_lines, style, when_resized
from .layers import (
    DirectionField,
    Equilibria,
    GuardLines,
    Layer,
    Nullclines,
    Separatrices,
    Trajectories,
    stage,
)
from .plane import Limits, Plane
from .ticks import said
from .view import Shows, View, Window, extent, proper, same_system

Starts = int | Mapping[str, ArrayLike] | ArrayLike | None


@unambiguous
def phase_portrait(
    system: System | Run,
    x: str | None = None,
    y: str | None = None,
    starts: Starts = None,
    run: Run | None = None,
    horizon: float | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    mode: str | None = None,
    t: float = 0.0,
    at: Mapping[str, float] | None = None,
    direction_field: bool = True,
    nullclines: bool = True,
    equilibria: bool = True,
    separatrices: bool = True,
    guards: bool = True,
    title: str | None = None,
    width: float = 8.0,
    height: float = 5.0,
    **parameters: Any,  # and options
) -> PhasePortrait:
    """phase_portrait(system, "x", "v", starts=40, horizon=10.0) -> PhasePortrait.

    In the plane of two states (default: the first two).

    system       a System, or a Run: phase_portrait(run) is phase_portrait(run.system, run=run)
    starts       how many trajectories (spread over the picture; 0: none), or
                 {"x": array, "v": array}, or an array (n, 2);
                 left out: 24, but none when there is a run
    run          one Run, drawn bold; the trajectories are made as it was made: with its parameters,
                 end time, method and tolerances
    horizon      how long the trajectories are; left out: as the run
    limits       ((x low, x high), (y low, y high)); left out: from the run or the starts, and then
                 update() may widen them
    mode, t, at  what the field shows, see Plane: the mode (default: the one that holds at each
                 point), the instant, the other states and held variables
    separatrices the two curves into and the two out of each saddle, where its mode holds
    parameters   of the system; options of simulate_many (method=, rtol=, points=, …) may stand
                 among them
    Nullclines and equilibria are left out, and view.notes says so, when the flow depends on time or
    on further states. Raises ModelError for unknown names, for a parameter that is called like one
    of these options, or when no horizon is known.
    """
    if isinstance(system, Run):
        system, run = system.system, system if run is None else run
    options = {key: parameters.pop(key) for key in list(parameters) if key in OPTIONS}
    p = run.p if run is not None else system.values()
    if parameters:
        p = system.values({**p._asdict(), **parameters})
    plane = Plane(system, x, y, mode=mode, t=t, at=at, p=p)
    if run is not None:
        plane.hold(run.start)
    many = _starts((24 if run is None else 0) if starts is None else starts, plane)
    beside = Beside(plane, run, horizon, options)
    if beside.t_end is None and (many or limits is None):
        raise ModelError("phase_portrait needs horizon=, how long the trajectories are (or a run)")
    runs = beside.runs(many) if isinstance(many, dict) else None
    around = limits or _around([r for r in (run, runs) if r is not None] or [beside.runs()], plane)
    axes = stage(plane, axes, around, width, height)
    if isinstance(many, int):
        many = _spread(many, around, plane) if many else None
        runs = beside.runs(many) if many else None
    wanted = {
        DirectionField: direction_field,
        Nullclines: nullclines,
        Equilibria: equilibria,
        Separatrices: separatrices,
        GuardLines: guards,
    }
    kinds = {kind for kind, use in wanted.items() if use}
    return PhasePortrait(axes, beside, kinds, run, runs, many, limits is not None, title)


class Beside:
    """Beside(plane, run, horizon, options).runs({"x": array, "v": array}) -> Runs in the plane.

    The one place that simulates for a portrait: as the run beside was made (its end time, method,
    tolerances, mode), but for what the author has given. `follow` takes another run for it.
    """

    def __init__(
        self, plane: Plane, run: Run | None, horizon: float | None, options: Mapping[str, object]
    ):
        self.plane, self.horizon, self.given = plane, horizon, dict(options)
        self.t_end: float | None = None
        self.follow(run)

    def follow(self, run: Run | None) -> None:
        like = {}
        if run is not None:  # one made by hand has no options
            made = run.options or {"t0": float(run.t[0]), "t_end": float(run.t[-1])}
            like = {key: value for key, value in made.items() if key not in _OWN}
        began = like.pop("t0", 0.0)
        t0 = self.plane.t or began
        if self.horizon is not None:
            self.t_end = t0 + self.horizon
        elif like:
            self.t_end = t0 + like["t_end"] - began
        like.pop("t_end", None)
        system = self.plane.system
        if like.get("mode") is None:
            shown = self.plane.chosen
            like["mode"] = None if callable(system.mode) or shown == system.mode else shown
        self.how = {"points": 300, **like, "t0": t0, **self.given}

    @property
    def key(self) -> tuple:
        """What the trajectories depend on beside their starts."""
        return self.plane.key, self.t_end, self.how

    def runs(self, start: Mapping[str, np.ndarray] | None = None) -> Runs:
        from ..solve import simulate_many

        held = {name: self.plane.values[name] for name in self.plane.system.held}
        start = {**held, **(start or {})}
        options = {"t_end": self.t_end, **self.how, "start": start}
        return simulate_many(self.plane.system, **options, **self.plane.p._asdict())


# What belongs to a run alone: where it starts, its samples, and how long one tries.
_OWN = frozenset({"start", "points", "max_events", "max_steps"})


class PhasePortrait(View):
    """The picture made by `phase_portrait`: view.layers, view.axes, view.notes, view.equilibria.

    See View for the rest.
    """

    def __init__(
        self,
        axes: Axes,
        beside: Beside,
        kinds: set[type[Layer]],
        run: Run | None,
        runs: Runs | None,
        starts: dict[str, np.ndarray] | None,
        fixed: bool,
        title: str | None,
    ):
        self.axes, self.figure, self.beside, self.starts = axes, axes.get_figure(), beside, starts
        self.plane, self._fixed = beside.plane, fixed
        self.title = self.plane.system.name if title is None else title
        self.shows = [Shows(axes, self.plane.x, (self.plane.y,))]
        self._windows = [
            Window(self.axes, which, *pair, margin=0, near=False)  # the plane is more than the run
            for which, pair in zip("xy", self._limits(), strict=True)
        ]
        self.layers = self._build(kinds, runs, run)
        self.artists = [
            artist
            for part in sorted(self.layers, key=lambda part: part.artists[0].get_zorder())
            for artist in part.artists
        ]
        self._seen = self._state()
        self._name_guards()
        self._write()
        when_resized(axes, self._fit)

    def _fit(self, *_: float) -> None:
        """Words find their places anew in axes of another size."""
        for part in self._of(Equilibria):
            part.name()
        self._name_guards()
        if self._noted is not None:
            width, height = self.figure.get_size_inches()
            reach = width * (1 - self.axes.get_position().x0)
            notes = (on_lines(self.axes, note, 8.5, reach) for note in self.notes)
            self._noted.set_text("\n".join(notes) if height > 2.6 else "")  # else height is dear

    def _of(self, kind: type[Layer]) -> list[Any]:
        return [part for part in self.layers if isinstance(part, kind)]

    def _name_guards(self) -> None:
        for part in self._of(GuardLines):
            part.name(self.layers)

    @property
    def system(self) -> System:
        return self.plane.system

    def _build(self, kinds: set[type[Layer]], runs: Runs | None, run: Run | None) -> list[Layer]:
        plane, axes, limits = self.plane, self.axes, self._limits()
        self.notes: list[str] = []
        self._noted: Text | None = None
        long = (self.beside.t_end or plane.t + 10.0) - plane.t
        timed = plane.depends_on_time(limits, long)
        still = not timed and all(map(plane.is_plane, plane.modes))  # equilibria mean something
        arrows, points = DirectionField in kinds, {Nullclines, Equilibria} & kinds
        guards = GuardLines in kinds and any(map(plane.guards, plane.modes))
        without = ["no nullclines or equilibria"] if points else []
        if timed and (arrows or without):
            at = [f"arrows at t = {said(plane.t)}"] if arrows else []
            self.notes.append("flow depends on time: " + ", ".join(at + without))
        elif not still and (arrows or without):
            hold = ["arrows hold for the other states at their start values"] if arrows else []
            self.notes.append("; ".join(hold + without))
        lines = {Nullclines, GuardLines} & kinds
        shown = " and ".join(["arrows"] * arrows + ["lines"] * bool(lines))
        if self.system.held and shown:
            self.notes.append(f"{shown} for {' and '.join(self.system.held)} as at the start")
        if plane.chosen is not None and len(self.system.modes) > 1 and shown:
            self.notes.append(f"{shown} of mode “{plane.chosen}”")
        layers: list[Layer] = []
        if arrows:
            layers.append(DirectionField(axes, plane))
        if Nullclines in kinds and still:
            layers.append(Nullclines(axes, plane))
        if guards:
            layers.append(made := GuardLines(axes, plane))
            if made.omitted:
                names = ", ".join(made.omitted)
                self.notes.append(f"guards that change with time are not drawn: {names}")
        if runs is not None:
            layers.append(Trajectories(axes, plane, runs))
        if run is not None:
            layers.append(Trajectories(axes, plane, run, bold=True))
        for kind in (Separatrices, Equilibria):
            if kind in kinds and still:
                layers.append(kind(axes, plane))
        return layers

    def _write(self) -> None:
        entries = self._entries()
        self._named = list(entries)
        pairs = [(artist, text) for text, artist in entries.items()]
        head(self.axes, self.title, pairs, aside=True)
        if self.notes and self._noted is None:
            place = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "top"}
            with style():
                self._noted = self.axes.annotate(
                    "\n".join(self.notes), (0, 0), (0, -34), fontsize=8.5, color=GREY, **place
                )

    def _entries(self) -> dict[str, Artist]:
        """Name -> sample of what the layers show; of a name that two of them have, the last."""
        return {text: artist for part in self.layers for artist, text in part.legend()}

    @property
    def equilibria(self) -> list[tuple[float, float, str, str]]:
        """[(x, y, mode, type in words), …] as drawn."""
        return [found for part in self._of(Equilibria) for found in part.found]

    def _limits(self) -> Limits:
        x, y = self.axes.get_xlim(), self.axes.get_ylim()
        return (float(x[0]), float(x[1])), (float(y[0]), float(y[1]))

    def _state(self) -> tuple:
        return self.plane.key, self._limits()

    def update(self, run: Run | Runs | Sequence[Run | Runs]) -> None:
        """view.update(run): another run (bold) and its parameters.

        The trajectories are simulated anew when parameters or held variables changed.
        view.update([run, runs]) brings the trajectories along. Field, nullclines, equilibria and
        guard lines follow the parameters and, after a zoom, the limits.
        """
        given = [run] if isinstance(run, Run | Runs) else list(run)
        one = next((r for r in given if isinstance(r, Run)), None)
        many = next((r for r in given if isinstance(r, Runs)), None)
        if one is None and many is None:
            raise ModelError("update takes a Run, Runs, or a list of both")
        now = one if one is not None else many[0]
        same_system(now, self.system)
        before = self.beside.key
        self.plane.follow(now)
        self.beside.follow(now)
        bold, thin = (
            [part for part in self._of(Trajectories) if isinstance(part.runs, kind)]
            for kind in (Run, Runs)
        )
        self.relimited = False
        if not self._fixed and bold and one is not None:
            names = (self.plane.x, self.plane.y)
            pairs = zip(self._windows, names, strict=True)
            self.relimited = any([window.fit(*extent(one[name])) for window, name in pairs])
        if many is None and thin and self.starts is not None and self.beside.key != before:
            many = self.beside.runs(self.starts)
        for parts, new in ((bold, one), (thin, many)):
            for part in parts if new is not None else ():
                part.update(new)
        if self._state() != self._seen:
            for part in self.layers:
                if not isinstance(part, Trajectories):
                    part.redo()
            self._name_guards()
        self._seen = self._state()
        if list(self._entries()) != self._named:
            self._write()
            self.relimited = True


def _starts(starts: Starts, plane: Plane) -> int | dict[str, np.ndarray]:
    if isinstance(starts, int | np.integer):
        if not 0 <= starts <= 2000:
            raise ModelError(f"starts = {starts}: give a number of trajectories from 0 to 2000")
        return int(starts)
    if isinstance(starts, Mapping):
        if missing := [name for name in (plane.x, plane.y) if name not in starts]:
            raise ModelError(
                f"starts gives no values for {listed(missing)}; for example "
                f"starts={{'{plane.x}': [0, 1], '{plane.y}': [0, 0]}}"
            )
        try:
            values = np.broadcast_arrays(*(np.atleast_1d(v).astype(float) for v in starts.values()))
        except ValueError:
            sizes = {name: np.shape(value) for name, value in starts.items()}
            raise ModelError(f"starts needs arrays of one length, not of shapes {sizes}") from None
        return dict(zip(starts, map(np.array, values), strict=True))
    points = np.atleast_2d(np.asarray(starts, dtype=float))
    if points.ndim != 2 or points.shape[1] != 2:
        raise ModelError(
            "starts must be a number, a mapping of arrays or an array of shape (n, 2), "
            f"not of shape {points.shape}"
        )
    return {plane.x: points[:, 0], plane.y: points[:, 1]}


def _spread(count: int, limits: Limits, plane: Plane) -> dict[str, np.ndarray] | None:
    """Two thirds of the starts along the edge of the picture, one third half as far out."""
    inner = count // 3
    outer = count - inner
    shares = [np.arange(outer) / outer + 0.5 / outer, (np.arange(inner) + 0.25) / max(inner, 1)]
    along = 4 * np.concatenate(shares)
    size = np.concatenate([np.full(outer, 0.97), np.full(inner, 0.5)])
    side, along = along.astype(int) % 4, 2 * (along % 1) - 1
    a = size * np.choose(side, [along, 1, -along, -1])
    b = size * np.choose(side, [-1, along, 1, -along])
    (x0, x1), (y0, y1) = limits
    x, y = (x0 + x1) / 2 + a * (x1 - x0) / 2, (y0 + y1) / 2 + b * (y1 - y0) / 2
    fits = plane.governing(x, y) >= 0  # elsewhere, as under the floor, no run can start
    return {plane.x: x[fits], plane.y: y[fits]} if fits.any() else None


def _around(runs: Sequence[Run | Runs], plane: Plane) -> Limits:
    """Limits with a margin of 8 % around all points of the runs."""
    pairs = [proper(*extent(*(r[name] for r in runs))) for name in (plane.x, plane.y)]
    x, y = ((low - 0.08 * (high - low), high + 0.08 * (high - low)) for low, high in pairs)
    return x, y
