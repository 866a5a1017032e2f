"""Pictures of a sweep: a curve over one parameter, a map over two, maps over three.

picture(m, "d", "R", contour=[30, 40, 60])          # what m.picture does
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from ..arguments import asked
from ..model import ModelError, listed
from .figure import COLORS, DASHES, FAINT, HALO, INK, Figure, figure, head, symbol, tint

if TYPE_CHECKING:
    from ..sweeps import Sweep

SHADES = "cividis"  # for all kinds of colour vision, and in grey print
MAPS = 6  # the most side by side; of curves as many as there are colours
NONE = "no result"
NAMES = 10  # the most that stand along an axis
HATCHED = {"facecolor": "white", "edgecolor": FAINT, "hatch": "////"}


@asked
def picture(
    m: Sweep,
    x: str | None = None,
    y: str | None = None,
    *,
    what: str | None = None,
    contour: int | Sequence[float] | str | None = None,
    levels: int | Sequence[float] | None = None,
    label: str = "",
    log: Collection[str] | None = None,
    even: Collection[str] = (),
    title: str = "",
    width: float = 0.0,
    height: float = 4.2,
    axes: Axes | None = None,
) -> Figure:
    """picture(m, "d", "R") -> figure; see Sweep.picture."""
    names = list(m.axes)
    if unknown := [n for n in (x, y, *(log or ()), *even) if n is not None and n not in names]:
        raise ModelError(f"the sweep has no axis {listed(unknown)}; it has {listed(names)}")
    if x is not None and x == y:
        raise ModelError(f"x and y are both {x!r}: a map has two different axes")
    if both := [name for name in log or () if name in even]:
        raise ModelError(f"axis {listed(both)} cannot be both log and even")
    named = {name: np.array([_text(v, 3) for v in m.axes[name].tolist()]) for name in even}
    m = replace(m, axes={**m.axes, **named})
    if low := [name for name in log or () if not _positive(m.axes[name])]:
        raise ModelError(f"axis {listed(low)} cannot be log: it has values that are not above 0")
    order = [name for name in (x, y) if name] + [name for name in names if name not in (x, y)]
    curves = len(names) == 1 or (len(names) == 2 and x is not None and y is None)
    log = [name for name in names if _in_ratios(m.axes[name])] if log is None else log
    sheet = _Sheet(m, order, frozenset(log), curves)
    third = m.axes[order[2]] if len(order) == 3 else [None]
    if axes is not None and len(order) == 3:
        raise ModelError("three axes are maps side by side: they make a figure of their own")
    if len(third) > MAPS:
        raise ModelError(
            f"{len(third)} values of {order[2]!r} would be as many maps: at most {MAPS}, so "
            f"name two other axes, m.picture({order[2]!r}, …)"
        )
    many = len(third) > 1
    drawn = [axes]
    if axes is None:
        width = width or (4.2 * len(third) if many else 8.5)
        over = title if many else ""
        made = figure(1, len(third), width=width, height=height, sharey=True, title=over)
        drawn = list(made.axes)
    fig = drawn[0].get_figure()
    values, lost = sheet.turned(m[what] if what else m.values), sheet.turned(m.failed)
    lost = lost | _empty(values)
    kinds = _kinds(values)
    label = label or what or next(iter(m.results)) or m.name
    if curves:
        head(drawn[0], title, sheet.curves(drawn[0], values, lost, kinds, label))
    else:
        lines = None
        if contour is not None:
            lines = sheet.turned(m[contour]) if isinstance(contour, str) else values
            levels = levels if isinstance(contour, str) else contour
        for k, (ax, each) in enumerate(zip(drawn, third, strict=True)):
            part = (..., k) if len(order) == 3 else ...
            shown = sheet.map(ax, values[part], lost[part], kinds, _range(values))
            if ax is drawn[0]:
                ax.set_ylabel(sheet.label(order[1]))
            if lines is not None:
                sheet.contours(ax, lines[part], levels)
            ax.set_title("" if each is None else sheet.equal(order[2], each))
        if kinds is None:
            fig.colorbar(shown, ax=drawn, label=label)
        entries = _entries(kinds, lost)
        if not many:
            head(drawn[0], title or drawn[0].get_title("left"), entries)
        elif entries:
            look = {"loc": "outside lower center", "ncols": len(entries), "frameon": False}
            fig.legend(*zip(*entries, strict=True), **look)
    for ax in drawn:
        for name, axis in zip(order[: 1 if curves else 2], (ax.xaxis, ax.yaxis), strict=False):
            sheet.ticks(ax, name, axis)
    return fig


@dataclass(frozen=True)
class _Sheet:
    """A sweep as it is drawn: its axes in this order, to the right, upwards, side by side."""

    m: Sweep
    order: list[str]
    log: frozenset[str]
    flat: bool  # curves over the first axis, no map over two

    def turned(self, values: np.ndarray) -> np.ndarray:
        return values.transpose([list(self.m.axes).index(name) for name in self.order])

    def symbol(self, name: str) -> str:
        system = self.m.system
        if name in system.parameters and (own := system.parameters[name].symbol):
            return f"${own}$"
        return symbol(name) if name in system.parameters or name in system.units else name

    def label(self, name: str) -> str:
        unit = self.m.units.get(name)
        return self.symbol(name) + (f" [{unit}]" if unit else "")

    def equal(self, name: str, value: object) -> str:
        return f"{self.symbol(name)} = {_text(value)} {self.m.units.get(name, '')}".strip()

    def places(self, name: str) -> np.ndarray:
        """Where the values of an axis stand: names by number."""
        axis = self.m.axes[name]
        return axis if _numbers(axis) else np.arange(len(axis), dtype=float)

    def edges(self, name: str) -> np.ndarray:
        """Borders half way between the values, which may stand in any order that rises or falls."""
        at = self.places(name).astype(float)
        at = np.log(at) if name in self.log else at
        if len(set(np.sign(np.diff(at)))) > 1 or 0 in np.diff(at):
            raise ModelError("the values along an axis of a map must rise or fall: sort them")
        middle = (at[1:] + at[:-1]) / 2
        ends = [at[0] - 0.5, at[0] + 0.5]
        if len(at) > 1:
            ends = [at[0] - (middle[0] - at[0]), at[-1] + (at[-1] - middle[-1])]
        edges = np.concatenate([ends[:1], middle, ends[1:]])
        return np.exp(edges) if name in self.log else edges

    def map(
        self, ax: Axes, values: np.ndarray, lost: np.ndarray, kinds: list | None, ends: tuple
    ) -> Any:
        x, y = (self.edges(name) for name in self.order[:2])
        if kinds is None:
            look = {"cmap": SHADES, "vmin": ends[0], "vmax": ends[1]}
            shades = np.ma.masked_where(lost | ~np.isfinite(values), values)
        else:
            look = {"cmap": ListedColormap([tint(color, 0.55) for color in COLORS[: len(kinds)]])}
            look |= {"vmin": -0.5, "vmax": len(kinds) - 0.5}
            shades = np.ma.masked_where(lost, _numbered(values, kinds))
        ax.grid(False)
        shown = ax.pcolormesh(x, y, shades.T, **look, rasterized=True)
        quads = [
            [(x[i], y[j]), (x[i + 1], y[j]), (x[i + 1], y[j + 1]), (x[i], y[j + 1])]
            for i, j in np.argwhere(lost)
        ]
        ax.add_collection(PolyCollection(quads, **HATCHED, lw=0))
        ax.set(xlabel=self.label(self.order[0]), xlim=x[[0, -1]], ylim=y[[0, -1]])
        return shown

    def contours(self, ax: Axes, lines: np.ndarray, levels: Any) -> None:
        if lines.dtype.kind != "f":
            raise ModelError("contours are lines of equal numbers, but this result is words")
        if min(lines.shape) < 2:
            raise ModelError("contours need at least two values along each axis")
        x, y = (self.places(name) for name in self.order[:2])
        look = {"levels": levels, "colors": INK, "linewidths": 1.2}
        drawn = ax.contour(x, y, np.ma.masked_invalid(lines).T, **look)
        words = ax.clabel(drawn, fmt=lambda v: _text(float(v)), fontsize=9)
        for artist in (drawn, *words):
            artist.set_path_effects(HALO)  # they are seen on dark shades, too

    def curves(
        self, ax: Axes, values: np.ndarray, lost: np.ndarray, kinds: list | None, label: str
    ) -> list[tuple[Artist, str]]:
        first, *second = self.order
        x, edges = self.places(first), self.edges(first)
        many = self.m.axes[second[0]] if second else [None]
        if len(many) > len(COLORS):
            raise ModelError(
                f"{len(many)} values of {second[0]!r} would be as many curves, at most "
                f"{len(COLORS)}: draw a map, m.picture({first!r}, {second[0]!r})"
            )
        entries: list[tuple[Artist, str]] = []
        columns = (values if kinds is None else _numbered(values, kinds)).reshape(len(x), -1)
        apart = kinds is not None or not _numbers(self.m.axes[first])
        for k, (each, column) in enumerate(zip(many, columns.T, strict=True)):
            dash = "none" if apart else DASHES[k % len(DASHES)]
            (line,) = ax.plot(x, column, color=COLORS[k], marker="o", ms=4, ls=dash)
            if each is not None:
                entries.append((line, self.equal(second[0], each)))
        empty = lost.reshape(len(x), -1).all(axis=1)
        for k in np.flatnonzero(empty):
            ax.axvspan(edges[k], edges[k + 1], **HATCHED, lw=0, zorder=0)
        up = label if kinds is None else ""
        ax.set(xlabel=self.label(first), xlim=edges[[0, -1]], ylabel=up)
        if kinds is not None:
            ax.set_yticks(range(len(kinds)), [_text(kind) for kind in kinds])
            ax.set_ylim(-0.5, len(kinds) - 0.5)
        return entries + _entries(None, empty)

    def ticks(self, ax: Axes, name: str, axis: Any) -> None:
        """Names where an axis has names; on a logarithmic one, numbers that can be read."""
        values = self.m.axes[name]
        if not _numbers(values):
            shown = range(0, len(values), -(-len(values) // NAMES))
            axis.set_ticks(list(shown), [_text(values[k].item(), 3) for k in shown])
        elif name in self.log:
            ax.set(**{f"{axis.axis_name}scale": "log"})
            low, high = values.min(), values.max()
            if high / low < 1e3:
                round_ = (d * 10.0**k for k in range(-30, 30) for d in (1, 2, 5))
                ticks = [tick for tick in round_ if low <= tick <= high * (1 + 1e-9)]
                if len(ticks) < 2:  # on a short axis the values themselves
                    ticks = values[:: -(-len(values) // NAMES)].tolist()
                axis.set_ticks(ticks, [_text(tick) for tick in ticks])
            axis.set_minor_locator(NullLocator())


def _text(value: object, digits: int = 4) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return value if isinstance(value, str) else f"{value:.{digits}g}".replace("-", "−")


def _numbers(axis: np.ndarray) -> bool:
    return axis.dtype.kind in "fiu"


def _positive(axis: np.ndarray) -> bool:
    return _numbers(axis) and bool(np.all(axis > 0))


def _in_ratios(axis: np.ndarray) -> bool:
    """Do the values stand in equal ratios rather than in equal distances?"""
    if not _positive(axis) or len(axis) < 3:
        return False
    steps, ratios = np.diff(axis), np.diff(np.log(axis))
    return bool(np.ptp(ratios) * abs(steps.mean()) < 0.5 * np.ptp(steps) * abs(ratios.mean()))


def _kinds(values: np.ndarray) -> list | None:
    """The different words among the results; None if they are numbers."""
    if values.dtype.kind == "f":
        return None
    kinds = list(dict.fromkeys(v for v in values.ravel().tolist() if v is not None))
    if len(kinds) > len(COLORS):
        raise ModelError(
            f"{len(kinds)} different words cannot be told apart in a map: at most {len(COLORS)}, "
            f"here {listed(map(_text, kinds[:4]))}, …"
        )
    return sorted(kinds, key=lambda kind: (not isinstance(kind, bool), str(kind)))


def _numbered(values: np.ndarray, kinds: list) -> np.ndarray:
    """Words by their places among all; NaN where there is none."""
    place = {kind: k for k, kind in enumerate(kinds)}
    found = [place.get(value, np.nan) for value in values.ravel().tolist()]
    return np.array(found, dtype=float).reshape(values.shape)


def _empty(values: np.ndarray) -> np.ndarray:
    """Where there is no result."""
    return np.isnan(values) if values.dtype.kind == "f" else values == None  # noqa: E711


def _range(values: np.ndarray) -> tuple[float, float]:
    """Of all maps; of words, or where no run has a result, whatever it be."""
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values[:0]
    return (finite.min(), finite.max()) if finite.size else (0.0, 1.0)


def _entries(kinds: list | None, lost: np.ndarray) -> list[tuple[Artist, str]]:
    """What a legend of patches says."""
    pairs = zip(kinds or [], COLORS, strict=False)
    entries = [(Patch(color=tint(color, 0.55)), _text(kind)) for kind, color in pairs]
    return entries + ([(Patch(**HATCHED), NONE)] if lost.any() else [])
