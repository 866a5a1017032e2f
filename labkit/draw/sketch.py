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
from itertools import combinations, pairwise
from math import cos, hypot, radians, sin
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle
from matplotlib.text import Text

from ..arguments import asked, takes
from ..model import ModelError
from .figure import COLORS, FAINT, HALO, INK, figure, style
from .time import segments
from .view import View

Point = Sequence[float]
FILL = "#EAF2F8"
#: little characteristics for a box, x and y in the square −1 … 1
CHARACTERISTICS = {
    "relay": ((-1, 0, 0, 1), (-0.7, -0.7, 0.7, 0.7)),
    "dead zone": ((-1, -0.4, 0.4, 1), (-0.7, 0, 0, 0.7)),
    "relay with dead zone": ((-1, -0.35, -0.35, 0.35, 0.35, 1), (-0.7, -0.7, 0, 0, 0.7, 0.7)),
    "saturation": ((-1, -0.45, 0.45, 1), (-0.7, -0.7, 0.7, 0.7)),
    "hysteresis": ((-1, 0.4, 0.4, 1, -0.4, -0.4), (-0.7, -0.7, 0.7, 0.7, 0.7, -0.7)),
    "friction": (
        (-1, -0.5, -0.12, 0, 0, 0.12, 0.5, 1),
        (-0.6, -0.45, -0.7, -0.85, 0.85, 0.7, 0.45, 0.6),
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

    def _at(self, a: float, b: float) -> Point:
        return self.center[0] + a * self.width / 2, self.center[1] + b * self.height / 2

    left = property(lambda self: self._at(-1, 0))
    right = property(lambda self: self._at(1, 0))
    top = property(lambda self: self._at(0, 1))
    bottom = property(lambda self: self._at(0, -1))


@dataclass(frozen=True)
class Span:
    """A piece between two points: span.start, .end, .middle."""

    start: Point
    end: Point

    @property
    def middle(self) -> Point:
        return (self.start[0] + self.end[0]) / 2, (self.start[1] + self.end[1]) / 2


class _Way:
    """_Way(start, end): straight from one point to another.

    way.at(a, b) lies a further than the start and b to its left. No way leads to the same point.
    """

    def __init__(self, start: Point, end: Point):
        _points(start, end)
        (self.x, self.y), dx, dy = start, end[0] - start[0], end[1] - start[1]
        self.length = hypot(dx, dy)
        if self.length < 1e-9:
            raise ModelError(f"a piece of a sketch needs two different points, not {start!r} twice")
        self.across, self.up = dx / self.length, dy / self.length

    def at(self, a: Any, b: Any = 0.0) -> tuple[Any, Any]:
        x, y = self.across, self.up
        return self.x + a * x - b * y, self.y + a * y + b * x


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

    @asked
    def line(
        self, *points: Point, color: str = INK, width: float = 1.4, dashed: bool = False
    ) -> Span:
        """s.line((1, 1), (2, 1), (2, 2)): a stroke through the points."""
        _points(*points, least=2)
        dash = (0, (4, 3)) if dashed else "-"
        self._stroke(*zip(*points, strict=True), color=color, lw=width, ls=dash, zorder=2)
        return Span(points[0], points[-1])

    @asked
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
        words = label.replace("\\frac", "\\dfrac")  # as large as the words beside it
        look = {"color": color, "fontsize": size, "ha": align, "va": vertical, "zorder": 9}
        look |= {"rotation": angle, "rotation_mode": "anchor"}
        with style():
            self.axes.text(*at, words, path_effects=HALO if halo else (), **look)
        return self

    @asked
    def arrow(
        self, start: Point, end: Point, label: str = "", color: str = COLORS[1], side: str = "end"
    ) -> Span:
        """s.arrow(m.right, (5, 1), "$F$"): a force or velocity.

        The label stands at the "end", "above" or "below" the middle.
        """
        self._arrow(start, end, color=color, lw=2.0)
        return self._label(start, end, label, side, 0.2, color)

    @asked
    def axis(self, origin: Point, end: Point, label: str = "") -> Span:
        """s.axis((1, 1), (4, 1), "$x$"): a thin coordinate axis with an arrow head."""
        self._arrow(origin, end, lw=0.9, mutation_scale=7)
        return self._label(origin, end, label, "end", 0.17)

    @asked
    def dimension(self, start: Point, end: Point, label: str = "", offset: float = 0.0) -> Span:
        """s.dimension((1, 1), (4, 1), "$x$", offset=-0.4).

        A length with ticks, moved by `offset` to the left of its direction.
        """
        way = _Way(start, end)
        low, high = (0.0, offset + np.sign(offset) * 0.08) if offset else (-0.09, 0.09)
        look = {"color": FAINT, "width": 0.8} if offset else {"width": 0.9}
        for a in (0.0, way.length):
            self.line(way.at(a, low), way.at(a, high), **look)
        ends = way.at(0.0, offset), way.at(way.length, offset)
        look = {"joinstyle": "round", "capstyle": "round", "zorder": 3, "mutation_scale": 8}
        self._arrow(*ends, arrowstyle="<|-|>", lw=0.9, **look)
        if label:  # on the far side of an offset, else above or to the right
            side = np.sign(offset) if offset else 1.0 if (way.across, -way.up) > (0, 0) else -1.0
            away = 0.17 if abs(way.across) > 0.5 else 0.22
            self.text(way.at(way.length / 2, offset + side * away), label)
        return Span(*ends)

    # -- mechanisms --------------------------------------------------------------------------------

    @asked
    def ground(self, start: Point, end: Point) -> Span:
        """s.ground((0, 1), (6, 1)).

        A fixed surface, hatched on the right as one goes from start to end (here below).
        """
        way, depth = _Way(start, end), 0.13
        along = np.linspace(0.1, way.length, max(2, round(way.length / 0.14)))
        pairs = zip(way.at(along), way.at(along - depth, -depth), strict=True)
        self._stroke(*(segments(a, b) for a, b in pairs), color=FAINT, lw=0.9, zorder=1)
        return self.line(start, end, width=1.6)

    @asked
    def wall(self, foot: Point, height: float, side: Literal["left", "right"] = "left") -> Span:
        """s.wall((1, 0.5), 2): an upright fixed wall, hatched on its "left" or "right" side."""
        x, y = foot
        ends = {"left": ((x, y + height), (x, y)), "right": ((x, y), (x, y + height))}
        return self.ground(*ends[side])

    @asked
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
        corner = center[0] - width / 2, center[1] - height / 2
        look = {"facecolor": fill, "edgecolor": INK, "lw": 1.5, "zorder": 4}
        turn = {"angle": angle, "rotation_point": "center"}
        self.axes.add_patch(Rectangle(corner, width, height, **turn, **look))
        if label:
            self.text(center, label, size=13, angle=angle, halo=False)
        return Box(center, width, height)

    @asked
    def ball(self, center: Point, radius: float = 0.2, label: str = "", fill: str = FILL) -> Box:
        """s.ball((3, 2), 0.2, "$m$"): a round body."""
        box = self._circle(center, radius, 1.5, 4, fill)
        if label:
            self.text(center, label, halo=False)
        return box

    @asked
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
        way, turns = _Way(start, end), np.arange(2 * coils)
        length, lead = way.length, min(0.18 * way.length, 0.3)
        along = lead + (turns + 0.5) / (2 * coils) * (length - 2 * lead)
        swing = np.where(turns % 2, -0.5, 0.5) * width
        path = way.at(np.r_[0, lead, along, length - lead, length], np.r_[0, 0, swing, 0, 0])
        self._stroke(*path, color=INK, lw=1.4, solid_joinstyle="round", zorder=3)
        return self._label(start, end, label, side, width / 2 + 0.2)

    @asked
    def damper(
        self, start: Point, end: Point, label: str = "", width: float = 0.36, side: str = "above"
    ) -> Span:
        """s.damper((1, 1), m.left, "$c$"): a dashpot, its cup towards the start.

        `side` as for a spring.
        """
        way, half = _Way(start, end), width / 2
        cup = min(0.4, 0.45 * way.length)
        back, front = (way.length - cup) / 2, (way.length + cup) / 2
        self.line(start, way.at(back))
        corners = (front, half), (back, half), (back, -half), (front, -half)
        self.line(*(way.at(*corner) for corner in corners))
        middle = (back + front) / 2 + 0.03
        self.line(way.at(middle, 0.8 * half), way.at(middle, -0.8 * half), width=2.4)
        self.line(way.at(middle), end)
        return self._label(start, end, label, side, half + 0.2)

    @asked
    def rod(self, start: Point, end: Point, label: str = "", width: float = 3.0) -> Span:
        """s.rod((2, 3), (3, 1), "$l$"): a stiff rod with a pin at its start."""
        self.line(start, end, width=width)
        self._circle(start, 0.06, 1.3)
        return self._label(start, end, label, "above", 0.22)

    @asked
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
        nx, ny = cos(radians(angle)), sin(radians(angle))  # across the rod
        end = (x + length * ny, y - length * nx)
        way = -1.0 if abs(angle) > 90 else 1.0  # an inverted pendulum's angle is drawn from above
        self.line((x, y), (x, y - way * (length + 0.1)), color=FAINT, width=0.9, dashed=True)
        # of the arc, from the horizontal
        turned = angle - 90.0 if way > 0 or angle > 0 else angle + 270.0
        low, high = sorted((-90.0 * way, turned))
        size, look = 0.9 * length, {"color": COLORS[1], "lw": 1.3, "zorder": 3}
        self.axes.add_patch(Arc(pivot, size, size, theta1=low, theta2=high, **look))
        if label:
            middle, reach = radians((low + high) / 2), 0.45 * length + 0.2
            at = x + reach * cos(middle), y + reach * sin(middle)
            self.text(at, label, color=COLORS[1])
        self.rod(pivot, end)
        if rod:
            out = 0.2 * (way if angle >= 0 else -way)  # on the side away from the angle
            at = x + 0.72 * (end[0] - x) + out * nx, y + 0.72 * (end[1] - y) + out * ny
            self.text(at, rod)
        return self.ball(end, radius, bob)

    # -- block diagrams ----------------------------------------------------------------------------

    @asked
    def integrator(self, center: Point, label: str = "$\\int$", size: float = 0.7) -> Box:
        """s.integrator((5, 1)): a square block with an integral sign."""
        return self.block(center, size, size, label, fill="white")

    @asked
    def sum(self, center: Point, signs: str = "+ −", radius: float = 0.16) -> Box:
        """s.sum((2, 1), "+ −"): a summing point.

        The signs stand at its left and lower input (a third one above).
        """
        box, (x, y) = self._circle(center, radius, 1.4, 4), center
        places = ((-radius - 0.13, 0.14), (0.15, -radius - 0.14), (0.15, radius + 0.14))
        for sign, (dx, dy) in zip(signs.split(), places, strict=False):
            self.text((x + dx, y + dy), sign.replace("-", "−"), size=11)
        return box

    @asked
    def connect(self, *points: Point, label: str = "", dot: bool = False) -> Span:
        """s.connect(a.right, (4, 2), b.left, label="$x$").

        A signal line with an arrow at its end; turns at right angles where points are not in line.

        dot=True marks the start as a branch. The label stands above the longest stretch that is
        level.
        """
        _points(*points, least=2)
        path = [points[0]]
        for x, y in points[1:]:
            a, b = path[-1]
            if abs(a - x) > 1e-9 and abs(b - y) > 1e-9:
                path.append((x, b))  # first level, then upright
            path.append((x, y))
        if len(path) > 2:
            self.line(*path[:-1], width=1.3)
        self._arrow(*path[-2:], lw=1.3, mutation_scale=11)
        if dot:
            self._circle(points[0], 0.045, 1.0, fill=INK)
        if label:
            a, b = max(pairwise(path), key=lambda ab: abs(ab[1][0] - ab[0][0]))
            self.text(((a[0] + b[0]) / 2, a[1] + 0.17), label)
        return Span(points[0], points[-1])

    @asked
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
        u, v = CHARACTERISTICS[kind] if isinstance(kind, str) else zip(*kind, strict=True)
        box = self.block(center, width, height, fill="white")
        (x, y), a, b = center, 0.42 * width, 0.42 * height
        for ends in (((x - a, x + a), (y, y)), ((x, x), (y - b, y + b))):
            self._stroke(*ends, color=FAINT, lw=0.7, zorder=5)
        look = {"color": COLORS[0], "lw": 1.8, "zorder": 6, "solid_joinstyle": "miter"}
        self._stroke(x + 0.9 * a * np.array(u), y + b * np.array(v), **look)
        if label:
            self.text((x, box.top[1] + 0.18), label)
        return box

    @asked
    def switch(self, start: Point, end: Point, label: str = "", closed: bool = False) -> Span:
        """s.switch((1, 2), (2, 2), "$S$"): a switch in a line, open or closed."""
        way = _Way(start, end)
        gap = min(0.5, 0.5 * way.length)
        a, b = (way.length - gap) / 2, (way.length + gap) / 2
        lift = 0.0 if closed else 0.45 * gap
        self.line(start, way.at(a))
        self.line(way.at(b), end)
        self.line(way.at(a), way.at(b - 0.1 * gap * (not closed), lift), width=1.8)
        for place in (a, b):
            self._circle(way.at(place), 0.05, 1.2)
        return self._label(start, end, label, "above", lift + 0.2)

    # -- helpers -----------------------------------------------------------------------------------

    def _stroke(self, x: Any, y: Any, **look: Any) -> None:
        self.axes.add_line(Line2D(x, y, **look))

    def _circle(
        self, center: Point, radius: float, width: float, above: int = 5, fill: str = "white"
    ) -> Box:
        _points(center)
        look = {"facecolor": fill, "edgecolor": INK, "lw": width, "zorder": above}
        self.axes.add_patch(Circle(center, radius, **look))
        return Box(center, 2 * radius, 2 * radius)

    def _arrow(self, start: Point, end: Point, **look: Any) -> None:
        _points(start, end)
        options = {"arrowstyle": "-|>,head_width=0.28,head_length=0.6", "mutation_scale": 14}
        options |= {"color": INK, "shrinkA": 0, "shrinkB": 0, "zorder": 5}
        options |= {"joinstyle": "miter", "capstyle": "butt", **look}
        self.axes.add_patch(FancyArrowPatch(start, end, **options))

    def _label(
        self, start: Point, end: Point, label: str, side: str, away: float, color: str = INK
    ) -> Span:
        """The label of a piece between two points."""
        if side not in ("end", "above", "below"):
            raise ModelError(f"side of a label is 'end', 'above' or 'below', not {side!r}")
        if not label:
            return Span(start, end)
        way, align = _Way(start, end), "center"
        if side == "end":
            upright = abs(way.up) > abs(way.across)
            x, y = way.at(way.length + 0.1)
            y += (0.08 if way.up > 0 else -0.08) * upright
            align = "center" if upright else "left" if way.across > 0 else "right"
        else:  # "above" is above, or to the right of an upright piece
            left = 1 if (way.across, -way.up) > (0, 0) else -1
            x, y = way.at(way.length / 2, left * (-away if side == "below" else away))
        self.text((x, y), label, color=color, align=align)
        return Span(start, end)


def _points(*points: Point, least: int = 1) -> None:
    for point in points:
        if not (
            isinstance(point, Sequence | np.ndarray)
            and len(point) == 2
            and np.all(np.isfinite(np.asarray(point, dtype=float)))
        ):
            raise ModelError(f"a point of a sketch is a pair (x, y) of numbers, not {point!r}")
    if len(points) < least:
        raise ModelError(f"a piece of a sketch needs {least} points, not {len(points)}")


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

    @asked
    def __init__(
        self,
        axes: Axes,
        draw: Callable[[Sketch, Any], object],
        width: float = 6.0,
        height: float = 3.0,
    ):
        if not takes(draw, 2):
            raise ModelError(f"draw of Motion must be a function of a sketch and s, not {draw!r}")
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
        self.pieces.all = []
        sketch.axes, sketch.figure, sketch.artists = self.pieces, self.figure, []

        def instant(values: Mapping[str, Any], one: Any) -> SimpleNamespace:
            return SimpleNamespace(**values, t=t, p=one.p)

        now, many = run.at(t), isinstance(run, Mapping)
        each = {name: instant(values, run[name]) for name, values in now.items()} if many else None
        self.draw(sketch, each if many else instant(now, run))
        self.pieces.stale = True


class _Pieces(Artist):
    """Many artists as one, that can be replaced without declaring the axes changed.

    Takes what a Sketch adds.
    """

    def __init__(self, axes: Axes):
        super().__init__()
        self.host, self.all, self.wide = axes, [], 0.0
        self.set_in_layout(False)

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
