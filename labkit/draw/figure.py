"""The house figure: one style, one palette, a small PNG that never changes by itself.

pyplot is not used anywhere.

fig = figure(2, 1, height=5)
fig.axes[0].plot(t, x)
fig                                   # as the last line of a cell: the picture
fig.savefig("x.svg")                  # everything Matplotlib can do stays possible
"""

from __future__ import annotations

import io
import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal

import matplotlib.figure
import numpy as np
from matplotlib import cycler, patheffects, rc_context, rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.transforms import Bbox, ScaledTranslation
from PIL import Image

from ..arguments import asked
from ..model import ModelError, System
from ..run import write_whole
from ..show import latex_name
from .private import Canvas, closed, retitle, size_of_words, ticks_once, title_size
from .ticks import Between, Numbers, Spaced
from .words import MODE, described

#: Curves and modes, in order: Okabe and Ito's colours (jfly.uni-koeln.de/color), told apart by all
#: common kinds of colour vision; their yellow is left out (invisible on white) and black comes
#: last, since axes and text have it.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#000000")
#: Line styles that go with the first four colours where few curves share a panel: they survive grey
#: print.
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (5, 1.6, 1.2, 1.6)), (0, (1.4, 1.4)))
#: How strongly the backgrounds of the modes are tinted, in order: in grey print, too, one sees
#: where a mode ends.
BANDS = (0.11, 0.23, 0.16, 0.31)
ROW = 0.2  # inches that a row of a legend is high
LOW = 0.14  # the part of a picture's height from which on a legend stands beside the axes,
MOST = 0.16  # and, where it has no room there, is without the modes
INK, GREY, FAINT, GRID = "#222222", "#666666", "#8A8A8A", "#E3E3E3"

CSS_DPI = 96  # an inch on the page
PNG_DPI = 120  # of the saved picture, which is shown smaller: crisp on a dense screen too
PNG_BYTES = 60_000

_BOTH_TICKS = {"color": FAINT, "labelcolor": INK, "labelsize": 9.5, "direction": "out"}
_STYLES: dict[str, dict[str, Any]] = {
    "font": {"family": "DejaVu Sans", "size": 10.0},
    "mathtext": {"fontset": "dejavusans"},
    "text": {"usetex": False, "color": INK},
    "figure": {"facecolor": "white"},
    "savefig": {"facecolor": "auto", "edgecolor": "auto", "bbox": None, "transparent": False},
    "axes": {
        "unicode_minus": True,
        "facecolor": "white",
        "edgecolor": FAINT,
        "linewidth": 0.8,
        "labelcolor": INK,
        "labelsize": 11.0,
        "titlecolor": INK,
        "titlesize": 11.0,
        "titlelocation": "left",
        "titleweight": "normal",
        "spines.top": False,
        "spines.right": False,
        "grid": True,
        "axisbelow": True,
        "formatter.useoffset": False,
        "formatter.limits": (-4, 5),
        "xmargin": 0.0,
        "ymargin": 0.08,
        "prop_cycle": cycler(color=COLORS),
    },
    "grid": {"color": GRID, "linewidth": 0.7, "linestyle": "-"},
    "xtick": _BOTH_TICKS,
    "ytick": _BOTH_TICKS,
    "legend": {
        "frameon": False,
        "fontsize": 9.5,
        "handlelength": 2.0,
        "columnspacing": 1.4,
        "handletextpad": 0.5,
        "labelcolor": INK,
    },
    "lines": {"linewidth": 1.6, "solid_capstyle": "round", "solid_joinstyle": "round"},
    "patch": {"linewidth": 1.0},
    "path": {"simplify": True, "simplify_threshold": 1 / 9},
}
STYLE = {
    f"{group}.{name}": value for group, part in _STYLES.items() for name, value in part.items()
}

#: Behind moving words: a halo takes 6 ms
VEIL = {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75}
HALO = (patheffects.withStroke(linewidth=3.0, foreground="white"),)


def stroke(axes: Axes, **look: Any) -> Line2D:
    """stroke(axes, color=INK, lw=1.2) -> a line in the axes, still empty."""
    return axes.add_artist(Line2D([], [], **look))


def area(axes: Axes, **look: Any) -> PathPatch:
    """area(axes, facecolor=INK) -> a patch in the axes, still empty; see `reshape`."""
    return axes.add_artist(PathPatch(closed(), **look))


def word(axes: Axes, x: float, y: float, **look: Any) -> Any:
    """word(axes, 9, 9, fontsize=9) -> words on a veil, so many points beside their place."""
    options = {"textcoords": "offset points", "annotation_clip": True, "bbox": VEIL, **look}
    made = axes.annotate("", (0, 0), xytext=(x, y), **options)
    made.set_in_layout(False)
    return made


class HouseAxes(Axes):
    """Axes whose later titles and legends have the house style too, and ticks that have room."""

    #: title and entries of the legend as `head` has set them, and the inches that there were
    headed: tuple[str, list[tuple[Artist, str]], bool] | None = None
    roomed = (0.0, 0.0, 0.0)
    crown = (0.0, 0.0)  # how far the head reaches to the right of the axes, and above them
    lifted = 0  # by how many points a title stands higher, for a legend below it
    fitted = (0.0, 0.0, 0.0, 0.0)  # where it was, in inches, at the last call of `when_resized`
    bare = False  # the numbers along x stand at axes below alone

    def clear(self) -> None:
        """Also what this class keeps of what was in the axes; a new one clears itself first."""
        for name in ("headed", "crown", "lifted", "fitted", "bare", "resized", "whole"):
            vars(self).pop(name, None)
        with style():
            super().clear()
        self._space(self.xaxis)
        self._space(self.yaxis)

    def draw(self, renderer: Any) -> None:
        with ticks_once(self):
            super().draw(renderer)

    def get_tightbbox(self, *arguments: Any, **options: Any) -> Any:
        with ticks_once(self):
            return super().get_tightbbox(*arguments, **options)

    def tidy(self) -> bool:
        """Fits what has a size into axes that have another now; True where that moves axes."""
        room, moved = _room(self), False
        title = self.get_title("left")
        if self.headed is not None:
            near = zip(room, self.roomed, strict=True)
            same = all(0.96 < now / then < 1.18 for now, then in near if now + then)
            given = vars(self)["whole"].get(title, title)  # which an author may have changed
            if moved := not same or given != self.headed[0]:
                head(self, given, *self.headed[1:])
        elif title:
            shown = on_lines(self, title, title_size(self), room[1])
            if moved := shown != title:
                retitle(self, shown)
            moved |= self._lift(shown)
        moved |= self._break_labels() | self._spare_numbers()
        size = self.get_figure().get_size_inches()
        place = tuple(self.get_position().extents * np.tile(size, 2))
        if max(map(abs, np.subtract(place, self.fitted))) > 0.02:
            self.fitted = place
            for fit in vars(self).get("resized", ()):
                fit(*(self.get_position().size * size))
        return moved

    def _break_labels(self) -> bool:
        """Labels longer than there is room up to the edge of the figure, or to the next axes."""
        moved, figure, place = False, self.get_figure(), self.get_position()
        for axis, k in ((self.xaxis, 0), (self.yaxis, 1)):
            middle = (place.min[k] + place.max[k]) / 2
            others = [
                ax.get_position()
                for ax in figure.axes
                if ax is not self and (ax.get_xlabel, ax.get_ylabel)[k]()
            ]
            beside = [o for o in others if abs(o.min[1 - k] - place.min[1 - k]) < 0.02]
            rooms = [abs((o.min[k] + o.max[k]) / 2 - middle) for o in beside]
            room = min([2 * middle, 2 - 2 * middle, *filter(None, rooms)])
            room *= figure.get_size_inches()[k]
            words, label = axis.get_label_text(), axis.label
            if words and (shown := on_lines(self, words, label.get_fontsize(), room)) != words:
                label.set_text(shown)
                moved = True
        return moved

    def _spare_numbers(self) -> bool:
        """Over axes of the same limits, low axes have no numbers along x, and no label without."""
        figure, place = self.get_figure(), self.get_position()
        below = [
            other
            for other in figure.axes
            if other.axison
            and other.get_position().y1 < place.y0
            and np.allclose(other.get_position().intervalx, place.intervalx, atol=0.01)
            and other.get_xlim() == self.get_xlim()
            and other.get_xscale() == self.get_xscale()
            and self.get_xlabel() in ("", other.get_xlabel())
        ]
        numbers = self.bare or self.xaxis.get_tick_params().get("labelbottom", True)
        low = place.height * figure.get_figheight() < (1.2 if self.bare else 0.8)
        bare, label = bool(below and low and numbers), self.xaxis.label
        named = not below or (numbers and not bare)
        if moved := (bare, named) != (self.bare, label.get_visible()):
            self.bare = bare
            label.set_visible(named)
            if numbers:
                self.tick_params(labelbottom=not bare)
        return moved

    def _lift(self, words: str) -> bool:
        """Puts a title above a legend that an author has put where the title would be."""
        if (legend := self.get_legend()) is None:
            return False
        box, size, point = legend.get_window_extent(), title_size(self), self.get_figure().dpi / 72
        over = (box.y1 - self.bbox.y1) / point
        wide = 72 * max(_inches(line, size) for line in words.split("\n"))
        meet = over > 6 and (box.x0 - self.bbox.x0) / point < wide + size
        lift = round(over) if meet else 0
        if lift == self.lifted:
            return False
        self.lifted = lift
        retitle(self, words, over + 4 if lift else 6)
        return True

    def _space(self, axis: Any) -> None:
        if axis.get_scale() == "linear":
            axis.set_major_formatter(Numbers())
            if axis is self.xaxis:
                axis.set_major_locator(Spaced())
        elif axis.get_scale() == "log":
            axis.set_minor_formatter(Between())

    def set_xscale(self, *arguments: Any, **options: Any) -> None:
        super().set_xscale(*arguments, **options)
        self._space(self.xaxis)

    def set_yscale(self, *arguments: Any, **options: Any) -> None:
        super().set_yscale(*arguments, **options)
        self._space(self.yaxis)

    def set_title(self, *arguments: Any, **options: Any) -> Any:
        with style():
            return super().set_title(*arguments, **options)

    def legend(self, *arguments: Any, **options: Any) -> Any:
        self.headed = None  # an author's own takes the place of that of `head`
        with style():
            return super().legend(*arguments, **options)


class Figure(matplotlib.figure.Figure):
    """A Matplotlib figure that shows itself in a cell, as a palette PNG, the same bytes each time.

    Made by `figure`.

    fig.frozen = True    the axes stay where the layout has put them, which saves most of the time
                         of a redraw
    fig.steady = True    limits do not follow the data
    """

    frozen = steady = False

    def get_layout_engine(self) -> Any:
        return None if self.frozen else super().get_layout_engine()

    def draw(self, renderer: Any) -> None:
        self.arrange()
        before, self.frozen = self.frozen, True
        try:
            super().draw(renderer)
        finally:
            self.frozen = before

    def arrange(self) -> None:
        """Lays the axes out, and what depends on their sizes: legends, titles, mode diagrams.

        Each time takes the axes from where the one before has put them. Three are enough, but for
        axes of one scale, which come to their place by and by.
        """
        engine = None if self.frozen or not self.axes else self.get_layout_engine()
        places = self._places()
        for k in range(0 if self.frozen else 9):
            if engine is not None:
                engine.execute(self)
            moved = any([axes.tidy() for axes in self.axes if isinstance(axes, HouseAxes)])
            before, places = places, self._places()
            if not (moved and k < 2) and np.allclose(places, before, atol=0.004):
                break

    def _places(self) -> list[tuple[float, float, float, float]]:
        return [axes.get_position().bounds for axes in self.axes]

    def add_subplot(self, *arguments: Any, **options: Any) -> Axes:
        """fig.add_subplot(projection="polar"): as Matplotlib's, in the house style."""
        if not {"projection", "polar", "axes_class"} & set(options):
            options["axes_class"] = HouseAxes
        with style():
            return super().add_subplot(*arguments, **options)

    def png(self, dpi: float = PNG_DPI) -> bytes:
        """fig.png() -> the picture as PNG bytes: a palette, no date, no version.

        Artists marked animated are in it.
        """
        engine, before = super().get_layout_engine(), (self.dpi, self.frozen)
        with style():
            try:
                self.dpi = dpi
                self.arrange()
                self.frozen = True  # savefig would draw everything twice to lay it out
                self.savefig(io.BytesIO(), format="rgba", dpi=dpi)  # draws what is animated, too
            finally:
                self.dpi, self.frozen = before
                self.set_layout_engine(engine)  # savefig puts back the one that it has met: none
        return _palette_png(pixels(self.canvas.renderer))

    def save_png(self, path: str | os.PathLike, dpi: float = PNG_DPI) -> Path:
        """fig.save_png("spiral.png") -> path, the file written.

        Whole or not at all; ModelError when that fails.
        """
        return write_whole(path, self.png(dpi))

    @property
    def css_size(self) -> tuple[int, int]:
        """Width and height in CSS pixels at which a page shows the picture."""
        width, height = self.get_size_inches()
        return round(width * CSS_DPI), round(height * CSS_DPI)

    @property
    def alt(self) -> str:
        """What it shows, in words."""
        return described(self)

    def _repr_png_(self) -> bytes:
        return self.png()

    def _repr_mimebundle_(
        self, include: object = None, exclude: object = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        width, height = self.css_size
        more = {"width": width, "height": height, "alt": self.alt}
        return {"image/png": self.png()}, {"image/png": more}


def pixels(agg: RendererAgg) -> Image.Image:
    """pixels(agg) -> what it has drawn, without its transparency."""
    return Image.fromarray(np.asarray(agg.buffer_rgba())).convert("RGB")


_BYTES = np.array([1 << 16, 1 << 8, 1], dtype=np.int32)


def _palette_png(rgb: Image.Image) -> bytes:
    """As many colours as fit into PNG_BYTES, of 128, 64, 32, 20 (and with 20 whatever it takes).

    Half of them are kept exactly: those of areas (backgrounds, bands, a patch in a legend), however
    small, before the shades at the rims of letters. The others come from maximum coverage, which
    keeps the hue of a single thin line where median cut spends the palette on shades.
    """
    counted = rgb.getcolors(1 << 16) or rgb.getcolors(rgb.width * rgb.height)
    counts, found = (np.array(part, dtype=np.int32) for part in zip(*counted, strict=True))
    # Pillow's own mapping is good to 2 bits only: white turns grey
    place = np.zeros(1 << 24, dtype=np.uint16 if len(found) <= 1 << 16 else np.int32)
    place[found @ _BYTES] = np.arange(len(found))
    which = place[np.asarray(rgb, dtype=np.int32) @ _BYTES]  # the colour of each pixel
    within = which[1:-1, 1:-1]
    area = (within == which[:-2, 1:-1]) & (within == which[2:, 1:-1])
    area &= (within == which[1:-1, :-2]) & (within == which[1:-1, 2:])
    wide = np.bincount(within[area], minlength=len(found))  # pixels like their four neighbours
    order = np.lexsort((*found.T[::-1], -counts, -wide))
    found, rank = found[order], np.argsort(order)
    # every colour once is enough for maximum coverage
    each = Image.fromarray(found.astype(np.uint8)[None])
    for colors in (128, 64, 32, 20):
        rest = each.quantize(colors // 2, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
        table = np.concatenate(
            [found[: colors // 2], np.array(rest, dtype=np.int32).reshape(-1, 3)[: colors // 2]]
        )
        nearest = [
            sum(np.subtract.outer(*pair) ** 2 for pair in zip(part.T, table.T, strict=True)).argmin(
                1
            )
            for part in np.array_split(found, len(found) // 4096 + 1)
        ]
        picture = Image.fromarray(np.concatenate(nearest).astype(np.uint8)[rank][which], "P")
        picture.putpalette(table.astype(np.uint8).tobytes())
        out = io.BytesIO()
        picture.save(out, "PNG", compress_level=7)  # 9 takes five times as long for 5 % less
        if out.tell() <= PNG_BYTES:
            break
    return out.getvalue()


@asked
def figure(
    rows: int = 1,
    columns: int = 1,
    width: float = 9.0,
    height: float = 4.0,
    *,
    sharex: bool | Literal["all", "row", "col", "none"] = False,
    sharey: bool | Literal["all", "row", "col", "none"] = False,
    heights: Sequence[float] | None = None,
    widths: Sequence[float] | None = None,
    title: str = "",
) -> Figure:
    """figure(2, 1, height=5) -> Figure with rows × columns axes in fig.axes, row by row.

    In a constrained layout and in the house style.

    width, height in inches, 96 CSS pixels each; `heights` and `widths` are relative sizes of the
    rows and columns. rows=0 gives an empty figure. Raises ModelError for sizes that make no
    picture.
    """
    if not (1 <= width <= 40 and 0.5 <= height <= 60):
        raise ModelError(
            f"a figure of {width} × {height} inches: width lies in 1 … 40, height in 0.5 … 60"
        )
    if rows < 0 or columns < 0 or rows * columns > 100:
        raise ModelError(f"a figure of {rows} × {columns} panels: give at most 100")
    for sizes, count, what in ((heights, rows, "heights"), (widths, columns, "widths")):
        if sizes is not None and not (len(sizes) == count and min(sizes, default=1) > 0):
            raise ModelError(f"{what} of a figure must be {count} numbers > 0, not {sizes!r:.60}")
    with style():
        fig = Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")
        Canvas(fig)
        if rows * columns:
            ratios = {"height_ratios": heights, "width_ratios": widths}
            fig.subplots(rows, columns, sharex=sharex, sharey=sharey, **ratios)
        if title:
            fig.suptitle(title, x=0.01, ha="left", fontsize=12)
    return fig


@contextmanager
def style() -> Iterator[None]:
    """with style(): artists made inside have the house style.

    The user's rcParams are as before afterwards.

    One thread at a time: Jupyter lets panels answer in a thread of their own while a cell draws,
    and rcParams belong to all.
    """
    with _one_at_a_time:
        if rcParams["axes.prop_cycle"] is STYLE["axes.prop_cycle"]:  # within another `with style()`
            yield
        else:
            with rc_context(STYLE):
                yield


_one_at_a_time = threading.RLock()


@asked
def mode_colors(system: System) -> dict[str, str]:
    """mode_colors(system)["slip"] -> the colour that this mode has in every picture.

    It goes by the mode's place in system.modes.
    """
    return {name: COLORS[i % len(COLORS)] for i, name in enumerate(system.modes)}


def tint(color: str, strength: float = 0.15) -> tuple[float, float, float]:
    """tint("#D55E00") -> the colour mixed with white.

    Opaque, so that it looks the same whatever lies beneath.
    """
    return tuple(1 - strength * (1 - c) for c in to_rgb(color))  # type: ignore[return-value]


def symbol(name: str) -> str:
    """symbol("theta1") -> "$\\theta_{1}$": a state's name as it stands in a formula."""
    return f"${latex_name(name)}$"


def label(system: System, *names: str) -> str:
    """label(system, "x", "V") -> "$x$ [m], $V$ [m/s]"; one unit for all of them is written once."""
    units = [f" [{unit}]" if (unit := system.unit(name)) else "" for name in names]
    if len(set(units)) == 1:
        units[:-1] = [""] * (len(units) - 1)
    return ", ".join(symbol(name) + unit for name, unit in zip(names, units, strict=True))


def head(
    axes: Axes, title: str, entries: Sequence[tuple[Artist, str]], aside: bool = False
) -> None:
    """head(axes, "ball", [(line, "$y$")]): a title and, above the axes, a legend.

    So it never hides a curve. Side by side where both fit into the width of the axes; else the
    title stands above the legend, which may run on over what is to the right of the axes. Where
    this would take too much of the height (large type, many entries), or where wide axes ask for it
    (`aside`), the legend stands beside the axes; without room there, it does without the modes. A
    figure of another size sets both anew.
    """
    wide, reach, tall = axes.roomed = _room(axes)
    if fresh := getattr(axes, "headed", None) is None:
        wide = reach = 1.15 * wide  # the layout widens the axes at first
    axes.headed = title, list(entries), aside
    high = axes.get_figure().get_figheight()
    size, count = STYLE["legend.fontsize"], len(entries)
    room = reach - 3.1 * size / 72
    entries = [(artist, on_lines(axes, text, size, room)) for artist, text in entries]

    def needed(columns: int, handle: float) -> float:
        words = [max(_inches(line, size) for line in text.split("\n")) for _, text in entries]
        parts = np.array_split(words, columns)  # as a legend fills them
        return sum(part.max() + (handle + 1.9) * size / 72 for part in parts)

    while True:
        fitting = [
            (-(-count // columns), columns, handle)
            for handle in (2.0, 1.2)
            for columns in range(1, count + 1)
            if columns == 1 or needed(columns, handle) < reach
        ]
        # the first that has as few rows as can be
        rows, columns, handle = min(fitting, key=lambda one: one[0], default=(0, 1, 2.0))
        full = LOW * high < rows * ROW and count * ROW <= tall and needed(1, 1.2) < 0.4 * wide
        least = [entry for entry in entries if entry[0].get_gid() != MODE]
        if full or rows * ROW < MOST * high or len(least) == count:
            break
        entries, count = least, len(least)
    title = on_lines(axes, title, STYLE["axes.titlesize"], reach)
    over = (_inches(title.split("\n")[0], STYLE["axes.titlesize"]) + 0.2) if title else 0.0
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0)}
    beyond = 0.0
    if entries and (full or (aside and wide > 4.5)):
        place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
        rows, columns, handle = 0, 1, 1.2 if full else 2.0
        beyond = needed(1, handle)
    elif entries and "\n" not in title and over + needed(count, 2.0) < wide:
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
        rows, columns, handle, over = 1, count, 2.0, 0.0
    elif entries and title and "\n" not in title and over + needed(count, 1.2) < reach:
        right = ScaledTranslation(over, 0, axes.get_figure().dpi_scale_trans)
        place["bbox_transform"] = axes.transAxes + right
        rows, columns, handle, over = 1, count, 1.2, 0.0
    rows += max((text.count("\n") for _, text in entries), default=0) if rows else 0
    axes.crown = beyond, ROW * (rows + bool(over) + title.count("\n"))
    with style():
        if fresh:
            axes.set_title("", loc="left")
        retitle(axes, title, 8 + 72 * ROW * rows if over and rows else 6)
        if legend := axes.get_legend():
            legend.remove()
        if entries:
            place |= {"ncols": columns, "handlelength": handle}
            place |= {"borderaxespad": 0.2, "borderpad": 0.2}
            legend = Axes.legend(axes, *zip(*entries, strict=True), **place)
            if not beyond:  # the layout leaves it its height, and no width
                legend.get_tightbbox = partial(_upright, legend)


def _upright(legend: Legend, renderer: Any = None) -> Bbox:
    """The box of a legend, no wider than its axes."""
    box, axes = legend.get_window_extent(renderer), legend.axes.bbox
    return Bbox.from_extents(max(box.x0, axes.x0), box.y0, min(box.x1, axes.x1), box.y1)


def _room(axes: Axes) -> tuple[float, float, float]:
    """Inches for a head: width, as far as it may run on to the right, height with the head."""
    figure = axes.get_figure()
    scale = np.tile(figure.get_size_inches(), 2)
    x0, y0, x1, y1 = axes.get_position().extents * scale
    beyond, high = getattr(axes, "crown", (0.0, 0.0))
    reach = scale[0] - x0
    for other in figure.axes:
        left, low, _, top = other.get_position().extents * scale
        headed = other.get_title("left") or other.get_title() or other.get_legend()
        over = top + max(getattr(other, "crown", (0.0, 0.0))[1], 0.1) if headed else top - 0.1
        if left > x1 and low < y1 + 0.3 and over > y1:
            reach = min(reach, left - x0 - 0.1)
    return x1 - x0 + beyond, max(reach, x1 - x0), y1 - y0 + high


def when_resized(axes: Axes, fit: Callable[[float, float], None]) -> None:
    """when_resized(axes, fit): calls fit(width, height), in inches, once the axes are elsewhere.

    It may move what is in the axes, not the axes.
    """
    vars(axes).setdefault("resized", {})[fit] = None  # each once


def on_lines(axes: Axes, words: str, size: float, room: float) -> str:
    """on_lines(axes, "a long title", 11, 1.5): the words, on two lines if they need them."""
    whole = vars(axes).setdefault("whole", {})  # words on lines -> as they were given
    words = whole.get(words, words)
    parts = re.findall(r"(?:\$[^$]*\$|\S)+", words)
    if "\n" in words or len(parts) < 2 or _inches(words, size) <= room:
        return words
    pairs = [(" ".join(parts[:k]), " ".join(parts[k:])) for k in range(1, len(parts))]
    shown = "\n".join(min(pairs, key=lambda pair: max(_inches(line, size) for line in pair)))
    whole[shown] = words
    return shown


def _inches(words: str, size: float) -> float:
    """How wide words are, in the font of the house."""
    if not words:
        return 0.0
    prop = FontProperties(family="DejaVu Sans", size=size)
    return size_of_words(words, prop, words.count("$") > 1, 72.0)[0] / 72
