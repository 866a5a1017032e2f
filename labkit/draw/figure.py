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
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib import patheffects, rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from PIL import Image

from ..model import ModelError, System
from ..run import write_whole
from ..show import latex_name
from .private import Canvas, size_of_words
from .ticks import Numbers, Spaced
from .words import described

__all__ = [
    "COLORS",
    "DASHES",
    "Figure",
    "STYLE",
    "figure",
    "label",
    "mode_colors",
    "symbol",
    "tint",
]

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
INK, FAINT, GRID = "#222222", "#8A8A8A", "#E3E3E3"

CSS_DPI = 96  # an inch on the page
PNG_DPI = (
    120  # of the saved picture, which is shown smaller, at CSS_DPI: crisp on a dense screen too
)
PNG_BYTES = 60_000

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "mathtext.fontset": "dejavusans",
    "axes.unicode_minus": True,
    "text.usetex": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "auto",
    "savefig.edgecolor": "auto",
    "savefig.bbox": None,
    "savefig.transparent": False,
    "axes.facecolor": "white",
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.8,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.titleweight": "normal",
    "axes.labelsize": 11.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.08,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "grid.linestyle": "-",
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.handlelength": 2.0,
    "legend.columnspacing": 1.4,
    "legend.handletextpad": 0.5,
    "legend.labelcolor": INK,
    "text.color": INK,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "patch.linewidth": 1.0,
    "path.simplify": True,
    "path.simplify_threshold": 1 / 9,
}

VEIL = {
    "boxstyle": "square,pad=0.05",
    "facecolor": "white",
    "edgecolor": "none",
    "alpha": 0.75,
}  # behind moving words: a halo takes 6 ms
HALO = (patheffects.withStroke(linewidth=3.0, foreground="white"),)


class HouseAxes(Axes):
    """Axes whose later titles and legends have the house style too, and ticks that have room."""

    #: title and entries of the legend as `head` has set them, and the room that there was for them
    headed: tuple[str, list[tuple[Artist, str]]] | None = None
    roomed = 0.0
    lifted = 0  # by how many points a title stands higher, for a legend below it

    def __init__(self, *arguments: Any, **options: Any):
        super().__init__(*arguments, **options)
        self._space("x")
        self._space("y")

    def _space(self, which: str) -> None:
        if getattr(self, f"get_{which}scale")() == "linear":
            axis = getattr(self, f"{which}axis")
            axis.set_major_formatter(Numbers())
            if which == "x":
                axis.set_major_locator(Spaced())

    def set_xscale(self, *arguments: Any, **options: Any) -> None:
        super().set_xscale(*arguments, **options)
        self._space("x")

    def set_yscale(self, *arguments: Any, **options: Any) -> None:
        super().set_yscale(*arguments, **options)
        self._space("y")

    def set_title(self, *arguments: Any, **options: Any) -> Any:
        with style():
            return super().set_title(*arguments, **options)

    def legend(self, *arguments: Any, **options: Any) -> Any:
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
        self.tidy()
        super().draw(renderer)

    def tidy(self) -> None:
        """Sets titles and legends anew in axes that have become narrower or wider by a quarter."""
        for axes in self.axes:
            if (headed := getattr(axes, "headed", None)) is not None:
                wide = axes.get_position().width * self.get_figwidth()
                if not 0.85 < wide / axes.roomed < 1.25:
                    head(axes, *headed)
            elif axes.get_legend() is not None and axes.get_title("left"):
                self._lift(axes)

    def _lift(self, axes: Axes) -> None:
        """Puts a title above a legend that an author has put where the title would be."""
        renderer, words = self.canvas.get_renderer(), axes.get_title("left")
        box = axes.get_legend().get_window_extent(renderer)
        size = axes.title.get_fontsize()
        over = (box.y1 - axes.bbox.y1) * 72 / self.dpi
        wide = 72 * _inches(words, size)
        if over > 6 and (box.x0 - axes.bbox.x0) * 72 / self.dpi < wide + size:
            if getattr(axes, "lifted", 0) != round(over):
                axes.lifted = round(over)
                axes.set_title(words, loc="left", pad=over + 4)
        elif getattr(axes, "lifted", 0):
            axes.lifted = 0
            axes.set_title(words, loc="left", pad=6)

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
        buffer, engine, before = io.BytesIO(), super().get_layout_engine(), (self.dpi, self.frozen)
        with style():
            try:
                self.dpi = dpi
                self.tidy()
                if self.axes and engine is not None and not self.frozen:
                    engine.execute(self)
                self.frozen = (
                    True  # it is laid out now: savefig would draw everything twice for that
                )
                self.savefig(
                    buffer, format="rgba", dpi=dpi
                )  # the saving path: it draws animated artists as well
            finally:
                self.dpi, self.frozen = before
                self.set_layout_engine(engine)  # savefig puts back the one that it has met: none
        width = int(self.get_figwidth() * dpi + 0.5)
        pixels = buffer.tell() // 4  # Matplotlib's own rounding may differ by one pixel from ours
        width = next(
            w
            for w in (width, width - 1, width + 1)
            if pixels % w == 0 and abs(pixels / w - self.get_figheight() * dpi) < 1.5
        )
        rgb = Image.frombuffer("RGBA", (width, pixels // width), buffer.getvalue()).convert("RGB")
        return _palette_png(rgb)

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


def _palette_png(rgb: Image.Image) -> bytes:
    """As many colours as fit into PNG_BYTES, of 128, 64, 32, 20 (and with 20 whatever it takes).

    Half of them are kept exactly: those of areas (backgrounds, bands, a patch in a legend), however
    small, before the shades at the rims of letters. The others come from maximum coverage, which
    keeps the hue of a single thin line where median cut spends the palette on shades.
    """
    key = np.asarray(rgb, dtype=np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)
    within = key[1:-1, 1:-1]  # pixels like their four neighbours
    area = np.logical_and.reduce(
        [
            within == key[y : y + len(within), x : x + within.shape[1]]
            for y, x in ((0, 1), (2, 1), (1, 0), (1, 2))
        ]
    )
    wide = dict(
        zip(*(part.tolist() for part in np.unique(within[area], return_counts=True)), strict=True)
    )
    counted = sorted(
        rgb.getcolors(1 << 16) or rgb.getcolors(rgb.width * rgb.height),
        key=lambda pair: (
            -wide.get(pair[1][0] << 16 | pair[1][1] << 8 | pair[1][2], 0),
            -pair[0],
            pair[1],
        ),
    )
    found = np.array([color for _, color in counted], dtype=np.int32)
    place = np.zeros(
        1 << 24, dtype=np.uint8
    )  # palette index of each colour; Pillow's own mapping is good to 2 bits only: white turns grey
    each = Image.fromarray(
        found.astype(np.uint8)[None]
    )  # every colour once is enough for maximum coverage
    for colors in (128, 64, 32, 20):
        rest = each.quantize(colors // 2, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
        table = np.concatenate(
            [found[: colors // 2], np.array(rest, dtype=np.int32).reshape(-1, 3)[: colors // 2]]
        )
        for part in np.array_split(found, len(found) // 4096 + 1):
            place[part @ [1 << 16, 1 << 8, 1]] = (
                ((part[:, None, :] - table) ** 2).sum(axis=2).argmin(axis=1)
            )
        picture = Image.fromarray(place[key], "P")
        picture.putpalette(table.astype(np.uint8).tobytes())
        out = io.BytesIO()
        picture.save(out, "PNG", compress_level=7)  # 9 takes five times as long for 5 % less
        if out.tell() <= PNG_BYTES:
            break
    return out.getvalue()


def figure(
    rows: int = 1,
    columns: int = 1,
    width: float = 9.0,
    height: float = 4.0,
    *,
    sharex: bool | str = False,
    sharey: bool | str = False,
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
            f"a figure of {width} × {height} inches: width must lie in 1 … 40 and height in "
            "0.5 … 60"
        )
    if rows < 0 or columns < 0 or rows * columns > 100:
        raise ModelError(f"a figure of {rows} × {columns} panels: give at most 100")
    with style():
        fig = Figure(figsize=(width, height), dpi=PNG_DPI, layout="constrained")
        Canvas(fig)
        if rows * columns:
            fig.subplots(
                rows,
                columns,
                sharex=sharex,
                sharey=sharey,
                squeeze=False,
                gridspec_kw={"height_ratios": heights, "width_ratios": widths},
            )
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
    with _one_at_a_time, rc_context({**STYLE, "axes.prop_cycle": matplotlib.cycler(color=COLORS)}):
        yield


_one_at_a_time = threading.RLock()


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
    units = [system.unit(name) for name in names]
    if len(set(units)) == 1:
        return ", ".join(map(symbol, names)) + (f" [{units[0]}]" if units[0] else "")
    return ", ".join(
        symbol(name) + (f" [{unit}]" if unit else "")
        for name, unit in zip(names, units, strict=True)
    )


def head(axes: Axes, title: str, entries: Sequence[tuple[Artist, str]]) -> None:
    """head(axes, "ball", [(line, "$y$")]): a title and, above the axes, a legend.

    So it never hides a curve. Side by side where both fit into the width of the axes, else the
    title stands above the legend; a figure that has become narrower sets them anew.
    """
    wide = axes.get_position().width * axes.get_figure().get_figwidth()
    room = 1.15 * wide if getattr(axes, "headed", None) is None else wide
    axes.headed, axes.roomed = (title, list(entries)), wide  # the layout widens the axes at first
    widths = [_inches(text, STYLE["legend.fontsize"]) + 0.5 for _, text in entries]
    across = 0.0 if not widths else max(widths)
    columns = max(1, min(len(entries), int(room / across) if across else 1))
    rows = -(-len(entries) // columns)
    with style():
        beside = _inches(title, STYLE["axes.titlesize"]) + 0.2 + sum(widths) < room
        axes.set_title(
            title,
            loc="left",
            pad=6 if beside or not title or not entries else 8 + 15 * rows,
        )
        if legend := axes.get_legend():
            legend.remove()
        if entries:
            axes.legend(
                *zip(*entries, strict=True),
                loc="lower right" if beside else "lower left",
                bbox_to_anchor=(1.0, 1.0) if beside else (0.0, 1.0),
                ncols=len(entries) if beside else columns,
                borderaxespad=0.2,
                borderpad=0.2,
            )


def _inches(words: str, size: float) -> float:
    """How wide words are, in the font of the house."""
    if not words:
        return 0.0
    prop = FontProperties(family="DejaVu Sans", size=size)
    return size_of_words(words, prop, words.count("$") > 1, 72.0)[0] / 72
