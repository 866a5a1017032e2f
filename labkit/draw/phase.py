"""Phase portraits, and each of their layers alone.

phase_portrait(system, "x", "v", starts=40, horizon=10.0)
view = phase_portrait(system, "x", "v", run=run, limits=((-3, 3), (-2, 2)), mu=1.5)
view.update(other_run)
axes = direction_field(system, "x", "v", limits=((-3, 3), (-2, 2))).axes
nullclines(system, "x", "v", axes=axes)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
    layer,
    stage,
)
from .plane import GRID, Limits, Plane
from .ticks import said
from .view import Shows, View, Window, _proper, extent

__all__ = [
    "PhasePortrait",
    "direction_field",
    "equilibria",
    "guard_lines",
    "nullclines",
    "phase_portrait",
    "trajectories",
]

Starts = int | Mapping[str, ArrayLike] | ArrayLike | None


@unambiguous
def direction_field(
    system: System,
    x: str | None = None,
    y: str | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    mode: str | None = None,
    t: float = 0.0,
    at: Mapping[str, float] | None = None,
    points: int = 15,
    **parameters: float,
) -> DirectionField:
    """direction_field(system, "x", "v", limits=((-2, 2), (-3, 3))) -> layer.

    Arrows of one length along the flow at time t, `points` rows of them.
    """
    return layer(DirectionField, system, x, y, axes, limits, mode, t, at, parameters, points=points)


@unambiguous
def nullclines(
    system: System,
    x: str | None = None,
    y: str | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    mode: str | None = None,
    t: float = 0.0,
    points: int = GRID,
    **parameters: float,
) -> Nullclines:
    """nullclines(system, "x", "v", limits=…) -> layer.

    Where dx/dt = 0 dotted, dv/dt = 0 dash-dotted, from a points × points grid.
    """
    return layer(Nullclines, system, x, y, axes, limits, mode, t, None, parameters, points=points)


@unambiguous
def equilibria(
    system: System,
    x: str | None = None,
    y: str | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    mode: str | None = None,
    t: float = 0.0,
    **parameters: float,
) -> Equilibria:
    """equilibria(system, "x", "v", limits=…).found -> [(x, v, mode, "saddle"), …].

    Drawn with their type in words; see find_equilibria.
    """
    return layer(Equilibria, system, x, y, axes, limits, mode, t, None, parameters)


@unambiguous
def guard_lines(
    system: System,
    x: str | None = None,
    y: str | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    mode: str | None = None,
    t: float = 0.0,
    at: Mapping[str, float] | None = None,
    points: int = GRID,
    **parameters: float,
) -> GuardLines:
    """guard_lines(system, "x", "v", limits=…) -> layer.

    Where the guards of the modes are zero, dashed and named.
    """
    return layer(GuardLines, system, x, y, axes, limits, mode, t, at, parameters, points=points)


def trajectories(
    runs: Run | Runs,
    x: str | None = None,
    y: str | None = None,
    *,
    axes: Axes | None = None,
    limits: Limits | None = None,
    bold: bool = False,
) -> Trajectories:
    """trajectories(runs, "x", "v") -> layer.

    A Run or the Runs of simulate_many, coloured by mode, jumps dashed, starts marked.
    """
    plane = Plane(runs.system, x, y)
    if axes is None and limits is None:
        limits = _around([runs], plane)
    return Trajectories(stage(plane, axes, limits), plane, runs, bold=bold)


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
    **parameters: float,
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
    p = run.p if run is not None and not parameters else system.values(parameters)
    plane = Plane(system, x, y, mode=mode, t=t, at=at, p=p)
    if run is not None:
        plane.hold(run.start)
    many = _starts((24 if run is None else 0) if starts is None else starts, plane)
    beside = Beside(plane, run, horizon, options)
    if beside.t_end is None and (many or limits is None):
        raise ModelError(
            "phase_portrait needs horizon=, the end time of the trajectories (or a run)"
        )
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
        if run is not None and run.options:
            like = {key: value for key, value in run.options.items() if key not in _OWN}
        elif run is not None:  # made by hand
            like = {"t0": float(run.t[0]), "t_end": float(run.t[-1])}
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
        for part in self.layers:
            if isinstance(part, Equilibria):
                part.name()
        self._name_guards()
        if self._noted is not None:
            width, height = self.figure.get_size_inches()
            reach = width * (1 - self.axes.get_position().x0)
            said = (on_lines(self.axes, note, 8.5, reach) for note in self.notes)
            self._noted.set_text("\n".join(said) if height > 2.6 else "")  # else height is dear

    def _name_guards(self) -> None:
        for part in self.layers:
            if isinstance(part, GuardLines):
                part.name(self.layers)

    @property
    def system(self) -> System:
        return self.plane.system

    def _build(self, kinds: set[type[Layer]], runs: Runs | None, run: Run | None) -> list[Layer]:
        plane, axes, limits = self.plane, self.axes, self._limits()
        field, lines, points, guards = (
            kind in kinds for kind in (DirectionField, Nullclines, Equilibria, GuardLines)
        )
        self.notes: list[str] = []
        self._noted: Text | None = None
        timed, flat = (
            plane.depends_on_time(limits, (self.beside.t_end or plane.t + 10.0) - plane.t),
            all(map(plane.is_plane, plane.modes)),
        )
        shown = (["arrows"] if field else []) + (["lines"] if lines or guards else [])
        without = "no nullclines or equilibria" if lines or points else ""
        if timed and (field or without):
            self.notes.append(
                "flow depends on time: "
                + ", ".join(
                    filter(None, [f"arrows at t = {said(plane.t)}" if field else "", without])
                )
            )
        elif not flat and (field or without):
            self.notes.append(
                "; ".join(
                    filter(
                        None,
                        [
                            "arrows hold for the other states at their start values"
                            if field
                            else "",
                            without,
                        ],
                    )
                )
            )
        if self.system.held and shown:
            held = " and ".join(self.system.held)
            self.notes.append(f"{' and '.join(shown)} for {held} as at the start")
        if plane.chosen is not None and len(self.system.modes) > 1 and shown:
            self.notes.append(f"{' and '.join(shown)} of mode “{plane.chosen}”")
        layers: list[Layer] = []
        if field:
            layers.append(DirectionField(axes, plane))
        if lines and flat and not timed:
            layers.append(Nullclines(axes, plane))
        if guards and any(
            tr.guard is not None
            for mode in plane.modes
            for tr in (self.system.transitions[i] for i in self.system.leaving[mode])
        ):
            layers.append(made := GuardLines(axes, plane))
            if made.omitted:
                self.notes.append(
                    f"guards that change with time are not drawn: {', '.join(made.omitted)}"
                )
        if runs is not None:
            layers.append(Trajectories(axes, plane, runs))
        if run is not None:
            layers.append(Trajectories(axes, plane, run, bold=True))
        if flat and not timed and Separatrices in kinds:
            layers.append(Separatrices(axes, plane))
        if points and flat and not timed:
            layers.append(Equilibria(axes, plane))
        return layers

    def _write(self) -> None:
        entries = self._entries()
        self._named = list(entries)
        pairs = [(artist, text) for text, artist in entries.items()]
        head(self.axes, self.title, pairs, aside=True)
        with style():
            if self.notes and self._noted is None:
                self._noted = self.axes.annotate(
                    "\n".join(self.notes),
                    (0.0, 0.0),
                    xycoords="axes fraction",
                    xytext=(0, -34),
                    textcoords="offset points",
                    fontsize=8.5,
                    color=GREY,
                    va="top",
                )

    def _entries(self) -> dict[str, Artist]:
        """Name -> sample of what the layers show; of a name that two of them have, the last."""
        return {text: artist for part in self.layers for artist, text in part.legend()}

    @property
    def equilibria(self) -> list[tuple[float, float, str, str]]:
        """[(x, y, mode, type in words), …] as drawn."""
        return [
            found for part in self.layers if isinstance(part, Equilibria) for found in part.found
        ]

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
        first = one if one is not None else many
        if list(first.system.modes) != list(self.system.modes) or list(first.system.units) != list(
            self.system.units
        ):
            raise ModelError(
                f"this picture was made for {self.system.name!r}, update got a run of "
                f"{first.system.name!r}"
            )
        before, now = self.beside.key, one if one is not None else many[0]
        self.plane.follow(now)
        self.beside.follow(now)
        bold = [
            part
            for part in self.layers
            if isinstance(part, Trajectories) and isinstance(part.runs, Run)
        ]
        thin = [
            part
            for part in self.layers
            if isinstance(part, Trajectories) and isinstance(part.runs, Runs)
        ]
        self.relimited = False
        if not self._fixed and bold and one is not None:
            moved = [
                window.fit(*extent(one[name]))
                for window, name in zip(self._windows, (self.plane.x, self.plane.y), strict=True)
            ]
            self.relimited = any(moved)
        if many is None and thin and self.starts is not None and self.beside.key != before:
            many = self.beside.runs(self.starts)
        for part, new in [(part, one) for part in bold] + [(part, many) for part in thin]:
            if new is not None:
                part.set(new)
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
        table = dict(
            zip(
                starts,
                map(
                    np.array,
                    np.broadcast_arrays(
                        *(np.atleast_1d(np.asarray(v, dtype=float)) for v in starts.values())
                    ),
                ),
                strict=True,
            )
        )
    else:
        points = np.atleast_2d(np.asarray(starts, dtype=float))
        if points.ndim != 2 or points.shape[1] != 2:
            raise ModelError(
                "starts must be a number, a mapping of arrays or an array of shape (n, 2), "
                f"not of shape {points.shape}"
            )
        table = {plane.x: points[:, 0], plane.y: points[:, 1]}
    return table


def _spread(count: int, limits: Limits, plane: Plane) -> dict[str, np.ndarray] | None:
    """Two thirds of the starts along the edge of the picture, one third half as far out."""
    outer = count - count // 3
    along = (
        np.concatenate(
            [
                np.arange(outer) / outer + 0.5 / outer,
                (np.arange(count // 3) + 0.25) / max(count // 3, 1),
            ]
        )
        * 4
    )
    size = np.concatenate([np.full(outer, 0.97), np.full(count // 3, 0.5)])
    side, along = along.astype(int) % 4, 2 * (along % 1) - 1
    a = size * np.choose(side, [along, 1, -along, -1])
    b = size * np.choose(side, [-1, along, 1, -along])
    (x0, x1), (y0, y1) = limits
    x, y = (x0 + x1) / 2 + a * (x1 - x0) / 2, (y0 + y1) / 2 + b * (y1 - y0) / 2
    fits = (
        plane.governing(x, y) >= 0
    )  # elsewhere, as under the floor, `simulate` would refuse to start
    return {plane.x: x[fits], plane.y: y[fits]} if fits.any() else None


def _around(runs: Sequence[Run | Runs], plane: Plane) -> Limits:
    """Limits with a margin of 8 % around all points of the runs."""
    pairs = [_proper(*extent(*(r[name] for r in runs))) for name in (plane.x, plane.y)]
    x, y = ((low - 0.08 * (high - low), high + 0.08 * (high - low)) for low, high in pairs)
    return x, y
