"""Curves over time: states and outputs of a run, with its events, jumps and modes.

time_plot(run, "x", "v")                       two panels
time_plot(run, ("x", "y"), "F")                x and y share a panel
time_plot({"RK4": a, "DOP853": b}, "x")        several runs, with labels
view = time_plot(run, "x"); view.update(another_run)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from ..arguments import unambiguous
from ..model import ModelError, System, listed
from ..run import Run
from ..runs import Runs
from .figure import (
    BANDS,
    COLORS,
    DASHES,
    FAINT,
    INK,
    VEIL,
    Figure,
    figure,
    head,
    label,
    mode_colors,
    style,
    symbol,
    tint,
)
from .private import closed, reshape
from .ticks import over_time
from .view import Shows, View, Window, extent
from .words import EVENTS, MODE

__all__ = ["TimePlot", "time_plot"]

Data = Run | Runs | Sequence[Run | Runs] | Mapping[str, Run | Runs]
# Up to so many events have a line over the whole height, modes a tinted background; more: a strip
FEW = 60


@unambiguous
def time_plot(
    run: Data,
    *names: str | tuple[str, ...],
    axes: Axes | Sequence[Axes] | None = None,
    title: str | None = None,
    events: bool = True,
    modes: bool = True,
    legend: bool = True,
    width: float = 9.0,
    height: float | None = None,
) -> TimePlot:
    """time_plot(run, "x", ("V", "F")) -> TimePlot: a panel for each name, a tuple shares one.

    No name: every state and held variable.
    run      a Run, the Runs of simulate_many, a list of them, or label -> run; several are
             overlaid, a colour each
    axes     draw into these axes (as many as panels) instead of a new figure
    events   thin lines at the events of a single run (ticks at the top when there are many); jumps
             of a curve are dashed
    modes    background coloured by mode, for a single run of a system with several modes
    Curves pause where the mode does not have the state. Raises ModelError for an unknown name or
    runs of different systems.
    """
    return TimePlot(run, names, axes, title, events, modes, legend, width, height)


class TimePlot(View):
    """The picture made by `time_plot`; view.axes are its panels.

    See View for update, artists and relimited.
    """

    def __init__(
        self,
        run: Data,
        names: Sequence[str | tuple[str, ...]],
        axes: Axes | Sequence[Axes] | None,
        title: str | None,
        events: bool,
        modes: bool,
        legend: bool,
        width: float,
        height: float | None,
    ):
        labels, runs = _listed(run)
        self.system: System = runs[0].system
        self.groups = [
            (group,) if isinstance(group, str) else tuple(group)
            for group in names or list(self.system.units)
        ]
        for name in (name for group in self.groups for name in group):
            if name not in self.system.units and name not in self.system.outputs:
                raise ModelError(
                    f"{name!r} is neither a state nor an output of {self.system.name!r}; there "
                    f"are {listed([*self.system.units, *self.system.outputs])}"
                )
        self.figure, self.axes = _panels(axes, len(self.groups), width, height)
        self.shows = [
            Shows(ax, "t", group) for ax, group in zip(self.axes, self.groups, strict=True)
        ]
        alone = len(runs) == 1
        self._modes = (
            [_Modes(ax, self.system) for ax in self.axes]
            if modes and alone and len(self.system.modes) > 1 and isinstance(runs[0], Run)
            else []
        )
        self._events = (
            [_Events(ax) for ax in self.axes]
            if events and alone and isinstance(runs[0], Run)
            else []
        )
        self._curves = [
            [
                [
                    _Curve(ax, *_look(i, k, len(runs), len(group)), many=isinstance(r, Runs))
                    for k, _ in enumerate(group)
                ]
                for i, r in enumerate(runs)
            ]
            for ax, group in zip(self.axes, self.groups, strict=True)
        ]
        self.artists: list[Artist] = [
            a for part in (*self._modes, *self._events) for a in part.artists
        ]
        self.artists += [
            a
            for panel in self._curves
            for curves in panel
            for curve in curves
            for a in curve.artists
        ]
        span, *ranges = self._set_data(runs)
        self._x = [
            Window(ax, "x", *span, margin=0, room=0)
            for k, ax in enumerate(self.axes)
            if not any(ax.get_shared_x_axes().joined(ax, b) for b in self.axes[:k])
        ]
        self._y = [Window(ax, "y", *between) for ax, between in zip(self.axes, ranges, strict=True)]
        self._write(title, labels, legend)

    def _set_data(self, runs: Sequence[Run | Runs]) -> list[tuple[float, float]]:
        """Gives every artist its data; returns the extent of t and of each panel."""
        for part in (*self._modes, *self._events):
            part.set(runs[0])
        times = [_joined(run.t) if isinstance(run, Runs) else run.t for run in runs]
        ranges = []
        for group, panel in zip(self.groups, self._curves, strict=True):
            found = []
            for run, t, curves in zip(runs, times, panel, strict=True):
                for name, curve in zip(group, curves, strict=True):
                    y = _joined(run[name]) if isinstance(run, Runs) else run[name]
                    found.append(y)
                    curve.set(t, y)
            ranges.append(extent(*found))
        return [extent(*times), *ranges]

    def _write(self, title: str | None, labels: Sequence[str], legend: bool) -> None:
        top = self.axes[0]
        self._few = bool(self._modes) and self._modes[0].few
        for ax, group, panel in zip(self.axes, self.groups, self._curves, strict=True):
            entries: list[tuple[Artist, str]] = []
            if len(group) > 1:
                entries += [
                    (_sample(curve.line, **{} if len(panel) == 1 else {"color": INK}), symbol(name))
                    for curve, name in zip(panel[0], group, strict=True)
                ]
            if len(panel) > 1 and ax is top:
                entries += [
                    (_sample(curves[0].line, **{} if len(group) == 1 else {"linestyle": "-"}), text)
                    for curves, text in zip(panel, labels, strict=True)
                ]
            if self._modes and ax is top:
                entries += [
                    (
                        Patch(facecolor=color, edgecolor=FAINT, linewidth=0.5, gid=MODE),
                        mode,
                    )
                    for mode, color in zip(self.system.modes, self._modes[0].tints, strict=True)
                ]
            head(
                ax,
                (self.system.name if title is None else title) if ax is top else "",
                entries if legend else [],
            )
            with style():
                ax.set_ylabel(label(self.system, *group))
                if not any(
                    ax.get_shared_x_axes().joined(ax, other)
                    for other in self.axes[self.axes.index(ax) + 1 :]
                ):
                    over_time(ax, symbol("t"), self.system.time)

    def update(self, run: Data) -> None:
        """view.update(run): shows another run (as many runs as at first) of the same system.

        Raises ModelError otherwise.
        """
        _, runs = _listed(run)
        if len(runs) != len(self._curves[0]):
            raise ModelError(
                f"this picture shows {len(self._curves[0])} run(s), update got {len(runs)}"
            )
        if list(runs[0].system.units) != list(self.system.units) or list(
            runs[0].system.modes
        ) != list(self.system.modes):
            raise ModelError(
                f"this picture was made for {self.system.name!r}, update got a run of "
                f"{runs[0].system.name!r}"
            )
        span, *ranges = self._set_data(runs)
        moved = [window.fit(*span) for window in self._x] + [
            window.fit(*between) for window, between in zip(self._y, ranges, strict=True)
        ]
        self.relimited = self._recolor() or any(moved)

    def _recolor(self) -> bool:
        """The legend has the colours that the modes have: as bands, or in a strip."""
        headed = getattr(self.axes[0], "headed", None)
        samples = [artist for artist, _ in headed[1] if artist.get_gid() == MODE] if headed else []
        if not samples or self._few == self._modes[0].few:
            return False
        self._few = self._modes[0].few
        for sample, color in zip(samples, self._modes[0].tints, strict=True):
            sample.set_facecolor(color)
        head(self.axes[0], *headed)
        return True


def _listed(run: Data) -> tuple[list[str], list[Run | Runs]]:
    if isinstance(run, Run | Runs):
        return [""], [run]
    labels, runs = (
        (list(map(str, run)), list(run.values()))
        if isinstance(run, Mapping)
        else ([f"run {i + 1}" for i in range(len(run))], list(run))
    )
    for one in runs:
        if not isinstance(one, Run | Runs):
            raise ModelError(
                f"a picture takes runs (from simulate or simulate_many), not {type(one).__name__} "
                f"{one!r:.60}"
            )
    if not runs:
        raise ModelError("there is no run to draw: the list is empty")
    return labels, runs


def _panels(
    axes: Axes | Sequence[Axes] | None, count: int, width: float, height: float | None
) -> tuple[Figure, list[Axes]]:
    if axes is None:
        fig = figure(
            count,
            1,
            width=width,
            height=height or 1.2 + (2.6 if count == 1 else 1.9) * count,
            sharex=True,
        )
        return fig, list(fig.axes)
    panels = [axes] if isinstance(axes, Axes) else list(axes)
    if len(panels) != count:
        raise ModelError(f"time_plot has {count} panel(s) and got {len(panels)} axes")
    return panels[0].get_figure(), panels


def _look(i: int, k: int, runs: int, names: int) -> tuple[str, object]:
    """Colour and dash of curve k of run i: one run, a colour for each name.

    Several runs, a colour for each run, a dash for each name.
    """
    if runs == 1:
        return COLORS[k % len(COLORS)], DASHES[k] if names <= len(DASHES) else "-"
    return COLORS[i % len(COLORS)], DASHES[k % len(DASHES)] if names > 1 else DASHES[
        i
    ] if runs <= len(DASHES) else "-"


def _sample(line: Line2D, **changed: object) -> Line2D:
    """A legend's own copy of a line: the line itself is drawn by the panel at its own time."""
    copy = Line2D([], [])
    copy.update_from(line)
    copy.set(**changed)
    return copy


def _joined(rows: np.ndarray) -> np.ndarray:
    """(lanes, m) -> one row with NaN between the lanes: the pen goes up."""
    return np.column_stack([rows, np.full(len(rows), np.nan)]).ravel()


class _Curve:
    """A curve that is interrupted at its jumps, and the dashed jumps."""

    def __init__(self, ax: Axes, color: str, dash: object, many: bool = False):
        width, alpha = (0.8, 0.6) if many else (1.6, 1.0)
        self.line = Line2D(
            [],
            [],
            color=color,
            linestyle=dash,
            linewidth=width,
            alpha=alpha,
            zorder=3,
            dash_capstyle="butt",
        )  # type: ignore[arg-type]
        self.jumps = Line2D(
            [],
            [],
            color=color,
            linestyle=(0, (3, 2)),
            linewidth=0.6 * width,
            alpha=alpha,
            zorder=2.9,
        )
        self.artists = [self.jumps, self.line]
        for artist in self.artists:
            ax.add_line(artist)

    def set(self, t: np.ndarray, y: np.ndarray) -> None:
        self.line.set_data(*_broken(t, y, at := _jumps(t, y)))
        self.jumps.set_data(_segments(t[at], t[at + 1]), _segments(y[at], y[at + 1]))


def _jumps(t: np.ndarray, *values: np.ndarray) -> np.ndarray:
    """Positions i where samples i, i + 1 share an instant and a value differs visibly (1e-6)."""
    here = np.flatnonzero(t[1:] == t[:-1])
    if not len(here):
        return here
    moved = np.zeros(len(here), dtype=bool)
    for y in values:
        low, high = extent(y)
        moved |= np.abs(y[here + 1] - y[here]) > 1e-6 * (
            high - low
        )  # False for NaN: a state that begins or ends does not jump
    return here[moved]


def _broken(t: np.ndarray, y: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (np.insert(t, at + 1, np.nan), np.insert(y, at + 1, np.nan)) if len(at) else (t, y)


def _segments(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a, b -> a0, b0, NaN, a1, b1, NaN, ….

    Many separate strokes in one line, which draws far faster than many lines.
    """
    return np.column_stack([a, b, np.full(len(a), np.nan)]).ravel()


class _Events:
    """The instants of the events: faint lines over the whole height.

    When they are many, ticks at the top.
    """

    def __init__(self, ax: Axes):
        self.line = Line2D(
            [],
            [],
            color=FAINT,
            linewidth=0.7,
            alpha=0.75,
            zorder=1.5,
            gid=EVENTS,
            transform=ax.get_xaxis_transform(),
        )
        self.artists = [self.line]
        ax.add_artist(self.line)

    def set(self, run: Run) -> None:
        t = np.array([event.t for event in run.events])
        bottom = 0.0 if len(t) <= FEW else 0.965
        self.line.set_data(_segments(t, t), _segments(np.full(len(t), bottom), np.ones(len(t))))


class _Modes:
    """The background in the colour of the mode, one artist a mode.

    When modes change often, a strip at the bottom; when so often that one could not tell them
    apart, the strip shows, from place to place, the share of the time that each mode takes.
    """

    def __init__(self, ax: Axes, system: System):
        self.colors = mode_colors(system)
        self.patches = [
            PathPatch(
                Path(np.zeros((0, 2))), linewidth=0, zorder=0.4, transform=ax.get_xaxis_transform()
            )
            for _ in self.colors
        ]
        for patch in self.patches:
            ax.add_artist(patch)
        self.words = ax.annotate(
            "",
            (0.0, 0.0),
            xycoords="axes fraction",
            xytext=(3, 2),
            textcoords="offset points",
            fontsize=8.5,
            color=INK,
            zorder=6,
            bbox=VEIL,
        )
        self.words.set_in_layout(False)
        self.artists = [*self.patches, self.words]

    @property
    def tints(self) -> list[tuple[float, float, float]]:
        """The colours as they look, for a legend."""
        strengths = BANDS if self.few else (STRIP,)
        colors = enumerate(self.colors.values())
        return [tint(color, strengths[k % len(strengths)]) for k, color in colors]

    def set(self, run: Run) -> None:
        ends = np.flatnonzero(np.diff(run.mode_index)) + 1
        first = np.append(0, ends)
        left, right = run.t[first], np.append(run.t[first[1:]], run.t[-1])
        index = run.mode_index[first]
        self.few, many = len(index) <= FEW, len(index) > MANY
        height, low = (1.0 if self.few else SHARED if many else 0.035), np.zeros(SLOTS + 1)
        for i, (patch, color) in enumerate(zip(self.patches, self.colors.values(), strict=True)):
            mine = index == i
            if many:
                shares = _shares(left[mine], right[mine], run.t[0], run.t[-1])
                path, low = _stack(run.t[0], run.t[-1], low, low + height * shares)
            else:
                path = _boxes(left[mine], right[mine], height)
            reshape(patch, path)
            patch.set_facecolor(
                (*to_rgb(color), BANDS[i % len(BANDS)] if self.few else STRIP)
            )  # see-through: a panel may draw it over the grid
            patch.set_antialiased(False)  # sharp edges without seams
        words = "share of the time" if many else ""
        if words != self.words.get_text():
            self.words.set_text(words)
            self.words.set_position((3, 2))
            self.words.xy = (0.0, SHARED)


# More stretches of modes than MANY are finer than a pixel or two: instead the share of each mode at
# SLOTS + 1 places, over a window of WIDE of the whole time
MANY, SLOTS, WIDE, SHARED, STRIP = 300, 150, 0.04, 0.07, 0.8


def _shares(left: np.ndarray, right: np.ndarray, begin: float, end: float) -> np.ndarray:
    """The part of the window around each place that the stretches left … right cover."""
    places = np.linspace(begin, end, SLOTS + 1)
    if not len(left):
        return np.zeros(SLOTS + 1)
    reach = 0.5 * WIDE * (end - begin)
    window = np.clip([places - reach, places + reach], begin, end)
    corners = np.column_stack([left, right]).ravel()
    so_far = np.cumsum(np.column_stack([np.zeros(len(left)), right - left]).ravel())
    return np.diff(np.interp(window, corners, so_far), axis=0)[0] / np.diff(window, axis=0)[0]


def _stack(begin: float, end: float, low: np.ndarray, high: np.ndarray) -> tuple[Path, np.ndarray]:
    places = np.linspace(begin, end, SLOTS + 1)
    there, back = (np.column_stack([places, level]) for level in (low, high))
    return closed(np.concatenate([there, back[::-1]])), high


def _boxes(left: np.ndarray, right: np.ndarray, top: float) -> Path:
    """One path of many rectangles from 0 to `top`."""
    corners = np.empty((len(left), 5, 2))
    corners[:, [0, 1, 4], 0], corners[:, [2, 3], 0] = left[:, None], right[:, None]
    corners[:, [0, 3, 4], 1], corners[:, [1, 2], 1] = 0.0, top
    codes = np.tile(
        np.array(
            [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], dtype=np.uint8
        ),
        len(left),
    )
    return Path(corners.reshape(-1, 2), codes)
