"""The layers of a phase portrait.

Each keeps its artists and can `redo()` them for other parameters or limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.path import Path

from ..model import ModelError
from ..run import Run
from ..runs import Runs
from .figure import (
    COLORS,
    DASHES,
    FAINT,
    INK,
    area,
    figure,
    label,
    mode_colors,
    stroke,
    style,
    symbol,
    word,
)
from .plane import Limits, Plane, contour, find_equilibria, separatrices
from .private import closed, reshape
from .ticks import said
from .time import jumps, sample, segments
from .view import View
from .words import MODE


class Layer(View):
    """One layer of a portrait, over the plane of two states.

    Its legend() names what it shows.
    """

    def __init__(self, axes: Axes, plane: Plane):
        self.axes, self.plane, self.figure = axes, plane, axes.get_figure()
        self.colors = mode_colors(plane.system)
        self.artists: list[Artist] = []

    @property
    def limits(self) -> Limits:
        x, y = (sorted(map(float, get())) for get in (self.axes.get_xlim, self.axes.get_ylim))
        return tuple(x), tuple(y)  # type: ignore[return-value]

    @property
    def shape(self) -> float:
        """Width of the axes over their height, on paper."""
        box = self.axes.bbox  # get_position() would declare the axes changed
        return float(box.width / box.height)

    def _stroke(self, **look: Any) -> Line2D:
        self.artists.append(stroke(self.axes, **look))
        return self.artists[-1]  # type: ignore[return-value]

    def _place(self, shares: np.ndarray) -> np.ndarray:
        """Points (…, 2) in units of the picture, from 0 to 1, where they belong in the axes."""
        low, high = np.array(self.limits).T
        return low + shares * (high - low)

    def _shares(self, points: np.ndarray) -> np.ndarray:
        """And back: places in the axes in units of the picture."""
        low, high = np.array(self.limits).T
        return (points - low) / (high - low)

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

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"lw": 0.8, "alpha": 0.55, "zorder": 1.2, "solid_joinstyle": "miter"}
        self.lines = [self._stroke(color=self._mode_color(mode), **look) for mode in plane.modes]
        self.redo()

    def redo(self) -> None:
        rows = 15
        columns = min(max(round(rows * self.shape), 5), 60)
        (x0, x1), (y0, y1) = self.limits
        places = np.meshgrid(*((np.arange(n) + 0.5) / n for n in (columns, rows)))
        X, Y = x0 + places[0].ravel() * (x1 - x0), y0 + places[1].ravel() * (y1 - y0)
        governing = self.plane.governing(X, Y)
        # On paper, in units of the axes' height: lengths there are alike, whatever the units of x
        # and y are.
        paper = np.array([self.shape, 1.0])
        scale = paper / (x1 - x0, y1 - y0)
        for i, (mode, line) in enumerate(zip(self.plane.modes, self.lines, strict=True)):
            x, y = X[governing == i], Y[governing == i]
            if not len(x):
                line.set_data([], [])
                continue
            way = np.column_stack(self.plane.flow(mode, x, y)) * scale
            speed = np.hypot(*way.T)[:, None]
            with np.errstate(all="ignore"):
                way = 0.62 / rows * np.where(speed > 0, way / speed, 0.0 * speed)
            across = way[:, ::-1] * (-1, 1)
            place = np.column_stack([x - x0, y - y0]) * scale
            tail, tip, barb = place - 0.5 * way, place + 0.5 * way, 0.28
            left, right = (tip - barb * way + side * 0.6 * barb * across for side in (1, -1))
            up = np.full_like(tip, np.nan)
            # nothing is drawn twice: Agg would darken it
            strokes = np.stack([tail, tip, up, left, tip, right, up], axis=1).reshape(-1, 2)
            line.set_data(*self._place(strokes / paper).T)


class Nullclines(Layer):
    """The curves dx/dt = 0 (dotted) and dy/dt = 0 (dash-dotted), where their mode holds."""

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"color": INK, "lw": 1.1, "alpha": 0.75, "zorder": 2}
        dashes = ((0, (1.2, 1.6)), (0, (6, 1.8, 1.2, 1.8)))
        self.lines = [self._stroke(ls=dash, **look) for dash in dashes]
        self.redo()

    def redo(self) -> None:
        curves: list[list[np.ndarray]] = [[], []]
        for i, mode in enumerate(self.plane.modes):
            if not self.plane.is_plane(mode):
                continue
            for k, values in enumerate(self.plane.flow_on_grid(mode, self.limits)):
                curves[k] += contour(
                    lambda x, y, k=k, mode=mode: self.plane.flow(mode, x, y)[k],
                    self.limits,
                    values=values,
                    keep=lambda x, y, i=i: self.plane.governing(x, y) == i,
                )
        for line, found in zip(self.lines, curves, strict=True):
            line.set_data(*strung(found))

    def legend(self) -> list[tuple[Artist, str]]:
        names = [rf"d{symbol(name)}/d$t$ = 0" for name in (self.plane.x, self.plane.y)]
        return _samples(self.lines, names)


class Separatrices(Layer):
    """The two curves into each saddle (full) and the two out of it (dashed), see `separatrices`."""

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"color": COLORS[3], "lw": 1.8, "zorder": 3.4, "dash_capstyle": "butt"}
        self.lines = [self._stroke(ls=dash, **look) for dash in DASHES[:2]]
        self.redo()

    def redo(self) -> None:
        found = separatrices(self.plane, self.limits)
        for line, curves in zip(self.lines, found, strict=True):
            line.set_data(*strung(curves))

    def points(self) -> list[np.ndarray]:
        return [line.get_xydata() for line in self.lines]

    def legend(self) -> list[tuple[Artist, str]]:
        return _samples(self.lines, ("into the saddle", "out of the saddle"))


class Equilibria(Layer):
    """Equilibria with their type in words.

    Stable full, unstable empty, centre grey, saddle a cross. `found` lists them.
    """

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"ls": "none", "zorder": 6, "ms": 8, "mec": INK, "mew": 1.4}
        self.marks = {
            "stable": self._stroke(marker="o", mfc=INK, **look),
            "unstable": self._stroke(marker="o", mfc="white", **look),
            "centre": self._stroke(marker="o", mfc="#B5B5B5", **look),
            "saddle": self._stroke(marker="X", mfc="white", **look),
            "": self._stroke(marker="s", mfc="white", **look),
        }
        self.words = [word(axes, 9, 9, fontsize=9.5, zorder=7) for _ in range(8)]
        self._said: dict[int, tuple] = {}  # what the words say, where
        self.artists += self.words
        self.redo()

    def redo(self) -> None:
        self.found = find_equilibria(self.plane, self.limits)
        for mark in self.marks.values():
            mark.set_data([], [])
        for x, y, _, words in self.found:
            mark = next(mark for kind, mark in self.marks.items() if words.startswith(kind))
            mark.set_data([*mark.get_xdata(), x], [*mark.get_ydata(), y])
        self.name()

    def name(self) -> None:
        """Puts the words where they have room in axes of this size; too narrow, there are none."""
        (x0, x1), (y0, y1) = self.limits
        wide = self.axes.bbox.width / self.figure.dpi
        taken: list[tuple[float, float, float]] = []
        for k, (text, (x, y, _, kind)) in enumerate(zip(self.words, self.found, strict=False)):
            words = f"{kind}\n({said(x)}, {said(y)})"
            if len(self.found) > 3 or 0.075 * len(kind) > 0.6 * wide:  # the marks stand close
                words = kind.replace(" ", "\n", 1)
            letters, right = max(map(len, words.split("\n"))), (x - x0) / (x1 - x0)
            side, up = self._free_corner(right, (y - y0) / (y1 - y0), letters, taken)
            fits = 0.075 * letters < max(right, 1 - right) * wide + 0.2
            new = words, x, y, side, up, fits
            if self._said.get(k) != new:  # else a picture need not be sent words that it has
                across, upwards = "left" if side > 0 else "right", "bottom" if up > 0 else "top"
                text.set(text=words, visible=fits, ha=across, va=upwards)
                text.xy = (x, y)
                text.set_position((9 * side, 7 * up))
                self._said[k] = new
        for k in [k for k in self._said if k >= len(self.found)]:
            self.words[k].set_visible(False)
            del self._said[k]

    def _free_corner(
        self, x: float, y: float, letters: int, taken: list[tuple[float, float, float]]
    ) -> tuple[int, int]:
        """The corner of a mark where its words meet neither edge nor others; estimated."""
        dpi, box = self.figure.dpi, self.axes.bbox
        wide = 0.85 * box.width / dpi  # the layout makes room for a legend later
        w, h, off = 0.075 * letters / wide, 0.36 * dpi / box.height, 0.125 / wide

        def corner(side: int, up: int) -> tuple[float, float]:
            return min(x + side * off, x + side * (off + w)), min(y, y + up * h)

        def clashes(way: tuple[int, int]) -> float:
            a, b = corner(*way)
            return 10.0 * (a < 0 or b < 0 or a + w > 1 or b + h > 1) + sum(
                c - w < a < c + e and abs(b - d) < 0.95 * h for c, d, e in taken
            )

        best = min(((1, 1), (-1, 1), (1, -1), (-1, -1)), key=clashes)
        taken.append((*corner(*best), w))
        return best


class GuardLines(Layer):
    """Where the guards of the shown modes are zero: dashed, in the mode's colour, named.

    Guards that change with time have no fixed line; `omitted` names them. A mode in which the point
    of the plane stands still (a body at rest) has none in it.
    """

    def __init__(self, axes: Axes, plane: Plane):
        super().__init__(axes, plane)
        look = {"lw": 1.3, "ls": (0, (5, 2.5)), "zorder": 2.5}
        colors = {mode: self._mode_color(mode) for mode in plane.modes}
        self.lines = {mode: self._stroke(color=color, **look) for mode, color in colors.items()}
        self.words = {
            (mode, i): word(axes, 4, -4, fontsize=9, zorder=6.5, color=color)
            for mode, color in colors.items()
            for i in plane.guards(mode)
        }
        self.artists += self.words.values()
        self._placed: dict[tuple[str, int], np.ndarray] = {}
        self.redo()

    def redo(self) -> None:
        plane, limits, self.omitted = self.plane, self.limits, []
        # two modes may turn on the same line by the same name: written once
        named: list[tuple[str, list[np.ndarray]]] = []
        self.curves: dict[tuple[str, int], list[np.ndarray]] = {}
        for mode, line in self.lines.items():
            curves = []
            still = plane.stands_still(mode, limits)  # nothing moves across its guards
            for i in () if still else plane.guards(mode):
                transition = plane.system.transitions[i]
                if plane.guard_depends_on_time(transition, mode, limits):
                    self.omitted.append(transition.name)
                    continue
                found = contour(
                    lambda x, y, tr=transition, mode=mode: plane.guard(tr, mode, x, y), limits
                )
                curves += found
                if not any(transition.name == name and _alike(found, one) for name, one in named):
                    self.curves[mode, i] = found
                named.append((transition.name, found))
            line.set_data(*strung(curves))
        self.name()

    def name(self, others: Sequence[Layer] = ()) -> None:
        """layer.name(layers): puts the names where they lie on no other line, as far as that goes.

        The names stay where they are until another place is clearly better.
        """
        paths = {
            key: [_dense(self._shares(curve)) for curve in curves]
            for key, curves in self.curves.items()
        }
        drawn = [
            self._shares(points)
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
        text.xy = tuple(self._place(spot))
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
    for k in (0, 1):
        if max(np.ptp(a[:, k]), np.ptp(b[:, k])) <= 1e-9 * size[k]:
            # straight along an axis: the same line, even where the parts differ
            return bool(abs(a[0, k] - b[0, k]) <= 1e-9 * max(1.0, abs(a[0, k])))
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=0, atol=1e-6 * size))


class Trajectories(Layer):
    """Trajectories in the colours of their modes: jumps dashed, dots at the starts, arrows."""

    def __init__(self, axes: Axes, plane: Plane, runs: Run | Runs, bold: bool = False):
        super().__init__(axes, plane)
        width, z = (2.2, 5.0) if bold else (0.9, 3.0)
        look = {"lw": 1.1 if bold else 0.6, "alpha": 0.8 if bold else 0.5, "ls": (0, (3, 2))}
        self.jumps = self._stroke(color=INK, zorder=z - 0.1, **look)
        colors = list(self.colors.values())
        if len(colors) == 1 and bold:
            colors = [INK]
        # the colours of modes are alike in grey print
        self.dashes = [DASHES[k % len(DASHES)] if bold else "-" for k in range(len(colors))]
        look = {"lw": width, "alpha": 1.0 if bold else 0.85, "zorder": z}
        if isinstance(runs, Runs):
            # Strokes of their own: one that crosses itself a thousand times takes far longer
            look |= {"capstyle": "round", "joinstyle": "round"}
            self.lines = [axes.add_artist(LineCollection([], colors=[c], **look)) for c in colors]
            self.artists += self.lines
        else:
            look |= {"dash_capstyle": "butt"}
            pairs = zip(colors, self.dashes, strict=True)
            self.lines = [self._stroke(color=color, ls=dash, **look) for color, dash in pairs]
        self.heads = [area(axes, facecolor=color, lw=0, zorder=z + 0.1) for color in colors]
        self.artists += self.heads
        look = {"ms": 6 if bold else 3.2, "mfc": "white", "mec": INK, "mew": 1.3 if bold else 0.8}
        self.starts = self._stroke(ls="none", marker="o", zorder=z + 0.2, **look)
        self.size = 0.034 if bold else 0.024
        self.update(runs)

    def redo(self) -> None:
        self.update(self.runs)

    def points(self) -> list[np.ndarray]:
        """What lies on the picture, as places: at most 2000."""
        x, y = np.ravel(self.runs[self.plane.x]), np.ravel(self.runs[self.plane.y])
        few = slice(None, None, max(1, len(x) // 2000))
        return [np.column_stack([x[few], y[few]])]

    def update(self, run: Run | Runs) -> None:
        """layer.update(runs): other trajectories in the same artists."""
        runs = self.runs = run
        X, Y = runs[self.plane.x], runs[self.plane.y]
        t, modes = runs.t, runs.mode_index
        if isinstance(runs, Run):
            X, Y, t, modes = X[None], Y[None], t[None], modes[None]
        self.starts.set_data(X[:, 0], Y[:, 0])
        self._put_arrows(X, Y, modes)
        # no lane ends early, none has an event: as most of them
        if len(self.lines) == 1 and not modes.any() and not (t[:, 1:] == t[:, :-1]).any():
            self.jumps.set_data([], [])
            return self._put(self.lines[0], list(np.stack([X, Y], axis=2)))
        gap = np.full((len(X), 1), np.nan)
        x, y, time = (np.hstack([a, gap]).ravel() for a in (X, Y, t))
        mode = np.hstack([modes, np.full((len(X), 1), -1)]).ravel()
        at = jumps(time, x, y)
        self.jumps.set_data(segments(x[at], x[at + 1]), segments(y[at], y[at + 1]))
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
            line.set_data(*strung(curves))

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
        # of each trajectory and share
        k = np.minimum((way[:, None] < shares[:, None]).sum(axis=2), step.shape[1] - 1)
        long = np.take_along_axis(step, k, axis=1)
        use = (way[:, -1:] > shares + size) & (long > 0) & (long < 0.2)
        at = np.nonzero(use)[0], k[use]
        across = np.column_stack([dx[at], dy[at]]) / step[at][:, None]
        tip = np.column_stack([x[at], y[at]]) + 0.5 * size * across
        side = 0.38 * size * np.column_stack([-across[:, 1], across[:, 0]])
        back = tip - size * across
        corners = self._place(np.stack([tip, back + side, back - side, tip], axis=1) / (shape, 1))
        for i, head in enumerate(self.heads):
            mine = corners[modes[at] == i]
            reshape(head, Path(mine.reshape(-1, 2), np.tile(_TRIANGLE, len(mine))))

    def legend(self) -> list[tuple[Artist, str]]:
        if len(self.colors) == 1:
            return []
        looks = zip(self.colors.items(), self.dashes, strict=True)
        return [
            (Line2D([], [], color=color, lw=1.8, ls=dash, gid=MODE), mode)
            for (mode, color), dash in looks
        ]


_TRIANGLE = closed(np.zeros((3, 2))).codes


def _samples(lines: Sequence[Line2D], names: Sequence[str]) -> list[tuple[Artist, str]]:
    """What a legend says of lines that there are."""
    pairs = zip(lines, names, strict=True)
    return [(sample(line), name) for line, name in pairs if len(line.get_xdata())]


def strung(curves: Sequence[np.ndarray]) -> np.ndarray:
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
