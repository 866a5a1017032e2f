"""Any curves that follow a run: a live view from one function.

curves(run, lambda run: {"simulated": (run.t, r(run)), "exact": (run.t, e(run))}, log="y")
explore(system, horizon, lambda run: [time_plot(run, "x", axes=left), curves(right, what)])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import is_color_like
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.text import Text

from ..arguments import takes, unambiguous
from ..model import ModelError, check_names
from ..run import Run
from .figure import (
    COLORS,
    DASHES,
    FAINT,
    VEIL,
    area,
    figure,
    head,
    style,
    symbol,
    when_resized,
)
from .private import closed, reshape
from .ticks import over_time
from .time import sample, segments
from .view import Shows, View, Window, extent

What = Callable[[Any], Mapping[str, object]]
Span = tuple[float, float]


@unambiguous
def curves(
    where: Run | Axes | Mapping[str, Run],
    what: What,
    *,
    styles: Mapping[str, str | Mapping[str, object]] | None = None,
    axes: Axes | None = None,
    xlabel: str | None = None,
    ylabel: str | None = None,
    title: str = "",
    legend: bool = True,
    log: str = "",
    xlim: Span | None = None,
    ylim: Span | None = None,
    equal: bool = False,
    plane: tuple[str, str] | None = None,
    width: float = 7.5,
    height: float = 4.0,
) -> Curves:
    """curves(run, lambda run: {"simulated": (run.t, r(run))}) -> Curves, which follows a run.

    where    a Run, drawn into a new figure or into axes=; or axes, which stay empty until
             update(run): in the list that `explore` draws, that is at once
    what     what(run) -> name -> what is drawn under that name. Numbers or arrays of one length:
             (x, y)          a line, or markers
             (x, low, high)  a shaded band; x may be None: all over the picture; ±inf: to its edge
             (None, y)       horizontal lines;  (x, None)  vertical lines;  (x, None, None) a
             vertical band for each pair of x
             "words"         a text that changes
             A name that begins with "_" is not in the legend. A curve that is left out is empty.
    styles   name -> "o", "--", "C1-", Matplotlib's short form; "steps": constant until the next
             point; "fill": the closed curve as an area; or a dict of properties of Line2D, patch
             or text (of a text also x and y, in parts of the axes)
    log      "x", "y" or "xy": logarithmic axes
    xlim     (low, high); left out: as wide as the data need, moving calmly. ylim likewise
    equal    one unit is as long upwards as to the right
    plane    ("x", "v"): the axes are the plane of these states; a panel then has its cursor and
             its clicks there. Axes over run.t have the time cursor without being told
    xlabel   with the unit, "$r$ [m]"; left out, over run.t: the time

    Raises ModelError when `what` gives something else, with the name of the curve.
    """
    if not takes(what, 1):
        raise ModelError(f"what of curves must be a function of a run, not {what!r}")
    if not isinstance(title, str):
        raise ModelError(f"title of curves must be a text, not {title!r}")
    if isinstance(where, Mapping) and not where:
        raise ModelError("curves got no run to draw: give one, or axes")
    run = None if isinstance(where, Axes) else where
    if isinstance(where, Axes):
        if axes is not None:
            raise ModelError("curves got axes twice: give curves(run, what, axes=…)")
        axes = where
    elif axes is None:
        axes = figure(width=width, height=height).axes[0]
    if not set(log) <= {"x", "y"}:
        raise ModelError(f"log is 'x', 'y' or 'xy', not {log!r}")
    for which, given in (("x", xlim), ("y", ylim)):
        if given is not None and not (
            len(given) == 2 and np.isfinite(given).all() and given[0] < given[1]
        ):
            raise ModelError(f"{which}lim is (low, high) with low < high, not {given!r}")
    with style():
        axes.set(**{key: v for key, v in (("xlabel", xlabel), ("ylabel", ylabel)) if v is not None})
        axes.set(**{f"{which}scale": "log" for which in log})
        if equal:
            axes.set_aspect("equal", adjustable="datalim" if None in (xlim, ylim) else "box")
    view = Curves(axes, what, dict(styles or {}), title, legend, log, (xlim, ylim))
    view.timed = xlabel is None
    if plane is not None:
        view.shows = [Shows(axes, plane[0], (plane[1],))]
    if run is not None:
        view.update(run)
    return view


class Curves(View):
    """The picture made by `curves`; view.axes is its axes, view.drawn name -> artist.

    See View for update, artists and relimited.
    """

    ready = False

    def __init__(
        self,
        axes: Axes,
        what: What,
        styles: Mapping[str, str | Mapping[str, object]],
        title: str,
        legend: bool,
        log: str,
        limits: tuple[Span | None, Span | None],
    ):
        self.axes, self.figure, self.what, self.styles = axes, axes.get_figure(), what, styles
        self.title, self.legend, self.log, self.limits = title, legend, log, limits
        self.timed = True  # whether the axis to the right may be named as the time
        self.drawn: dict[str, Artist] = {}
        self._last: tuple[Any, Mapping[str, Any]] = (None, {})
        self._windows: list[Window | None] = []
        self._named: list[str] = []
        self._bands: dict[str, tuple | None] = {}

    @property
    def artists(self) -> list[Artist]:  # type: ignore[override]
        return sorted(self.drawn.values(), key=lambda artist: artist.get_zorder())

    def update(self, run: Any) -> None:
        """view.update(run): calls what(run) and shows what it gives."""
        found = self._found(run)
        if not self.drawn:
            check_names(self.styles, found, "styles names {}, which is not drawn")
        new = [name for name in found if name not in self.drawn]
        for name in new:
            self.drawn[name] = self._made(name, found[name])
        put = [self._put(name, one, found.get(name)) for name, one in self.drawn.items()]
        data = [[array for heeded in put for array in heeded[k]] for k in (0, 1)]
        runs = list(run.values()) if isinstance(run, Mapping) else [run]
        times = [one.t for one in runs]
        timed = any(isinstance(v, tuple) and any(v[0] is t for t in times) for v in found.values())
        if not self._windows:
            self._begin(runs[0], timed, data)
            self.relimited = True
        else:
            fitted = [
                window.fit(*self._extent(values, which))
                for window, values, which in zip(self._windows, data, "xy", strict=True)
                if window is not None
            ]
            self.relimited = any(fitted) or bool(new)
        for name, band in self._bands.items():  # as wide as the limits are now
            patch = self.drawn[name]
            reshape(patch, closed(*(self._fill(patch, *band) if band is not None else ())))
        named = [name for name in self.drawn if self._legible(name)]
        if named != self._named or new:
            self._named = named
            entries = [(self._sample(name), name) for name in named]
            lone = len(entries) == 1 and isinstance(self.drawn[named[0]], Line2D)
            head(self.axes, self.title, entries if self.legend and not lone else [])

    def _found(self, run: Any) -> Mapping[str, Any]:
        """What the function gives for a run; a cursor that moves asks again and again."""
        if run is not self._last[0]:
            found = self.what(run)
            if not isinstance(found, Mapping):
                raise ModelError(
                    f"the function of curves gives name -> (x, y), not {type(found).__name__}"
                )
            pairs = found.items()
            self._last = run, {k: tuple(v) if isinstance(v, list) else v for k, v in pairs}
        return self._last[1]

    def _begin(self, run: Run, timed: bool, data: Sequence[list[np.ndarray]]) -> None:
        for which, values, given in zip("xy", data, self.limits, strict=True):
            if given is not None:
                getattr(self.axes, f"set_{which}lim")(*given)
                self._windows.append(None)
                continue
            room = {"margin": 0.0, "room": 0.0} if which == "x" and timed else {}
            span = self._extent(values, which)
            self._windows.append(Window(self.axes, which, *span, log=which in self.log, **room))
        if timed and not self.shows:
            lines = [name for name, a in self.drawn.items() if isinstance(a, Line2D)]
            self.shows = [Shows(self.axes, "t", tuple(lines), self._curve)]
        if timed and self.timed and not self.axes.get_xlabel():
            with style():
                over_time(self.axes, symbol("t"), run.system.time)

    def _curve(self, run: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
        """What a held run and a cursor draw: the curve over the time, if it is one."""
        found = self._found(run).get(name)
        if not isinstance(found, tuple) or len(found) != 2 or any(v is None for v in found):
            return np.zeros(0), np.zeros(0)
        x, y = np.broadcast_arrays(*(np.asarray(v, dtype=float).ravel() for v in found))
        return x, y

    def _extent(self, data: list[np.ndarray], which: str) -> Span:
        if which in self.log:
            data = [array[array > 0] for array in data]
        return extent(*data)

    def _legible(self, name: str) -> bool:
        return not name.startswith("_") and not isinstance(self.drawn[name], Text)

    def _sample(self, name: str) -> Artist:
        artist = self.drawn[name]
        if isinstance(artist, Line2D):
            return sample(artist)
        looks = ("facecolor", "edgecolor", "linewidth", "hatch")
        return Patch(**{look: getattr(artist, f"get_{look}")() for look in looks})

    def _made(self, name: str, value: object) -> Artist:
        """The empty artist for a value of this kind, in the order of colours and dashes."""
        look = self.styles.get(name, {})
        try:
            with style():
                if isinstance(value, str):
                    return self._words(look)
                if look == "fill" or (isinstance(value, tuple) and len(value) == 3):
                    return self._band(look)
                straight = isinstance(value, tuple) and any(part is None for part in value)
                return self._line(look, straight)
        except (ValueError, AttributeError, TypeError) as error:
            raise ModelError(f"the style of {name!r}, {look!r}: {error}") from None

    def _words(self, look: str | Mapping[str, Any]) -> Text:
        given = {"x": 0.02, "y": 0.97, "va": "top", "fontsize": 10.0, "zorder": 6, "bbox": VEIL}
        given |= look if isinstance(look, Mapping) else {}
        made = self.axes.text(s="", transform=self.axes.transAxes, **given)
        made.set_in_layout(False)
        when_resized(self.axes, self._fit_words)
        return made

    def _color(self) -> str:
        return COLORS[self._count(Line2D | PathPatch) % len(COLORS)]

    def _count(self, kind: Any) -> int:
        return sum(isinstance(artist, kind) for artist in self.drawn.values())

    def _band(self, look: str | Mapping[str, Any]) -> PathPatch:
        given = {"facecolor": self._color(), "alpha": 0.18, "lw": 0, "zorder": 1.1}
        if isinstance(look, Mapping):
            given |= {"facecolor" if key == "color" else key: v for key, v in look.items()}
        return area(self.axes, **given)

    def _line(self, look: str | Mapping[str, Any], straight: bool) -> Line2D:
        short, given = (look, {}) if isinstance(look, str) else ("", dict(look))
        if short == "steps":
            short, given = "", {"drawstyle": "steps-post"}
        line = self.axes.plot([], [], *([short] if short else []))[0]
        if not _colored(short, given):
            line.set_color(FAINT if straight else self._color())
        if not short and not {"ls", "linestyle", "marker"} & set(given):
            dash = DASHES[self._count(Line2D) % len(DASHES)]
            line.set(linestyle=(0, (4, 2)) if straight else dash, dash_capstyle="butt")
        line.set_zorder(1.6 if straight else 3 + 0.01 * self._count(Line2D | PathPatch))
        if straight:
            line.set_linewidth(1.1)
        elif line.get_linestyle() == "None":
            line.set_markersize(4)
        line.set(**given)
        return line

    def _put(
        self, name: str, artist: Artist, value: object
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Gives the artist its data; returns those that the limits in x and in y heed."""
        filled = self.styles.get(name) == "fill"
        size = 3 if isinstance(artist, PathPatch) and not filled else 2
        words = isinstance(artist, Text)
        fits = isinstance(value, str) if words else isinstance(value, tuple) and len(value) == size
        if value is not None and not fits:
            kinds = "(x, y), (x, low, high) or words"
            raise ModelError(
                f"curve {name!r} is {kinds}, the same kind at each run, not {value!r:.200}"
            )
        if words:
            if (value or "") != artist.get_text():
                artist.set_text(value or "")
                self._fit_words()
            return [], []
        if value is None:
            if isinstance(artist, Line2D):
                artist.set_data([], [])
            else:
                self._bands[name] = None
            return [], []
        there = [part for part in value if part is not None]
        if not there:
            raise ModelError(f"curve {name!r} gives None for everything")
        try:
            full = iter(np.broadcast_arrays(*(np.asarray(v, dtype=float).ravel() for v in there)))
        except (TypeError, ValueError):
            sizes = ", ".join("None" if v is None else str(np.shape(v)) for v in value)
            raise ModelError(
                f"curve {name!r}: x and y must be numbers of one length, not of shapes {sizes}"
            ) from None
        parts = [None if part is None else next(full) for part in value]
        x, y = parts[:2]
        if isinstance(artist, PathPatch):
            self._bands[name] = (*parts, None)[:3]
            bounds = [a[np.isfinite(a)] for a in parts[1:] if a is not None]
            return [] if x is None else [x], bounds
        if x is None or y is None:
            at = y if x is None else x
            ends = segments(np.zeros(len(at)), np.ones(len(at))), np.repeat(at, 3)
            level = self.axes.get_yaxis_transform(), self.axes.get_xaxis_transform()
            artist.set_transform(level[y is None])
            artist.set_data(*(ends if x is None else ends[::-1]))
            return ([], [at]) if x is None else ([at], [])
        artist.set_data(x, y)
        return [x], [y]

    def _fit_words(self, *_: float) -> None:
        """Words too long for the picture, in large type, become smaller."""
        for text in self.drawn.values():
            if isinstance(text, Text) and text.get_text().strip():
                text.set_fontsize(given := vars(text).setdefault("given", text.get_fontsize()))
                box, page = text.get_window_extent(), self.figure.bbox
                right = max(box.x1 - page.x1, page.x0 - box.x0) / box.width
                up = 2 * max(box.y1 - page.y1, page.y0 - box.y0) / box.height
                text.set_fontsize(given * (1 - min(max(right, up, 0.0), 0.7)))

    def _fill(
        self,
        patch: PathPatch,
        x: np.ndarray | None,
        low: np.ndarray | None,
        high: np.ndarray | None,
    ) -> list[np.ndarray]:
        """The polygons of a band: between curves, or straight across the axes."""
        if high is None and low is None:
            patch.set_transform(self.axes.get_xaxis_transform())
            pairs = x[: len(x) // 2 * 2].reshape(-1, 2)
            return [np.array([(a, 0), (b, 0), (b, 1), (a, 1)]) for a, b in pairs]
        if high is None:  # the closed curve (x, y)
            points = np.column_stack([x, low])
            cuts = np.flatnonzero(~np.isfinite(points).all(axis=1))
            return [part[np.isfinite(part).all(axis=1)] for part in np.split(points, cuts)]
        bottom, top = self.axes.get_ylim()
        below, above = 2 * bottom - top, 2 * top - bottom
        if "y" in self.log:
            below, above = bottom**2 / top, top**2 / bottom
        low, high = (np.clip(bound, below, above) for bound in (low, high))
        if x is None:
            patch.set_transform(self.axes.get_yaxis_transform())
            pairs = np.column_stack([low, high])
            return [np.array([(0, a), (1, a), (1, b), (0, b)]) for a, b in pairs]
        good = np.isfinite(x + low + high)
        runs = np.split(np.arange(len(x)), np.flatnonzero(np.diff(good.astype(int))) + 1)
        there, back = np.column_stack([x, low]), np.column_stack([x, high])
        return [np.concatenate([there[k], back[k][::-1]]) for k in runs if len(k) and good[k[0]]]


def _colored(short: str, given: Mapping[str, object]) -> bool:
    """Does a style name a colour itself?"""
    letters = any(letter in short for letter in "bgrcmykwC")
    alone = len(short) > 1 and is_color_like(short)  # "1" is a marker
    return bool({"c", "color"} & set(given)) or letters or alone
