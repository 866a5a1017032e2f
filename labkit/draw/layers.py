"""The layers of a phase portrait.

Each keeps its artists and can `redo()` them for other parameters or limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ..model import ModelError
from ..run import Run
from ..runs import Runs
from .figure import COLORS, DASHES, FAINT, INK, VEIL, figure, label, mode_colors, style, symbol
from .plane import GRID, Limits, Plane, contour, find_equilibria, separatrices
from .private import reshape
from .ticks import said
from .time import _jumps, _sample, _segments
from .view import View
from .words import MODE

__all__ = [
    "DirectionField",
    "Equilibria",
    "GuardLines",
    "Layer",
    "Nullclines",
    "Separatrices",
    "Trajectories",
]


class Layer(View):
    """One layer over the plane of two states, alone or as a part of a portrait.

    Its legend() names what it shows.
    """

    def __init__(self, axes: Axes, plane: Plane):
        self.axes, self.plane, self.figure = axes, plane, axes.get_figure()
        self.colors = mode_colors(plane.system)
        self.artists: list[Artist] = []

    @property
    def limits(self) -> Limits:
        return tuple(sorted(map(float, self.axes.get_xlim()))), tuple(
            sorted(map(float, self.axes.get_ylim()))
        )  # type: ignore[return-value]

    @property
    def shape(self) -> float:
        """Width of the axes over their height, on paper."""
        box = self.axes.bbox  # get_position() would declare the axes changed
        return float(box.width / box.height)

    def _add(self, artist: Any) -> Any:
        self.axes.add_artist(artist)
        self.artists.append(artist)
        return artist

    def _mode_color(self, mode: str) -> str:
        return self.colors[mode] if len(self.colors) > 1 else FAINT

    def redo(self) -> None:
        raise NotImplementedError

    def update(self, run: Run | Runs) -> None:
        """layer.update(run): the layer for the parameters of another run."""
        self.plane.follow(run if isinstance(run, Run) else run[0])
        self.redo()

    def legend(self) -> list[tuple[Artist, str]]:
        return []


class DirectionField(Layer):
    """Arrows of one length along (dx/dt, dy/dt), in the colour of the mode that holds there.

    None at rest or where no mode holds.
    """

    def __init__(self, axes: Axes, plane: Plane, points: int = 15):
        super().__init__(axes, plane)
        self.points = points
        self.lines = [
            self._add(
                Line2D(
                    [],
                    [],
                    color=self._mode_color(mode),
                    linewidth=0.8,
                    alpha=0.55,
                    zorder=1.2,
                    solid_joinstyle="miter",
                )
            )
            for mode in plane.modes
        ]
        self.redo()

    def redo(self) -> None:
        rows = self.points
        columns = min(max(round(rows * self.shape), 5), 60)
        (x0, x1), (y0, y1) = self.limits
        X, Y = (
            a.ravel()
            for a in np.meshgrid(
                x0 + (np.arange(columns) + 0.5) / columns * (x1 - x0),
                y0 + (np.arange(rows) + 0.5) / rows * (y1 - y0),
            )
        )
        governing = self.plane.governing(X, Y)
        for i, (mode, line) in enumerate(zip(self.plane.modes, self.lines, strict=True)):
            here = governing == i
            x, y = X[here], Y[here]
            if not len(x):
                line.set_data([], [])
                continue
            f, g = self.plane.flow(mode, x, y)
            # Directions on paper: in units of the axes' height. Lengths there are alike, whatever
            # the units of x and y are.
            a, b = f / (x1 - x0) * self.shape, g / (y1 - y0)
            speed = np.hypot(a, b)
            with np.errstate(all="ignore"):
                a, b = (np.where(speed > 0, v / speed, 0.0 * speed) for v in (a, b))
            length = 0.62 / rows
            place = np.column_stack([(x - x0) / (x1 - x0) * self.shape, (y - y0) / (y1 - y0)])
            way, across = length * np.column_stack([a, b]), length * np.column_stack([-b, a])
            tail, tip = place - 0.5 * way, place + 0.5 * way
            barb = 0.28
            left, right = (tip - barb * way + side * 0.6 * barb * across for side in (1, -1))
            up = np.full_like(tip, np.nan)
            strokes = np.stack([tail, tip, up, left, tip, right, up], axis=1).reshape(
                -1, 2
            )  # nothing is drawn twice: Agg would darken it
            line.set_data(
                x0 + strokes[:, 0] / self.shape * (x1 - x0), y0 + strokes[:, 1] * (y1 - y0)
            )


class Nullclines(Layer):
    """The curves dx/dt = 0 (dotted) and dy/dt = 0 (dash-dotted), where their mode holds."""

    def __init__(self, axes: Axes, plane: Plane, points: int = GRID):
        super().__init__(axes, plane)
        self.points = points
        looks = ((0, (1.2, 1.6)), (0, (6, 1.8, 1.2, 1.8)))
        self.lines = [
            self._add(
                Line2D([], [], color=INK, linewidth=1.1, alpha=0.75, linestyle=look, zorder=2)
            )
            for look in looks
        ]
        self.redo()

    def redo(self) -> None:
        curves: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        for i, mode in enumerate(self.plane.modes):
            if not self.plane.is_plane(mode):
                continue
            values = self.plane.flow_on_grid(mode, self.limits, self.points)
            for k in (0, 1):
                curves[k].extend(
                    contour(
                        lambda x, y, k=k, mode=mode: self.plane.flow(mode, x, y)[k],
                        self.limits,
                        self.points,
                        values[k],
                        keep=lambda x, y, i=i: self.plane.governing(x, y) == i,
                    )
                )
        for line, found in zip(self.lines, curves, strict=True):
            line.set_data(*_strung(found))

    def legend(self) -> list[tuple[Artist, str]]:
        names = [rf"d{symbol(name)}/d$t$ = 0" for name in (self.plane.x, self.plane.y)]
        return [
            (
                _sample(line),
                name,
            )
            for line, name in zip(self.lines, names, strict=True)
            if len(line.get_xdata())
        ]


class Separatrices(Layer):
    """The two curves into each saddle (full) and the two out of it (dashed), see `separatrices`."""

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"color": COLORS[3], "linewidth": 1.8, "zorder": 3.4, "dash_capstyle": "butt"}
        self.lines = [
            self._add(Line2D([], [], linestyle=dash, **look)) for dash in ("-", (0, (6, 2)))
        ]
        self.redo()

    def redo(self) -> None:
        found = separatrices(self.plane, self.limits)
        for line, curves in zip(self.lines, found, strict=True):
            line.set_data(*_strung(curves))

    def points(self) -> list[np.ndarray]:
        return [line.get_xydata() for line in self.lines]

    def legend(self) -> list[tuple[Artist, str]]:
        names = ("into the saddle", "out of the saddle")
        pairs = zip(self.lines, names, strict=True)
        return [(_sample(line), name) for line, name in pairs if len(line.get_xdata())]


class Equilibria(Layer):
    """Equilibria with their type in words.

    Stable full, unstable empty, centre grey, saddle a cross. `found` lists them.
    """

    def __init__(self, axes: Axes, plane: Plane, words: int = 8):
        super().__init__(axes, plane)
        look = {
            "linestyle": "none",
            "zorder": 6,
            "markersize": 8,
            "markeredgecolor": INK,
            "markeredgewidth": 1.4,
        }
        marks = (
            ("stable", "o", INK),
            ("unstable", "o", "white"),
            ("centre", "o", "#B5B5B5"),
            ("saddle", "X", "white"),
            ("", "s", "white"),
        )
        self.marks = {
            kind: self._add(Line2D([], [], marker=marker, markerfacecolor=face, **look))
            for kind, marker, face in marks
        }  # type: ignore[arg-type]
        self.words: list[Any] = []
        self._said: dict[int, tuple] = {}  # what the words say, where
        for _ in range(words):
            text = axes.annotate(
                "",
                (0, 0),
                xytext=(9, 9),
                textcoords="offset points",
                fontsize=9.5,
                zorder=7,
                bbox=VEIL,
                annotation_clip=True,
            )
            text.set_in_layout(False)
            self.words.append(text)
        self.artists += self.words
        self.redo()

    def redo(self) -> None:
        self.found = find_equilibria(self.plane, self.limits)
        for kind, mark in self.marks.items():
            mine = [
                (x, y)
                for x, y, _, word in self.found
                if kind == next(k for k in self.marks if word.startswith(k))
            ]
            mark.set_data([x for x, _ in mine], [y for _, y in mine])
        self.name()

    def name(self) -> None:
        """Puts the words where they have room in axes of this size; too narrow, there are none."""
        (x0, x1), (y0, y1) = self.limits
        wide = self.axes.bbox.width / self.figure.dpi
        taken: list[tuple[float, float, float, float]] = []
        for k, (text, (x, y, _, kind)) in enumerate(zip(self.words, self.found, strict=False)):
            place = f"({said(x)}, {said(y)})"
            words = f"{kind}\n{place}"
            if len(self.found) > 3 or 0.075 * len(kind) > 0.6 * wide:  # the marks stand close
                words = kind.replace(" ", "\n", 1)
            side, up = self._free_corner(
                (x - x0) / (x1 - x0), (y - y0) / (y1 - y0), max(map(len, words.split("\n"))), taken
            )
            across = max(x - x0, x1 - x) / (x1 - x0) * wide
            fits = 0.075 * max(map(len, words.split("\n"))) < across + 0.2
            new = words, x, y, side, up, fits
            if self._said.get(k) != new:  # else a picture need not be sent words that it has
                text.set(
                    text=words,
                    visible=fits,
                    ha="left" if side > 0 else "right",
                    va="bottom" if up > 0 else "top",
                )
                text.xy = (x, y)
                text.set_position((9 * side, 7 * up))
                self._said[k] = new
        for k in [k for k in self._said if k >= len(self.found)]:
            self.words[k].set_visible(False)
            del self._said[k]

    def _free_corner(
        self, x: float, y: float, letters: int, taken: list[tuple[float, float, float, float]]
    ) -> tuple[int, int]:
        """The corner of a mark where its words meet neither edge nor others; estimated."""
        dpi = self.figure.dpi
        wide = 0.85 * self.axes.bbox.width / dpi  # the layout makes room for a legend later
        w, h, off = 0.075 * letters / wide, 0.36 * dpi / self.axes.bbox.height, 0.125 / wide
        corners = [
            (side, up, min(x + side * off, x + side * (off + w)), min(y, y + up * h))
            for up in (1, -1)
            for side in (1, -1)
        ]

        def clashes(a: float, b: float) -> float:
            return 10.0 * (a < 0 or b < 0 or a + w > 1 or b + h > 1) + sum(
                c - w < a < c + e and abs(b - d) < 0.95 * h for c, d, e, _ in taken
            )

        side, up, a, b = min(corners, key=lambda corner: clashes(corner[2], corner[3]))
        taken.append((a, b, w, h))
        return side, up


class GuardLines(Layer):
    """Where the guards of the shown modes are zero: dashed, in the mode's colour, named.

    Guards that change with time have no fixed line; `omitted` names them. A mode in which the point
    of the plane stands still (a body at rest) has none in it.
    """

    def __init__(self, axes: Axes, plane: Plane, points: int = GRID):
        super().__init__(axes, plane)
        self.points = points
        self.lines = {
            mode: self._add(
                Line2D(
                    [],
                    [],
                    color=self._mode_color(mode),
                    linewidth=1.3,
                    linestyle=(0, (5, 2.5)),
                    zorder=2.5,
                )
            )
            for mode in plane.modes
        }
        self.words = {}
        for mode in plane.modes:
            for i in plane.system.leaving[mode]:
                if plane.system.transitions[i].guard is not None:
                    text = axes.annotate(
                        "",
                        (0, 0),
                        xytext=(4, -4),
                        textcoords="offset points",
                        fontsize=9,
                        zorder=6.5,
                        bbox=VEIL,
                        color=self.lines[mode].get_color(),
                        annotation_clip=True,
                    )
                    text.set_in_layout(False)
                    self.words[mode, i] = text
        self.artists += self.words.values()
        self._placed: dict[tuple[str, int], np.ndarray] = {}
        self.redo()

    def redo(self) -> None:
        limits, self.omitted = self.limits, []
        named: list[
            tuple[str, list[np.ndarray]]
        ] = []  # two modes may turn on the same line by the same name: written once
        self.curves: dict[tuple[str, int], list[np.ndarray]] = {}
        for mode, line in self.lines.items():
            curves = []
            still = self.plane.stands_still(mode, limits)
            for i in self.plane.system.leaving[mode]:
                if (mode, i) not in self.words:
                    continue
                transition = self.plane.system.transitions[i]
                found: list[np.ndarray] = []
                if transition.guard is None or still:  # nothing moves across its guards
                    pass
                elif self.plane.guard_depends_on_time(transition, mode, limits):
                    self.omitted.append(transition.name)
                else:
                    found = contour(
                        lambda x, y, tr=transition, mode=mode: self.plane.guard(tr, mode, x, y),
                        limits,
                        self.points,
                    )
                curves += found
                again = any(
                    transition.name == name and _alike(found, others) for name, others in named
                )
                named.append((transition.name, found))
                self.curves[mode, i] = [] if again else found
            line.set_data(*_strung(curves))
        self.name()

    def name(self, others: Sequence[Layer] = ()) -> None:
        """layer.name(layers): puts the names where they lie on no other line, as far as that goes.

        The names stay where they are until another place is clearly better.
        """
        (x0, x1), (y0, y1) = self.limits
        corner, size = np.array([x0, y0]), np.array([x1 - x0, y1 - y0])
        paths = {
            key: [_dense((curve - corner) / size) for curve in curves]
            for key, curves in self.curves.items()
        }
        drawn = [
            (points - corner) / size
            for layer in others
            if isinstance(layer, Trajectories | Separatrices)
            for points in layer.points()
        ]
        taken: list[np.ndarray] = []
        for key, text in self.words.items():
            mine = paths.get(key, [])
            text.set_visible(bool(mine))
            if not mine:
                continue
            rest = [part for other, parts in paths.items() if other != key for part in parts]
            self._name(key, mine, np.concatenate([*rest, *drawn, np.zeros((0, 2))]), taken)

    def _name(
        self,
        key: tuple[str, int],
        mine: Sequence[np.ndarray],
        lines: np.ndarray,
        taken: list[np.ndarray],
    ) -> None:
        """The place beside the longest line with the fewest points of other lines under the name.

        Of places that are alike the one at the top of a steep line or the right of a flat one.
        """
        text, name = self.words[key], self.plane.system.transitions[key[1]].name
        curve = max(mine, key=lambda c: np.ptp(c, axis=0).max())
        steep = np.ptp(curve[:, 1]) > np.ptp(curve[:, 0])
        dpi, box = self.figure.dpi, self.axes.bbox
        w, h = 0.068 * len(name) * dpi / box.width, 0.17 * dpi / box.height
        if w > 0.6:  # in small axes a name would say less than it hides
            return text.set_visible(False)
        dx, dy = 0.07 * dpi / box.width, 0.06 * dpi / box.height
        order = np.argsort(-curve[:, 1 if steep else 0], kind="stable")
        best: tuple[float, Any] = (np.inf, None)
        before = self._placed.get(key)
        for k, spot in enumerate(curve[order[:: max(1, len(order) // 14)]]):
            for right in (1, 0):
                for up in (0, 1) if steep else (1, 0):
                    at = spot + [dx if right else -dx - w, dy if up else -dy - h]
                    corners = np.array([at, at + [w, h]])
                    outside = (corners < 0.0).any() or (corners > 1.0).any()
                    over = sum(
                        bool(np.all(corners[0] < b[1]) and np.all(corners[1] > b[0])) for b in taken
                    )
                    pad = 0.2 * np.array([dx, dy])
                    hits = ((lines > corners[0] - pad) & (lines < corners[1] + pad)).all(axis=1)
                    own = ((curve > corners[0]) & (curve < corners[1])).all(axis=1)
                    cost = 100 * outside + 50 * over + hits.sum() + 3 * own.sum()
                    cost += 0.02 * k + 0.005 * (1 - right)
                    if before is not None and np.abs(corners - before).max() > 0.1:
                        cost += 2
                    if cost < best[0]:
                        best = cost, (spot, right, up, corners)
        spot, right, up, corners = best[1]
        taken.append(corners)
        self._placed[key] = corners
        (x0, x1), (y0, y1) = self.limits
        text.xy = (x0 + spot[0] * (x1 - x0), y0 + spot[1] * (y1 - y0))
        text.set(text=name, ha="left" if right else "right", va="bottom" if up else "top")
        text.set_position((5 if right else -5, 4 if up else -4))


def _dense(curve: np.ndarray, gap: float = 0.02) -> np.ndarray:
    """A polyline in units of the picture with points no further apart than `gap`."""
    steps = np.hypot(*np.diff(curve, axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    if not np.isfinite(way[-1]) or way[-1] == 0 or way[-1] > 40:
        return curve
    places = np.linspace(0, way[-1], int(way[-1] / gap) + 2)
    return np.column_stack([np.interp(places, way, curve[:, k]) for k in (0, 1)])


def _alike(some: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> bool:
    """Do two sets of curves cover the same ground, up to a mode's own part of it?"""
    if not some or not others:
        return False
    a, b = (
        np.concatenate([c[np.isfinite(c).all(axis=1)] for c in curves]) for curves in (some, others)
    )
    size = np.maximum(np.ptp(np.concatenate([a, b]), axis=0), 1e-12)
    flat = [
        int(k)
        for k in range(2)
        if np.ptp(a[:, k]) <= 1e-9 * size[k] and np.ptp(b[:, k]) <= 1e-9 * size[k]
    ]
    if flat:  # straight along an axis: the same line, even where the parts differ
        return bool(abs(a[0, flat[0]] - b[0, flat[0]]) <= 1e-9 * max(1.0, abs(a[0, flat[0]])))
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=0, atol=1e-6 * size))


class Trajectories(Layer):
    """Trajectories in the colours of their modes: jumps dashed, dots at the starts, arrows."""

    def __init__(
        self, axes: Axes, plane: Plane, runs: Run | Runs, bold: bool = False, arrows: bool = True
    ):
        super().__init__(axes, plane)
        self.runs, self.arrows = runs, arrows
        self.keys = list(plane.system.modes)
        width, z = (2.2, 5.0) if bold else (0.9, 3.0)
        alone = len(self.keys) == 1
        self.jumps = self._add(
            Line2D(
                [],
                [],
                color=INK,
                linewidth=1.1 if bold else 0.6,
                alpha=0.8 if bold else 0.5,
                linestyle=(0, (3, 2)),
                zorder=z - 0.1,
            )
        )
        colors = {
            key: (INK if bold else color) if alone else color for key, color in self.colors.items()
        }
        self.dashes = [
            DASHES[k % len(DASHES)] if bold else "-" for k in range(len(colors))
        ]  # the colours of modes are alike in grey print
        look = {"linewidth": width, "alpha": 1.0 if bold else 0.85, "zorder": z}
        # Strokes of their own: one that crosses itself a thousand times takes far longer to paint
        if isinstance(runs, Runs):
            made: list[Any] = [
                LineCollection([], colors=[color], capstyle="round", joinstyle="round", **look)
                for color in colors.values()
            ]
        else:
            made = [
                Line2D([], [], color=color, linestyle=dash, dash_capstyle="butt", **look)
                for color, dash in zip(colors.values(), self.dashes, strict=True)
            ]
        self.lines = [self._add(line) for line in made]
        self.heads = [
            self._add(
                PathPatch(Path(np.zeros((0, 2))), facecolor=color, linewidth=0, zorder=z + 0.1)
            )
            for color in colors.values()
        ]
        self.starts = self._add(
            Line2D(
                [],
                [],
                linestyle="none",
                marker="o",
                markersize=6 if bold else 3.2,
                markerfacecolor="white",
                markeredgecolor=INK,
                markeredgewidth=1.3 if bold else 0.8,
                zorder=z + 0.2,
            )
        )
        self.size = 0.034 if bold else 0.024
        self.set(runs)

    def update(self, run: Run | Runs) -> None:
        """layer.update(runs): other trajectories in the same artists."""
        self.set(run)

    def redo(self) -> None:
        self.set(self.runs)

    def points(self) -> list[np.ndarray]:
        """What lies on the picture, as places: at most 2000."""
        x, y = np.ravel(self.runs[self.plane.x]), np.ravel(self.runs[self.plane.y])
        few = slice(None, None, max(1, len(x) // 2000))
        return [np.column_stack([x[few], y[few]])]

    def set(self, runs: Run | Runs) -> None:
        self.runs = runs
        X, Y = runs[self.plane.x], runs[self.plane.y]
        t, modes = runs.t, runs.mode_index
        if isinstance(runs, Run):
            X, Y, t, modes = X[None], Y[None], t[None], modes[None]
        self.starts.set_data(X[:, 0], Y[:, 0])
        if self.arrows:
            self._put_arrows(X, Y, modes)
        if (
            len(self.lines) == 1 and not modes.any() and not (t[:, 1:] == t[:, :-1]).any()
        ):  # no lane ends early, none has an event: as most of them
            self.jumps.set_data([], [])
            return self._put(self.lines[0], list(np.stack([X, Y], axis=2)))
        gap = np.full((len(X), 1), np.nan)
        x, y, time = (np.hstack([a, gap]).ravel() for a in (X, Y, t))
        mode = np.hstack([modes, np.full((len(X), 1), -1)]).ravel()
        at = _jumps(time, x, y)
        self.jumps.set_data(_segments(x[at], x[at + 1]), _segments(y[at], y[at + 1]))
        jumping = np.zeros(len(x), dtype=bool)
        jumping[at] = True
        for i, line in enumerate(self.lines):
            here = np.flatnonzero(mode == i)
            cuts = np.flatnonzero((np.diff(here) > 1) | jumping[here[:-1]]) + 1
            self._put(line, np.split(np.column_stack([x[here], y[here]]), cuts))

    def _put(self, line: LineCollection | Line2D, curves: Sequence[np.ndarray]) -> None:
        if isinstance(line, LineCollection):
            line.set_segments(curves)
        else:
            line.set_data(*_strung(curves))

    def _put_arrows(self, X: np.ndarray, Y: np.ndarray, modes: np.ndarray) -> None:
        """Arrow heads at set distances along each trajectory, as on paper, inside the picture."""
        if X.shape[1] == 1:  # none came beyond its start: no length, no head
            X, Y, modes = (np.repeat(array, 2, axis=1) for array in (X, Y, modes))
        (x0, x1), (y0, y1) = self.limits
        shape, size = self.shape, self.size
        x, y = (X - x0) / (x1 - x0) * shape, (Y - y0) / (y1 - y0)
        dx, dy = np.diff(x, axis=1), np.diff(y, axis=1)
        step = np.hypot(dx, dy)
        inside = (x > 0) & (x < shape) & (y > 0) & (y < 1)
        step = np.where(np.isfinite(step) & inside[:, :-1], step, 0.0)
        way, shares = np.cumsum(step, axis=1), np.array([0.12, 0.45, 0.9] if len(X) < 60 else [0.2])
        k = np.minimum(
            (way[:, None] < shares[:, None]).sum(axis=2), step.shape[1] - 1
        )  # of each trajectory and share
        long = np.take_along_axis(step, k, axis=1)
        use = (way[:, -1:] > shares + size) & (long > 0) & (long < 0.2)
        at = np.nonzero(use)[0], k[use]
        across = np.column_stack([dx[at], dy[at]]) / step[at][:, None]
        tip = np.column_stack([x[at], y[at]]) + 0.5 * size * across
        side = 0.38 * size * np.column_stack([-across[:, 1], across[:, 0]])
        corners = np.stack(
            [tip, tip - size * across + side, tip - size * across - side, tip], axis=1
        ) * [(x1 - x0) / shape, y1 - y0] + [x0, y0]
        for i, head in enumerate(self.heads):
            mine = corners[modes[at] == i]
            reshape(head, Path(mine.reshape(-1, 2), np.tile(_TRIANGLE, len(mine))))

    def legend(self) -> list[tuple[Artist, str]]:
        looks = zip(self.colors.items(), self.dashes, strict=True)
        return (
            [
                (Line2D([], [], color=color, linewidth=1.8, linestyle=dash, gid=MODE), mode)
                for (mode, color), dash in looks
            ]
            if len(self.colors) > 1
            else []
        )


_TRIANGLE = np.array([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], dtype=Path.code_type)


def _strung(curves: Sequence[np.ndarray]) -> np.ndarray:
    """Many polylines -> x and y of one, with NaN between them."""
    if not curves:
        return np.empty((2, 0))
    return np.concatenate([part for curve in curves for part in (curve, [[np.nan, np.nan]])]).T


def stage(
    plane: Plane, axes: Axes | None, limits: Limits | None, width: float = 7.5, height: float = 5.2
) -> Axes:
    """Axes for a portrait: labelled, with the limits.

    `limits` may be left out for axes that have theirs already.
    """
    for pair in limits or ():
        if len(pair) != 2 or not (np.all(np.isfinite(pair)) and pair[0] < pair[1]):
            raise ModelError(
                f"limits are ((x low, x high), (y low, y high)) with low < high, not {limits!r}"
            )
    if axes is None:
        if limits is None:
            raise ModelError(
                "limits are missing: give limits=((x low, x high), (y low, y high)), or axes="
            )
        axes = figure(width=width, height=height).axes[0]
    with style():
        axes.set_xlabel(label(plane.system, plane.x))
        axes.set_ylabel(label(plane.system, plane.y))
    if limits is not None:
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
    return axes


def layer(
    kind: type[Layer],
    system: Any,
    x: str | None,
    y: str | None,
    axes: Axes | None,
    limits: Limits | None,
    mode: str | None,
    t: float,
    at: Mapping[str, float] | None,
    parameters: Mapping[str, float],
    **options: Any,
) -> Any:
    plane = Plane(system, x, y, mode=mode, t=t, at=at, p=system.values(parameters))
    return kind(stage(plane, axes, limits), plane, **options)
