"""Drawn sketches: mechanisms and block diagrams in about ten lines.

s = Sketch(8, 2.6)
s.ground((0.5, 0.6), (7.5, 0.6))
m = s.block((2.5, 1.1), 1.4, 1.0, "$m$")
k = s.spring(m.right, (6.0, 1.1), "$k$")
s.arrow(k.end, (7.0, 1.1), "$V_p$")
s                                         # as the last line of a cell: the picture
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import cos, hypot, radians, sin
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle
from matplotlib.text import Text

from ..model import ModelError
from .figure import COLORS, FAINT, HALO, INK, figure, style
from .view import View

__all__ = ["Box", "Motion", "Sketch", "Span"]

Point = tuple[float, float]
FILL = "#EAF2F8"
#: little characteristics for a box, in the square −1 … 1; NaN lifts the pen
CHARACTERISTICS: dict[str, Sequence[Point]] = {
    "relay": ((-1, -0.7), (0, -0.7), (0, 0.7), (1, 0.7)),
    "dead zone": ((-1, -0.7), (-0.4, 0), (0.4, 0), (1, 0.7)),
    "relay with dead zone": (
        (-1, -0.7),
        (-0.35, -0.7),
        (-0.35, 0),
        (0.35, 0),
        (0.35, 0.7),
        (1, 0.7),
    ),
    "saturation": ((-1, -0.7), (-0.45, -0.7), (0.45, 0.7), (1, 0.7)),
    "hysteresis": ((-1, -0.7), (0.4, -0.7), (0.4, 0.7), (1, 0.7), (-0.4, 0.7), (-0.4, -0.7)),
    "friction": (
        (-1, -0.6),
        (-0.5, -0.45),
        (-0.12, -0.7),
        (0, -0.85),
        (0, 0.85),
        (0.12, 0.7),
        (0.5, 0.45),
        (1, 0.6),
    ),
}


@dataclass(frozen=True)
class Box:
    """Where a piece stands.

    box.left, .right, .top, .bottom, .center are points to attach the next piece to.
    """

    center: Point
    width: float
    height: float

    @property
    def left(self) -> Point:
        return self.center[0] - self.width / 2, self.center[1]

    @property
    def right(self) -> Point:
        return self.center[0] + self.width / 2, self.center[1]

    @property
    def top(self) -> Point:
        return self.center[0], self.center[1] + self.height / 2

    @property
    def bottom(self) -> Point:
        return self.center[0], self.center[1] - self.height / 2


@dataclass(frozen=True)
class Span:
    """A piece between two points: span.start, .end, .middle."""

    start: Point
    end: Point

    @property
    def middle(self) -> Point:
        return (self.start[0] + self.end[0]) / 2, (self.start[1] + self.end[1]) / 2


class Sketch(View):
    """Sketch(width, height): pieces of a drawing in words.

    An empty sketch, coordinates in inches from the lower left corner, y upwards.

    Every method adds a piece at points (x, y) and returns its Box or Span, whose points (m.right,
    k.end) take the next piece. Labels may hold mathtext ("$k_1$") and stand on a white halo. Angles
    are in degrees. `sketch.axes` is open to all of Matplotlib.
    """

    def __init__(self, width: float = 8.0, height: float = 3.0):
        self.figure = figure(0, width=width, height=height)
        self.figure.set_layout_engine("none")
        with style():
            self.axes = self.figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(0, width), ylim=(0, height))
        self.axes.axis("off")
        self.artists = []

    def update(self, run: Any) -> None:
        raise ModelError("a sketch does not show a run: it has nothing to update")

    # -- plain pieces ------------------------------------------------------------------------------

    def line(
        self, *points: Point, color: str = INK, width: float = 1.4, dashed: bool = False
    ) -> Span:
        """s.line((1, 1), (2, 1), (2, 2)): a stroke through the points."""
        _points(*points)
        self.axes.add_line(
            Line2D(
                *zip(*points, strict=True),
                color=color,
                linewidth=width,
                linestyle=(0, (4, 3)) if dashed else "-",
                zorder=2,
            )
        )  # type: ignore[arg-type]
        return Span(points[0], points[-1])

    def text(
        self,
        at: Point,
        label: str,
        color: str = INK,
        size: float = 12.0,
        align: str = "center",
        vertical: str = "center",
        angle: float = 0.0,
        halo: bool = True,
    ) -> Sketch:
        """s.text((3, 1), "rough ground"): free words or a formula, on a white halo."""
        _points(at)
        with style():
            self.axes.text(
                *at,
                label.replace("\\frac", "\\dfrac"),  # as large as the words beside it
                color=color,
                fontsize=size,
                ha=align,
                va=vertical,
                rotation=angle,
                rotation_mode="anchor",
                zorder=9,
                path_effects=HALO if halo else (),
            )
        return self

    def arrow(
        self, start: Point, end: Point, label: str = "", color: str = COLORS[1], side: str = "end"
    ) -> Span:
        """s.arrow(m.right, (5, 1), "$F$"): a force or velocity.

        The label stands at the "end", "above" or "below" the middle.
        """
        self._arrow((start, end), color, 2.0)
        self._label_along(start, end, label, side, 0.2, color)
        return Span(start, end)

    def axis(self, origin: Point, end: Point, label: str = "") -> Span:
        """s.axis((1, 1), (4, 1), "$x$"): a thin coordinate axis with an arrow head."""
        self._arrow((origin, end), INK, 0.9, head=7)
        self._label_along(origin, end, label, "end", 0.17, INK)
        return Span(origin, end)

    def dimension(self, start: Point, end: Point, label: str = "", offset: float = 0.0) -> Span:
        """s.dimension((1, 1), (4, 1), "$x$", offset=-0.4).

        A length with ticks, moved by `offset` to the left of its direction.
        """
        (ax, ay), (nx, ny) = _direction(start, end)
        a, b = ((x + offset * nx, y + offset * ny) for x, y in (start, end))
        for point, moved in ((start, a), (end, b)):
            if offset:
                reach = offset + np.sign(offset) * 0.08
                self.line(
                    point, (point[0] + reach * nx, point[1] + reach * ny), color=FAINT, width=0.8
                )
            else:
                self.line(
                    (moved[0] - 0.09 * nx, moved[1] - 0.09 * ny),
                    (moved[0] + 0.09 * nx, moved[1] + 0.09 * ny),
                    width=0.9,
                )
        self.axes.add_patch(
            FancyArrowPatch(
                a,
                b,
                arrowstyle="<|-|>",
                mutation_scale=8,
                color=INK,
                linewidth=0.9,
                shrinkA=0,
                shrinkB=0,
                zorder=3,
            )
        )
        if label:  # on the far side of an offset, else above or to the right
            side = np.sign(offset) if offset else 1.0 if (ny, nx) > (0, 0) else -1.0
            away = 0.17 if abs(ax) > 0.5 else 0.22
            self.text(
                ((a[0] + b[0]) / 2 + side * away * nx, (a[1] + b[1]) / 2 + side * away * ny), label
            )
        return Span(a, b)

    # -- mechanisms --------------------------------------------------------------------------------

    def ground(self, start: Point, end: Point) -> Span:
        """s.ground((0, 1), (6, 1)).

        A fixed surface, hatched on the right as one goes from start to end (here below).
        """
        (ax, ay), (nx, ny) = _direction(start, end)
        length = hypot(end[0] - start[0], end[1] - start[1])
        along = np.linspace(0.1, length, max(2, round(length / 0.14)))
        depth = 0.13
        x = np.column_stack(
            [
                start[0] + along * ax,
                start[0] + (along - depth) * ax - depth * nx,
                np.full(len(along), np.nan),
            ]
        ).ravel()
        y = np.column_stack(
            [
                start[1] + along * ay,
                start[1] + (along - depth) * ay - depth * ny,
                np.full(len(along), np.nan),
            ]
        ).ravel()
        self.axes.add_line(Line2D(x, y, color=FAINT, linewidth=0.9, zorder=1))
        return self.line(start, end, width=1.6)

    def wall(self, foot: Point, height: float, side: str = "left") -> Span:
        """s.wall((1, 0.5), 2): an upright fixed wall, hatched on its "left" or "right" side."""
        x, y = foot
        return (
            self.ground((x, y + height), (x, y))
            if side == "left"
            else self.ground((x, y), (x, y + height))
        )

    def block(
        self,
        center: Point,
        width: float,
        height: float,
        label: str = "",
        fill: str = FILL,
        angle: float = 0.0,
    ) -> Box:
        """s.block((2.5, 1.1), 1.4, 1.0, "$m$").

        A body, or a block of a diagram, round its centre; turned by `angle`.
        """
        _points(center)
        x, y = center
        self.axes.add_patch(
            Rectangle(
                (x - width / 2, y - height / 2),
                width,
                height,
                angle=angle,
                rotation_point="center",
                facecolor=fill,
                edgecolor=INK,
                linewidth=1.5,
                zorder=4,
            )
        )
        if label:
            self.text(center, label, size=13, angle=angle, halo=False)
        return Box(center, width, height)

    def ball(self, center: Point, radius: float = 0.2, label: str = "", fill: str = FILL) -> Box:
        """s.ball((3, 2), 0.2, "$m$"): a round body."""
        _points(center)
        self.axes.add_patch(
            Circle(center, radius, facecolor=fill, edgecolor=INK, linewidth=1.5, zorder=4)
        )
        if label:
            self.text(center, label, halo=False)
        return Box(center, 2 * radius, 2 * radius)

    def spring(
        self,
        start: Point,
        end: Point,
        label: str = "",
        coils: int = 6,
        width: float = 0.3,
        side: str = "above",
    ) -> Span:
        """s.spring(m.right, (6, 1), "$k$"): a zigzag with straight ends.

        The label stands "above" (or right of an upright one) or "below" it.
        """
        along, across = _direction(start, end)
        length = hypot(end[0] - start[0], end[1] - start[1])
        lead = min(0.18 * length, 0.3)
        turns = np.concatenate(
            [
                [0, lead],
                lead + (np.arange(2 * coils) + 0.5) / (2 * coils) * (length - 2 * lead),
                [length - lead, length],
            ]
        )
        swing = np.concatenate(
            [[0, 0], np.where(np.arange(2 * coils) % 2, -0.5, 0.5) * width, [0, 0]]
        )
        self.axes.add_line(
            Line2D(
                start[0] + turns * along[0] + swing * across[0],
                start[1] + turns * along[1] + swing * across[1],
                color=INK,
                linewidth=1.4,
                solid_joinstyle="round",
                zorder=3,
            )
        )
        self._label_along(start, end, label, side, width / 2 + 0.2, INK)
        return Span(start, end)

    def damper(
        self, start: Point, end: Point, label: str = "", width: float = 0.36, side: str = "above"
    ) -> Span:
        """s.damper((1, 1), m.left, "$c$"): a dashpot, its cup towards the start.

        `side` as for a spring.
        """
        (ax, ay), (nx, ny) = _direction(start, end)
        length = hypot(end[0] - start[0], end[1] - start[1])
        cup, half = min(0.4, 0.45 * length), width / 2

        def place(a: float, b: float) -> Point:
            return start[0] + a * ax + b * nx, start[1] + a * ay + b * ny

        back, front = (length - cup) / 2, (length + cup) / 2
        self.line(place(0, 0), place(back, 0))
        self.line(place(front, half), place(back, half), place(back, -half), place(front, -half))
        middle = (back + front) / 2 + 0.03
        self.line(place(middle, 0.8 * half), place(middle, -0.8 * half), width=2.4)
        self.line(place(middle, 0), place(length, 0))
        self._label_along(start, end, label, side, half + 0.2, INK)
        return Span(start, end)

    def rod(self, start: Point, end: Point, label: str = "", width: float = 3.0) -> Span:
        """s.rod((2, 3), (3, 1), "$l$"): a stiff rod with a pin at its start."""
        self.line(start, end, width=width)
        self.axes.add_patch(
            Circle(start, 0.06, facecolor="white", edgecolor=INK, linewidth=1.3, zorder=5)
        )
        self._label_along(start, end, label, "above", 0.22, INK)
        return Span(start, end)

    def pendulum(
        self,
        pivot: Point,
        length: float,
        angle: float,
        label: str = "",
        rod: str = "$l$",
        bob: str = "",
        radius: float = 0.18,
    ) -> Box:
        """s.pendulum((3, 2.6), 1.8, 30, "$\\\\varphi$", bob="$m$").

        Pivot, rod, bob, vertical and the angle from it (degrees). Returns the bob's Box.
        """
        x, y = pivot
        end = (x + length * sin(radians(angle)), y - length * cos(radians(angle)))
        way = -1.0 if abs(angle) > 90 else 1.0  # an inverted pendulum's angle is drawn from above
        self.line((x, y), (x, y - way * (length + 0.1)), color=FAINT, width=0.9, dashed=True)
        low, high = sorted(
            (-90.0 * way, angle - 90.0 if way > 0 or angle > 0 else angle + 270.0)
        )  # of the arc, from the horizontal
        reach = 0.45 * length
        self.axes.add_patch(
            Arc(
                pivot,
                2 * reach,
                2 * reach,
                theta1=low,
                theta2=high,
                color=COLORS[1],
                linewidth=1.3,
                zorder=3,
            )
        )
        if label:
            middle = radians((low + high) / 2)
            self.text(
                (x + (reach + 0.2) * cos(middle), y + (reach + 0.2) * sin(middle)),
                label,
                color=COLORS[1],
            )
        self.rod(pivot, end)
        if rod:
            nx, ny = cos(radians(angle)), sin(radians(angle))
            out = way if angle >= 0 else -way  # on the side away from the angle
            self.text(
                (
                    x + 0.72 * (end[0] - x) + 0.2 * out * nx,
                    y + 0.72 * (end[1] - y) + 0.2 * out * ny,
                ),
                rod,
            )
        return self.ball(end, radius, bob)

    # -- block diagrams ----------------------------------------------------------------------------

    def integrator(self, center: Point, label: str = "$\\int$", size: float = 0.7) -> Box:
        """s.integrator((5, 1)): a square block with an integral sign."""
        return self.block(center, size, size, label, fill="white")

    def sum(self, center: Point, signs: str = "+ −", radius: float = 0.16) -> Box:
        """s.sum((2, 1), "+ −"): a summing point.

        The signs stand at its left and lower input (a third one above).
        """
        self.axes.add_patch(
            Circle(center, radius, facecolor="white", edgecolor=INK, linewidth=1.4, zorder=4)
        )
        x, y = center
        for sign, (dx, dy) in zip(
            signs.split(),
            ((-radius - 0.13, 0.14), (0.15, -radius - 0.14), (0.15, radius + 0.14)),
            strict=False,
        ):
            self.text((x + dx, y + dy), sign.replace("-", "−"), size=11)
        return Box(center, 2 * radius, 2 * radius)

    def connect(self, *points: Point, label: str = "", dot: bool = False) -> Span:
        """s.connect(a.right, (4, 2), b.left, label="$x$").

        A signal line with an arrow at its end; turns at right angles where points are not in line.

        dot=True marks the start as a branch. The label stands above the longest stretch that is
        level.
        """
        _points(*points)
        path = [points[0]]
        for x, y in points[1:]:
            a, b = path[-1]
            if abs(a - x) > 1e-9 and abs(b - y) > 1e-9:
                path.append((x, b))  # first level, then upright
            path.append((x, y))
        if len(path) > 2:
            self.line(*path[:-1], width=1.3)
        self._arrow(path[-2:], INK, 1.3, head=11)
        if dot:
            self.axes.add_patch(Circle(points[0], 0.045, color=INK, zorder=5))
        if label:
            a, b = max(
                zip(path[:-1], path[1:], strict=True), key=lambda ab: abs(ab[1][0] - ab[0][0])
            )
            self.text(((a[0] + b[0]) / 2, a[1] + 0.17), label)
        return Span(points[0], points[-1])

    def characteristic(
        self,
        center: Point,
        kind: str | Sequence[Point] = "relay",
        width: float = 1.0,
        height: float = 0.8,
        label: str = "",
    ) -> Box:
        """s.characteristic((3, 1), "hysteresis").

        A block with a little characteristic drawn inside; the label stands above it.

        kind: one of CHARACTERISTICS, or points in the square −1 … 1. Raises ModelError for an
        unknown kind.
        """
        if isinstance(kind, str) and kind not in CHARACTERISTICS:
            raise ModelError(
                f"there is no little characteristic {kind!r}; there are "
                f"{', '.join(CHARACTERISTICS)}, or give points"
            )
        shape = np.array(CHARACTERISTICS[kind] if isinstance(kind, str) else kind, dtype=float)
        box = self.block(center, width, height, fill="white")
        x, y = center
        a, b = 0.42 * width, 0.42 * height
        for ends in (((x - a, y), (x + a, y)), ((x, y - b), (x, y + b))):
            self.axes.add_line(
                Line2D(*zip(*ends, strict=True), color=FAINT, linewidth=0.7, zorder=5)
            )  # type: ignore[arg-type]
        self.axes.add_line(
            Line2D(
                x + 0.9 * a * shape[:, 0],
                y + b * shape[:, 1],
                color=COLORS[0],
                linewidth=1.8,
                zorder=6,
                solid_joinstyle="miter",
            )
        )
        if label:
            self.text((x, box.top[1] + 0.18), label)
        return box

    def switch(self, start: Point, end: Point, label: str = "", closed: bool = False) -> Span:
        """s.switch((1, 2), (2, 2), "$S$"): a switch in a line, open or closed."""
        (ax, ay), (nx, ny) = _direction(start, end)
        length = hypot(end[0] - start[0], end[1] - start[1])
        gap = min(0.5, 0.5 * length)
        a, b = (length - gap) / 2, (length + gap) / 2
        left, right = (start[0] + a * ax, start[1] + a * ay), (start[0] + b * ax, start[1] + b * ay)
        lift = 0.0 if closed else 0.45 * gap
        self.line(start, left)
        self.line(right, end)
        self.line(
            left,
            (
                right[0] - 0.1 * gap * ax * (not closed) + lift * nx,
                right[1] - 0.1 * gap * ay * (not closed) + lift * ny,
            ),
            width=1.8,
        )
        for point in (left, right):
            self.axes.add_patch(
                Circle(point, 0.05, facecolor="white", edgecolor=INK, linewidth=1.2, zorder=5)
            )
        self._label_along(start, end, label, "above", lift + 0.2, INK)
        return Span(start, end)

    # -- helpers -----------------------------------------------------------------------------------

    def _arrow(self, ends: Sequence[Point], color: str, width: float, head: float = 14) -> None:
        _points(*ends)
        self.axes.add_patch(
            FancyArrowPatch(
                *ends,
                arrowstyle="-|>,head_width=0.28,head_length=0.6",
                mutation_scale=head,
                color=color,
                linewidth=width,
                shrinkA=0,
                shrinkB=0,
                zorder=5,
                joinstyle="miter",
                capstyle="butt",
            )
        )

    def _label_along(
        self, start: Point, end: Point, label: str, side: str, away: float, color: str
    ) -> None:
        if not label:
            return
        (ax, ay), (nx, ny) = _direction(start, end)
        if side == "end":
            x, y = end[0] + 0.1 * ax, end[1] + 0.1 * ay
            upright = abs(ay) > abs(ax)
            self.text(
                (x, y + (0.08 if ay > 0 else -0.08) * upright),
                label,
                color=color,
                align="center" if upright else "left" if ax > 0 else "right",
            )
            return
        if ny < 0 or (ny == 0 and nx < 0):  # "above" is above, or to the right of an upright piece
            nx, ny = -nx, -ny
        sign = -1 if side == "below" else 1
        self.text(
            (
                (start[0] + end[0]) / 2 + sign * away * nx,
                (start[1] + end[1]) / 2 + sign * away * ny,
            ),
            label,
            color=color,
        )


def _points(*points: Point) -> None:
    for point in points:
        if not (
            isinstance(point, Sequence | np.ndarray)
            and len(point) == 2
            and np.all(np.isfinite(np.asarray(point, dtype=float)))
        ):
            raise ModelError(f"a point of a sketch is a pair (x, y) of numbers, not {point!r}")


def _direction(start: Point, end: Point) -> tuple[Point, Point]:
    """Unit vectors along start → end and to its left. ModelError when the points coincide."""
    _points(start, end)
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = hypot(dx, dy)
    if length < 1e-9:
        raise ModelError(f"a piece of a sketch needs two different points, not {start!r} twice")
    return (dx / length, dy / length), (-dy / length, dx / length)


class Motion(View):
    """Motion(axes, draw, width, height): a sketch that moves with the run, in axes of a figure.

    It goes into the list that a panel's `draw` returns.

        def draw(sketch, s):        # s.t, s.mode, states and outputs of that instant, and s.p
            sketch.pendulum((3, 2.5), 2, degrees(s.phi))
        Motion(fig.axes[2], draw, 6, 3)

    Of several models, s["plain"] is the instant of each.

    The sketch is `width` × `height`, in coordinates of its own, y upwards; it has the methods of a
    Sketch. Labels cost time: one or two.
    """

    ready = False

    def __init__(
        self,
        axes: Axes,
        draw: Callable[[Sketch, Any], object],
        width: float = 6.0,
        height: float = 3.0,
    ):
        self.axes, self.figure, self.draw = axes, axes.get_figure(), draw
        axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
        axes.axis("off")
        self.pieces = _Pieces(axes)
        axes.add_artist(self.pieces)
        self.artists = [self.pieces]

    def update(self, run: Any) -> None:
        self.at(run, run.t[0])

    def at(self, run: Any, t: float) -> None:
        sketch = Sketch.__new__(Sketch)  # on these axes, not on a figure of its own
        self.pieces.clear()
        sketch.axes, sketch.figure, sketch.artists = self.pieces, self.figure, []
        if isinstance(run, Mapping):
            now: Any = {
                name: SimpleNamespace(**values, t=t, p=run[name].p)
                for name, values in run.at(t).items()
            }
        else:
            now = SimpleNamespace(**run.at(t), t=t, p=run.p)
        self.draw(sketch, now)
        self.pieces.stale = True


class _Pieces(Artist):
    """Many artists as one, that can be replaced without declaring the axes changed.

    Takes what a Sketch adds.
    """

    def __init__(self, axes: Axes):
        super().__init__()
        self.host, self.all, self.wide = axes, [], 0.0
        self.set_in_layout(False)

    def clear(self) -> None:
        self.all = []

    def add_line(self, artist: Any) -> Any:
        artist.set_figure(self.host.get_figure())
        artist.axes, artist.stale_callback = self.host, None
        if not artist.is_transform_set():
            artist.set_transform(self.host.transData)
        self.all.append(artist)
        return artist

    add_patch = add_artist = add_line

    def text(self, x: float, y: float, s: str, **options: Any) -> Any:
        return self.add_line(Text(x, y, s, **options))

    def draw(self, renderer: Any) -> None:
        self._fit(renderer)
        for artist in sorted(self.all, key=lambda artist: artist.get_zorder()):
            artist.draw(renderer)
        self.stale = False

    def _fit(self, renderer: Any) -> None:
        """Where large type makes words meet: smaller, down to what they are to the sketch at first.

        That is the type of the axes in which it was drawn first.
        """
        wide = self.host.bbox.width / self.host.get_figure().dpi
        self.wide = self.wide or wide
        words = [artist for artist in self.all if isinstance(artist, Text)]
        sizes = [vars(word).setdefault("given", word.get_fontsize()) for word in words]
        for scale in np.unique(np.linspace(1.0, min(1.0, wide / self.wide), 5))[::-1]:
            for word, size in zip(words, sizes, strict=True):
                word.set_fontsize(size * scale)
            boxes = [word.get_window_extent(renderer) for word in words]
            if not any(a.overlaps(b) for a, b in combinations(boxes, 2)):
                break
