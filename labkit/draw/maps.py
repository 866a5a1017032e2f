"""Pictures of a sweep: a curve over one parameter, a map over two, maps over three.

picture(m, "d", "R", contour=[30, 40, 60])          # what m.picture does
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
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

__all__ = ["picture"]

SHADES = "cividis"  # for all kinds of colour vision, and in grey print
MAPS = 6  # the most side by side; of curves as many as there are colours
NONE = "no result"
NAMES = 10  # the most that stand along an axis


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
    for name in (x, y):
        if name is not None and name not in names:
            raise ModelError(f"the sweep has no axis {name!r}; it has {listed(names)}")
    if x is not None and x == y:
        raise ModelError(f"x and y are both {x!r}: a map has two different axes")
    if unknown := [name for name in (*(log or ()), *even) if name not in names]:
        raise ModelError(f"the sweep has no axis {listed(unknown)}; it has {listed(names)}")
    if both := [name for name in log or () if name in even]:
        raise ModelError(f"axis {listed(both)} cannot be both log and even")
    named = {name: np.array([_text(v, 3) for v in m.axes[name].tolist()]) for name in even}
    m = replace(m, axes={**m.axes, **named})
    curves = len(names) == 1 or (len(names) == 2 and x is not None and y is None)
    order = [name for name in (x, y) if name] + [name for name in names if name not in (x, y)]
    log = _logarithmic(m) if log is None else log
    values = np.moveaxis(
        m[what] if what else m.values, [names.index(n) for n in order], range(len(names))
    )
    lost = np.moveaxis(m.failed, [names.index(n) for n in order], range(len(names)))
    label = label or what or next(iter(m.results)) or m.name
    third = m.axes[order[2]] if len(order) == 3 else [None]
    if axes is not None and len(order) == 3:
        raise ModelError("three axes are maps side by side: they make a figure of their own")
    if len(third) > MAPS:
        raise ModelError(
            f"{len(third)} values of {order[2]!r} would be as many maps: at most {MAPS}, so "
            f"name two other axes, m.picture({order[2]!r}, …)"
        )
    many = len(third) > 1
    drawn = (
        [axes]
        if axes is not None
        else list(
            figure(
                1,
                len(third),
                width=width or (4.2 * len(third) if many else 8.5),
                height=height,
                sharey=True,
                title=title if many else "",
            ).axes
        )
    )
    if curves:
        _curves(drawn[0], m, order, values, lost, label, title, log)
    else:
        lines = values if contour is not None else None
        if isinstance(contour, str):
            lines = np.moveaxis(m[contour], [names.index(n) for n in order], range(len(names)))
        elif contour is not None:
            levels = contour
        entries = _maps(drawn, m, order, third, values, lost, label, log, lines, levels)
        if not many:
            head(drawn[0], title, entries)
        elif entries:
            look = {"loc": "outside lower center", "ncols": len(entries), "frameon": False}
            drawn[0].get_figure().legend(*zip(*entries, strict=True), **look)
    for ax in drawn:
        for name, scale in zip(
            order[: 1 if curves else 2], (ax.set_xscale, ax.set_yscale), strict=False
        ):
            if name in log:
                scale("log")
        _ticks(ax, m, order, log, curves)
    return drawn[0].get_figure()


def _maps(drawn, m, order, third, values, lost, label, log, lines, levels):  # type: ignore[no-untyped-def]
    """A map in each axes, of a third axis one for each value; what a legend of them says."""
    kinds = _kinds(values)
    for k, (ax, each) in enumerate(zip(drawn, third, strict=True)):
        part = (..., k) if len(order) == 3 else ...
        shown = _map(ax, m, order, values[part], lost[part], kinds, values, log)
        if lines is not None:
            _contours(ax, m, order, lines[part], levels)
        ax.set_title("" if each is None else _equal(m, order[2], each))
    if kinds is None:
        drawn[0].get_figure().colorbar(shown, ax=drawn, label=label)
    return _entries(kinds, lost | _empty(values))


def _symbol(m: Sweep, name: str) -> str:
    if name in m.system.parameters and (own := m.system.parameters[name].symbol):
        return f"${own}$"
    return symbol(name) if name in m.system.parameters or name in m.system.units else name


def _equal(m: Sweep, name: str, value: object) -> str:
    return f"{_symbol(m, name)} = {_text(value)} {m.units.get(name, '')}".strip()


def _label(m: Sweep, name: str) -> str:
    return _symbol(m, name) + (f" [{m.units[name]}]" if m.units.get(name) else "")


def _text(value: object, digits: int = 4) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return value if isinstance(value, str) else f"{value:.{digits}g}".replace("-", "−")


def _logarithmic(m: Sweep) -> set[str]:
    """The axes whose values stand in equal ratios rather than in equal distances."""
    found = set()
    for name, axis in m.axes.items():
        if axis.dtype.kind in "fiu" and len(axis) > 2 and np.all(axis > 0):
            steps, ratios = np.diff(axis), np.diff(np.log(axis))
            if np.ptp(ratios) * abs(steps.mean()) < 0.5 * np.ptp(steps) * abs(ratios.mean()):
                found.add(name)
    return found


def _places(m: Sweep, name: str) -> np.ndarray:
    """Where the values of an axis stand: names by number."""
    axis = m.axes[name]
    return axis if axis.dtype.kind in "fiu" else np.arange(len(axis), dtype=float)


def _edges(places: np.ndarray, log: bool) -> np.ndarray:
    """Borders half way between the values, which may fall or stand in any order that rises."""
    at = np.log(places) if log else places.astype(float)
    if len(set(np.sign(np.diff(at)))) > 1 or 0 in np.diff(at):
        raise ModelError("the values along an axis of a map must rise or fall: sort them")
    middle = (at[1:] + at[:-1]) / 2
    first, last = (
        (at[0] - (middle[0] - at[0]), at[-1] + (at[-1] - middle[-1]))
        if len(at) > 1
        else (at[0] - 0.5, at[0] + 0.5)
    )
    edges = np.concatenate([[first], middle, [last]])
    return np.exp(edges) if log else edges


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


def _empty(values: np.ndarray) -> np.ndarray:
    """Where there is no result."""
    if values.dtype.kind == "f":
        return np.isnan(values)
    return np.array([v is None for v in values.ravel().tolist()]).reshape(values.shape)


def _map(ax, m, order, values, lost, kinds, everything, log):  # type: ignore[no-untyped-def]
    edges = [_edges(_places(m, name), name in log) for name in order[:2]]
    lost = lost | _empty(values)
    if kinds is None:
        finite = everything[np.isfinite(everything)]
        look = {"cmap": SHADES, "vmin": finite.min(), "vmax": finite.max()}
        shades = np.ma.masked_where(lost | ~np.isfinite(values), values)
    else:
        place = {kind: k for k, kind in enumerate(kinds)}
        look = {"cmap": ListedColormap([tint(COLORS[k], 0.55) for k in range(len(kinds))])}
        look |= {"vmin": -0.5, "vmax": len(kinds) - 0.5}
        shades = np.array([place.get(v, -1) for v in values.ravel().tolist()], dtype=float)
        shades = np.ma.masked_where(lost, shades.reshape(values.shape))
    ax.grid(False)
    shown = ax.pcolormesh(*edges, shades.T, **look, rasterized=True)
    left, right, bottom, top = edges[0][:-1], edges[0][1:], edges[1][:-1], edges[1][1:]
    quads = [
        [(left[i], bottom[j]), (right[i], bottom[j]), (right[i], top[j]), (left[i], top[j])]
        for i, j in np.argwhere(lost)
    ]
    ax.add_collection(PolyCollection(quads, facecolor="white", edgecolor=FAINT, hatch="////", lw=0))
    ax.set(xlabel=_label(m, order[0]), xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    if ax.get_subplotspec().is_first_col():
        ax.set(ylabel=_label(m, order[1]))
    return shown


def _contours(ax, m, order, lines, levels):  # type: ignore[no-untyped-def]
    if lines.dtype.kind != "f":
        raise ModelError("contours are lines of equal numbers, but this result is words")
    x, y = (_places(m, name) for name in order[:2])
    if min(len(x), len(y)) < 2:
        raise ModelError("contours need at least two values along each axis")
    drawn = ax.contour(
        x, y, np.ma.masked_invalid(lines).T, levels=levels, colors=INK, linewidths=1.2
    )
    drawn.set_path_effects(HALO)  # they are seen on dark shades, too
    for word in ax.clabel(drawn, fmt=lambda v: _text(float(v)), fontsize=9):
        word.set_path_effects(HALO)


def _entries(kinds: list | None, lost: np.ndarray) -> list[tuple[Patch, str]]:
    """What a legend of patches says."""
    entries = [
        (Patch(color=tint(COLORS[k], 0.55)), _text(kind)) for k, kind in enumerate(kinds or [])
    ]
    if lost.any():
        entries.append((Patch(facecolor="white", edgecolor=FAINT, hatch="////"), NONE))
    return entries


def _curves(ax, m, order, values, lost, label, title, log):  # type: ignore[no-untyped-def]
    x, kinds = _places(m, order[0]), _kinds(values)
    many = m.axes[order[1]] if len(order) == 2 else [None]
    if len(many) > len(COLORS):
        raise ModelError(
            f"{len(many)} values of {order[1]!r} would be as many curves, at most {len(COLORS)}: "
            f"draw a map, m.picture({order[0]!r}, {order[1]!r})"
        )
    entries = []
    for k, each in enumerate(many):
        column = values[:, k] if len(order) == 2 else values
        if kinds is not None:
            column = np.array(
                [kinds.index(v) if v is not None else np.nan for v in column.tolist()]
            )
        look: dict[str, Any] = {"color": COLORS[k % len(COLORS)], "marker": "o", "ms": 4}
        look["ls"] = (
            "none"
            if kinds is not None or m.axes[order[0]].dtype.kind not in "fiu"
            else DASHES[k % len(DASHES)]
        )
        (line,) = ax.plot(x, column, **look)
        if each is not None:
            entries.append((line, _equal(m, order[1], each)))
    edges = _edges(x, order[0] in log)
    empty = (lost | _empty(values)).reshape(len(x), -1).all(axis=1)
    for k in np.flatnonzero(empty):
        ax.axvspan(
            edges[k], edges[k + 1], facecolor="white", edgecolor=FAINT, hatch="////", lw=0, zorder=0
        )
    entries += _entries(None, empty)
    ax.set(
        xlabel=_label(m, order[0]), xlim=edges[[0, -1]], ylabel="" if kinds is not None else label
    )
    if kinds is not None:
        ax.set_yticks(range(len(kinds)), [_text(kind) for kind in kinds])
        ax.set_ylim(-0.5, len(kinds) - 0.5)
    head(ax, title, entries)


def _ticks(ax: Axes, m: Sweep, order: list[str], log: Collection[str], curves: bool) -> None:
    """Names where an axis has names; on a logarithmic one, numbers that can be read."""
    for name, one in zip(order[: 1 if curves else 2], (ax.xaxis, ax.yaxis), strict=False):
        axis = m.axes[name]
        if axis.dtype.kind not in "fiu":
            shown = range(0, len(axis), -(-len(axis) // NAMES))
            one.set_ticks(list(shown), [_text(axis[k].item(), 3) for k in shown])
        elif name in log:
            low, high = axis.min(), axis.max()
            if high / low < 1e3:
                ticks = [
                    d * 10.0**k
                    for k in range(-30, 30)
                    for d in (1, 2, 5)
                    if low <= d * 10.0**k <= high * (1 + 1e-9)
                ]
                one.set_ticks(ticks, [_text(tick) for tick in ticks])
            one.set_minor_locator(NullLocator())
