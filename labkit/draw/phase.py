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
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from ..model import OPTIONS, ModelError, System, listed
from ..run import Run
from ..runs import Runs
from .figure import FAINT, head, style
from .layers import (
    DirectionField,
    Equilibria,
    GuardLines,
    Layer,
    Nullclines,
    Trajectories,
    layer,
    stage,
)
from .plane import GRID, Limits, Plane
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
    guards: bool = True,
    title: str | None = None,
    width: float = 8.0,
    height: float = 5.0,
    **parameters: float,
) -> PhasePortrait:
    """phase_portrait(system, "x", "v", starts=40, horizon=10.0) -> PhasePortrait.

    In the plane of two states (default: the first two).

    system      a System, or a Run: phase_portrait(run) is phase_portrait(run.system, run=run)
    starts      how many trajectories (spread over the picture; 0: none), or
                {"x": array, "v": array}, or an array (n, 2);
                left out: 24, but none when there is a run
    run         one Run, drawn bold; its end time is the default horizon, its parameters are the
                default ones
    limits      ((x low, x high), (y low, y high)); left out: from the run or the starts, and then
                update() may widen them
    mode, t, at what the field shows, see Plane: the mode (default: the one that holds at each
                point), the instant, the other states and held variables
    parameters  of the system; options of simulate_many (method=, rtol=, points=, …) may stand among
                them
    Nullclines and equilibria are left out, and view.notes says so, when the flow depends on time or
    on further states. Raises ModelError for unknown names, or when no horizon is known.
    """
    if isinstance(system, Run):
        system, run = system.system, system if run is None else run
    starts = (24 if run is None else 0) if starts is None else starts
    return PhasePortrait(
        system,
        x,
        y,
        starts,
        run,
        horizon,
        axes,
        limits,
        mode,
        t,
        at,
        (direction_field, nullclines, equilibria, guards),
        title,
        width,
        height,
        parameters,
    )


class PhasePortrait(View):
    """The picture made by `phase_portrait`: view.layers, view.axes, view.notes, view.equilibria.

    See View for the rest.
    """

    def __init__(
        self,
        system: System,
        x: str | None,
        y: str | None,
        starts: Starts,
        run: Run | None,
        horizon: float | None,
        axes: Axes | None,
        limits: Limits | None,
        mode: str | None,
        t: float,
        at: Mapping[str, float] | None,
        wanted: Sequence[bool],
        title: str | None,
        width: float,
        height: float,
        parameters: Mapping[str, float],
    ):
        from ..solve import simulate, simulate_many

        self._simulate_many = simulate_many
        self.options = {key: value for key, value in parameters.items() if key in OPTIONS}
        changed = {key: value for key, value in parameters.items() if key not in OPTIONS}
        self.system = system
        p = run.p if run is not None and not changed else system.values(changed)
        self.plane = plane = Plane(system, x, y, mode=mode, t=t, at=at, p=p)
        if run is not None:
            plane.hold(run.start)
        many = self._many(starts)
        self.horizon = (
            horizon
            if horizon is not None
            else float(run.t[-1] - run.t[0])
            if run is not None
            else None
        )
        if self.horizon is None and (many or limits is None):
            raise ModelError(
                "phase_portrait needs horizon=, the end time of the trajectories (or a run)"
            )
        self.starts: dict[str, np.ndarray] | None = None if isinstance(many, int) else many
        runs = self._trajectories() if self.starts else None
        self._fixed = limits is not None
        if limits is None:
            shown = [r for r in (run, runs) if r is not None]
            limits = _around(
                shown
                or [simulate(system, t + self.horizon, t0=t, **self.options, **plane.p._asdict())],
                plane,
            )
        self.axes = stage(plane, axes, limits, width, height)
        self.figure = self.axes.get_figure()
        self.shows = [Shows(self.axes, plane.x, (plane.y,))]
        self._windows = [
            Window(self.axes, which, *pair, margin=0)
            for which, pair in zip("xy", limits, strict=True)
        ]
        if isinstance(many, int) and many:
            self.starts = self._spread(many, limits)
            runs = self._trajectories() if self.starts else None
        self.layers = self._build(wanted, runs, run)
        self.artists = [
            artist
            for part in sorted(self.layers, key=lambda part: part.artists[0].get_zorder())
            for artist in part.artists
        ]
        self._seen = self._state()
        self._write(title)

    def _many(self, starts: Starts) -> int | dict[str, np.ndarray]:
        if isinstance(starts, int | np.integer):
            if not 0 <= starts <= 2000:
                raise ModelError(f"starts = {starts}: give a number of trajectories from 0 to 2000")
            return int(starts)
        if isinstance(starts, Mapping):
            if missing := [name for name in (self.plane.x, self.plane.y) if name not in starts]:
                raise ModelError(
                    f"starts gives no values for {listed(missing)}; for example "
                    f"starts={{'{self.plane.x}': [0, 1], '{self.plane.y}': [0, 0]}}"
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
            table = {self.plane.x: points[:, 0], self.plane.y: points[:, 1]}
        return table

    def _spread(self, count: int, limits: Limits) -> dict[str, np.ndarray] | None:
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
            self.plane.governing(x, y) >= 0
        )  # elsewhere, as under the floor, `simulate` would refuse to start
        return {self.plane.x: x[fits], self.plane.y: y[fits]} if fits.any() else None

    def _trajectories(self) -> Runs:
        assert self.starts is not None and self.horizon is not None
        mode = (
            {}
            if callable(self.system.mode) or self.plane.chosen in (None, self.system.mode)
            else {"mode": self.plane.chosen}
        )
        options = {"points": 300, **mode, **self.options}
        return self._simulate_many(
            self.system,
            self.plane.t + self.horizon,
            t0=self.plane.t,
            start={**{name: self.plane.values[name] for name in self.system.held}, **self.starts},
            **options,
            **self.plane.p._asdict(),
        )

    def _build(self, wanted: Sequence[bool], runs: Runs | None, run: Run | None) -> list[Layer]:
        plane, axes, limits = self.plane, self.axes, self._limits()
        field, lines, points, guards = wanted
        self.notes: list[str] = []
        timed, flat = (
            plane.depends_on_time(limits, self.horizon or 10.0),
            all(map(plane.is_plane, plane.modes)),
        )
        shown = (["arrows"] if field else []) + (["lines"] if lines or guards else [])
        without = "no nullclines or equilibria" if lines or points else ""
        if timed and (field or without):
            self.notes.append(
                "flow depends on time: "
                + ", ".join(filter(None, [f"arrows at t = {plane.t:g}" if field else "", without]))
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
        if points and flat and not timed:
            layers.append(Equilibria(axes, plane))
        return layers

    def _write(self, title: str | None) -> None:
        entries = list(
            {
                text: (artist, text) for part in self.layers for artist, text in part.legend()
            }.values()
        )
        narrow = self.axes.get_position().width * self.figure.get_figwidth() < 4.5
        head(self.axes, self.system.name if title is None else title, entries if narrow else [])
        with style():
            if self.notes:
                self.axes.annotate(
                    "\n".join(self.notes),
                    (0.0, 0.0),
                    xycoords="axes fraction",
                    xytext=(0, -34),
                    textcoords="offset points",
                    fontsize=8.5,
                    color=FAINT,
                    va="top",
                )
            if entries and not narrow:  # beside the picture: never over a curve
                self.axes.legend(
                    *zip(*entries, strict=True), loc="upper left", bbox_to_anchor=(1.0, 1.0)
                )

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
        before, now = self.plane.key, one if one is not None else many[0]
        self.plane.p = now.p
        self.plane.hold(now.start)
        changed = self.plane.key != before
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
        if many is None and thin and changed and self.starts is not None:
            many = self._trajectories()
        for part, new in [(part, one) for part in bold] + [(part, many) for part in thin]:
            if new is not None:
                part.set(new)
        if self._state() != self._seen:
            for part in self.layers:
                if not isinstance(part, Trajectories):
                    part.redo()
        self._seen = self._state()


def _around(runs: Sequence[Run | Runs], plane: Plane) -> Limits:
    """Limits with a margin of 8 % around all points of the runs."""
    pairs = [_proper(*extent(*(r[name] for r in runs))) for name in (plane.x, plane.y)]
    x, y = ((low - 0.08 * (high - low), high + 0.08 * (high - low)) for low, high in pairs)
    return x, y
