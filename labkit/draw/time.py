"""Curves over time: states and outputs of a run, with its events, jumps and modes.

time_plot(run, "x", "v")                       two panels
time_plot(run, ("x", "y"), "F")                x and y share a panel
time_plot({"RK4": a, "DOP853": b}, "x")        several runs, with labels
view = time_plot(run, "x"); view.update(another_run)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path

from ..arguments import unambiguous
from ..model import ModelError, System, check_names
from ..run import Run
from ..runs import Runs
from .figure import (
    BANDS,
    COLORS,
    DASHES,
    FAINT,
    INK,
    area,
    figure,
    head,
    label,
    mode_colors,
    stroke,
    style,
    symbol,
    tint,
    word,
)
from .private import closed, reshape
from .ticks import over_time
from .view import Shows, View, Window, extent, same_system
from .words import EVENTS, MODE

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
    Curves pause where the mode does not have the state. Raises ModelError for a name that one of
    the runs does not have.
    """
    labels, runs = _listed(run)
    system = runs[0].system
    groups = [(group,) if isinstance(group, str) else tuple(group) for group in names]
    groups = groups or [(name,) for name in system.units]
    known = [*system.units, *system.outputs]
    said = f"{{}} is neither a state nor an output of {system.name!r}"
    for name in (name for group in groups for name in group):
        check_names([name], known, said)
    if axes is None:
        count = len(groups)
        height = height or 1.2 + (2.6 if count == 1 else 1.9) * count
        axes = figure(count, 1, width=width, height=height, sharex=True).axes
    panels = [axes] if isinstance(axes, Axes) else list(axes)
    if len(panels) != len(groups):
        raise ModelError(f"time_plot has {len(groups)} panel(s) and got {len(panels)} axes")
    shows = [Shows(ax, "t", group) for ax, group in zip(panels, groups, strict=True)]
    view = TimePlot(runs, shows, events, modes)
    view._write(system.name if title is None else title, labels, legend)
    return view


class TimePlot(View):
    """The picture made by `time_plot`; view.axes are its panels.

    See View for update, artists and relimited.
    """

    def __init__(self, runs: list[Run | Runs], shows: list[Shows], events: bool, modes: bool):
        system = self.system = runs[0].system
        self.shows, self.axes = shows, [show.axes for show in shows]
        self.figure = self.axes[0].get_figure()
        single = len(runs) == 1 and isinstance(runs[0], Run)
        several = single and modes and len(system.modes) > 1
        self._modes = [_Modes(ax, system) for ax in self.axes] if several else []
        self._events = [_Events(ax) for ax in self.axes] if single and events else []
        self._curves = [
            [
                [_Curve(show.axes, one, *look) for look in _looks(i, len(runs), len(show.names))]
                for i, one in enumerate(runs)
            ]
            for show in shows
        ]
        lines = [curve for panel in self._curves for curves in panel for curve in curves]
        parts = (*self._modes, *self._events, *lines)
        self.artists: list[Artist] = [artist for part in parts for artist in part.artists]
        span, *ranges = self._set_data(runs)
        self._windows = [
            Window(ax, "x", *span, margin=0, room=0)
            for k, ax in enumerate(self.axes)
            if not _shared(ax, self.axes[:k])
        ]
        self._spans = len(self._windows)
        self._windows += [
            Window(ax, "y", *between) for ax, between in zip(self.axes, ranges, strict=True)
        ]

    def _set_data(self, runs: Sequence[Run | Runs]) -> list[tuple[float, float]]:
        """Gives every artist its data; returns the extent of t and of each panel."""
        for part in (*self._modes, *self._events):
            part.set(runs[0])
        times = [_joined(run.t) for run in runs]
        ranges = []
        for show, panel in zip(self.shows, self._curves, strict=True):
            found = []
            for run, t, curves in zip(runs, times, panel, strict=True):
                for name, curve in zip(show.names, curves, strict=True):
                    found.append(_joined(run[name]))
                    curve.set(t, found[-1])
            ranges.append(extent(*found))
        return [extent(*times), *ranges]

    def _write(self, title: str, labels: Sequence[str], legend: bool) -> None:
        self._few = bool(self._modes) and self._modes[0].few
        for k, (show, panel) in enumerate(zip(self.shows, self._curves, strict=True)):
            entries: list[tuple[Artist, str]] = []
            if len(show.names) > 1:
                look = {} if len(panel) == 1 else {"color": INK}
                entries += [
                    (sample(curve.line, **look), symbol(name))
                    for curve, name in zip(panel[0], show.names, strict=True)
                ]
            if len(panel) > 1 and k == 0:
                look = {} if len(show.names) == 1 else {"linestyle": "-"}
                entries += [
                    (sample(curves[0].line, **look), text)
                    for curves, text in zip(panel, labels, strict=True)
                ]
            if self._modes and k == 0:
                look = {"edgecolor": FAINT, "linewidth": 0.5, "gid": MODE}
                entries += [
                    (Patch(facecolor=color, **look), mode)
                    for mode, color in zip(self.system.modes, self._modes[0].tints, strict=True)
                ]
            head(show.axes, "" if k else title, entries if legend else [])
            with style():
                show.axes.set_ylabel(label(self.system, *show.names))
                if not _shared(show.axes, self.axes[k + 1 :]):
                    over_time(show.axes, symbol("t"), self.system.time)

    def update(self, run: Data) -> None:
        """view.update(run): shows another run (as many runs as at first) of the same system.

        Raises ModelError otherwise.
        """
        _, runs = _listed(run)
        if len(runs) != len(self._curves[0]):
            raise ModelError(
                f"this picture shows {len(self._curves[0])} run(s), update got {len(runs)}"
            )
        same_system(runs[0], self.system)
        span, *ranges = self._set_data(runs)
        found = [span] * self._spans + ranges
        moved = [window.fit(*one) for window, one in zip(self._windows, found, strict=True)]
        self.relimited = self._recolor() or any(moved)

    def _recolor(self) -> bool:
        """The legend has the colours that the modes have: as bands, or in a strip."""
        headed = getattr(self.axes[0], "headed", None)
        samples = [artist for artist, _ in headed[1] if artist.get_gid() == MODE] if headed else []
        if not samples or self._few == self._modes[0].few:
            return False
        self._few = self._modes[0].few
        for one, color in zip(samples, self._modes[0].tints, strict=True):
            one.set_facecolor(color)
        head(self.axes[0], *headed)
        return True


def _listed(run: Data) -> tuple[list[str], list[Run | Runs]]:
    if isinstance(run, Run | Runs):
        return [""], [run]
    runs = list(run.values() if isinstance(run, Mapping) else run)
    for one in runs:
        if not isinstance(one, Run | Runs):
            raise ModelError(
                f"a picture takes runs (from simulate or simulate_many), not {type(one).__name__} "
                f"{one!r:.60}"
            )
    if not runs:
        raise ModelError("there is no run to draw: the list is empty")
    numbered = (f"run {i + 1}" for i in range(len(runs)))
    return list(map(str, run if isinstance(run, Mapping) else numbered)), runs


def _shared(axes: Axes, others: Sequence[Axes]) -> bool:
    return any(axes.get_shared_x_axes().joined(axes, other) for other in others)


def _looks(i: int, runs: int, names: int) -> list[tuple[str, Any]]:
    """Colour and dash of each name's curve of run i: of one run, a colour for each name.

    Of several runs, a colour for each run, a dash for each name.
    """
    colors = [COLORS[(k if runs == 1 else i) % len(COLORS)] for k in range(names)]
    if runs == 1 or names > 1:
        many = runs == 1 and names > len(DASHES)
        return [(c, "-" if many else DASHES[k % len(DASHES)]) for k, c in enumerate(colors)]
    return [(colors[0], DASHES[i] if runs <= len(DASHES) else "-")]


def sample(line: Line2D, **changed: object) -> Line2D:
    """A legend's own copy of a line: the line itself is drawn by the panel at its own time."""
    copy = Line2D([], [])
    copy.update_from(line)
    copy.set(**changed)
    return copy


def _joined(rows: np.ndarray) -> np.ndarray:
    """(lanes, m) -> one row with NaN between the lanes: the pen goes up. One row stays."""
    if rows.ndim == 1:
        return rows
    return np.pad(rows, ((0, 0), (0, 1)), constant_values=np.nan).ravel()


class _Curve:
    """A curve that is interrupted at its jumps, and the dashed jumps."""

    def __init__(self, ax: Axes, run: Run | Runs, color: str, dash: Any):
        width, alpha = (0.8, 0.6) if isinstance(run, Runs) else (1.6, 1.0)
        look = {"color": color, "alpha": alpha}
        self.jumps = stroke(ax, ls=(0, (3, 2)), lw=0.6 * width, zorder=2.9, **look)
        self.line = stroke(ax, ls=dash, lw=width, zorder=3, dash_capstyle="butt", **look)
        self.artists = [self.jumps, self.line]

    def set(self, t: np.ndarray, y: np.ndarray) -> None:
        at = jumps(t, y)
        broken = [np.insert(values, at + 1, np.nan) for values in (t, y)] if len(at) else (t, y)
        self.line.set_data(*broken)
        self.jumps.set_data(segments(t[at], t[at + 1]), segments(y[at], y[at + 1]))


def jumps(t: np.ndarray, *values: np.ndarray) -> np.ndarray:
    """Positions i where samples i, i + 1 share an instant and a value differs visibly (1e-6)."""
    here = np.flatnonzero(t[1:] == t[:-1])
    moved = np.zeros(len(here), dtype=bool)
    for y in values if len(here) else ():
        low, high = extent(y)
        # False for NaN: a state that begins or ends does not jump
        moved |= np.abs(y[here + 1] - y[here]) > 1e-6 * (high - low)
    return here[moved]


def segments(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a, b -> a0, b0, NaN, a1, b1, NaN, ….

    Many separate strokes in one line, which draws far faster than many lines.
    """
    return np.column_stack([a, b, np.full(len(a), np.nan)]).ravel()


class _Events:
    """The instants of the events: faint lines over the whole height.

    When they are many, ticks at the top.
    """

    def __init__(self, ax: Axes):
        across = ax.get_xaxis_transform()
        look = {"color": FAINT, "lw": 0.7, "alpha": 0.75, "zorder": 1.5}
        self.line = stroke(ax, gid=EVENTS, transform=across, **look)
        self.artists = [self.line]

    def set(self, run: Run) -> None:
        t = np.array([event.t for event in run.events])
        bottom = 0.0 if len(t) <= FEW else 0.965
        self.line.set_data(segments(t, t), segments(np.full(len(t), bottom), np.ones(len(t))))


class _Modes:
    """The background in the colour of the mode, one artist a mode.

    When modes change often, a strip at the bottom; when so often that one could not tell them
    apart, the strip shows, from place to place, the share of the time that each mode takes.
    """

    def __init__(self, ax: Axes, system: System):
        self.colors = mode_colors(system)
        look = {"lw": 0, "zorder": 0.4, "transform": ax.get_xaxis_transform()}
        # sharp edges without seams
        self.patches = [area(ax, antialiased=False, **look) for _ in self.colors]
        look = {"fontsize": 8.5, "color": INK, "zorder": 6, "annotation_clip": None}
        self.words = word(ax, 3, 2, xycoords="axes fraction", **look)
        self.words.xy = (0.0, SHARED)
        self.artists = [*self.patches, self.words]

    @property
    def tints(self) -> list[tuple[float, float, float]]:
        """The colours as they look, for a legend."""
        strengths = BANDS if self.few else (STRIP,)
        colors = enumerate(self.colors.values())
        return [tint(color, strengths[k % len(strengths)]) for k, color in colors]

    def set(self, run: Run) -> None:
        first = np.append(0, np.flatnonzero(np.diff(run.mode_index)) + 1)
        left, right = run.t[first], np.append(run.t[first[1:]], run.t[-1])
        index = run.mode_index[first]
        self.few, many = len(index) <= FEW, len(index) > MANY
        places, low = np.linspace(*run.t[[0, -1]], SLOTS + 1), np.zeros(SLOTS + 1)
        for i, (patch, color) in enumerate(zip(self.patches, self.colors.values(), strict=True)):
            mine = index == i
            if many:
                high = low + SHARED * _shares(left[mine], right[mine], places)
                there, back = (np.column_stack([places, level]) for level in (low, high))
                path, low = closed(np.concatenate([there, back[::-1]])), high
            else:
                path = _boxes(left[mine], right[mine], 1.0 if self.few else 0.035)
            reshape(patch, path)
            # see-through: a panel may draw it over the grid
            patch.set_facecolor((*to_rgb(color), BANDS[i % len(BANDS)] if self.few else STRIP))
        words = "share of the time" if many else ""
        if words != self.words.get_text():
            self.words.set_text(words)


# More stretches of modes than MANY are finer than a pixel or two: instead the share of each mode at
# SLOTS + 1 places, over a window of WIDE of the whole time
MANY, SLOTS, WIDE, SHARED, STRIP = 300, 150, 0.04, 0.07, 0.8


def _shares(left: np.ndarray, right: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The part of the window around each place that the stretches left … right cover."""
    if not len(left):
        return np.zeros(len(places))
    reach = 0.5 * WIDE * (places[-1] - places[0])
    window = np.clip([places - reach, places + reach], *places[[0, -1]])
    corners = np.column_stack([left, right]).ravel()
    so_far = np.cumsum(np.column_stack([np.zeros(len(left)), right - left]).ravel())
    return np.diff(np.interp(window, corners, so_far), axis=0)[0] / np.diff(window, axis=0)[0]


def _boxes(left: np.ndarray, right: np.ndarray, top: float) -> Path:
    """One path of many rectangles from 0 to `top`."""
    x = np.column_stack([left, left, right, right, left])
    y = np.broadcast_to([0.0, top, top, 0.0, 0.0], x.shape)
    return Path(np.stack([x, y], axis=2).reshape(-1, 2), np.tile(_BOX, len(left)))


_BOX = closed(np.zeros((4, 2))).codes
