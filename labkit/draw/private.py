"""What this package takes of Matplotlib that is private, or does not do what its manual says.

Each has a test in tests/test_draw.py; pyproject.toml bounds the versions for which they hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.font_manager import FontProperties, fontManager, get_font
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import PathPatch
from matplotlib.path import Path


def reshape(patch: PathPatch, path: Path) -> None:
    """reshape(patch, path): PathPatch.set_path, which forgets to say that the patch has changed."""
    patch.set_path(path)
    patch.stale = True


def closed(*polygons: np.ndarray) -> Path:
    """closed((n, 2), (m, 2)) -> one path of closed polygons; of none, an empty one."""
    shown = [polygon for polygon in polygons if len(polygon)]
    if not shown:
        return Path(np.zeros((0, 2)))
    points = np.concatenate([np.append(polygon, polygon[:1], axis=0) for polygon in shown])
    codes = np.full(len(points), Path.LINETO, dtype=Path.code_type)
    ends = np.cumsum([len(polygon) + 1 for polygon in shown])
    codes[np.append(0, ends[:-1])], codes[ends - 1] = Path.MOVETO, Path.CLOSEPOLY
    return Path(points, codes)


def measure_as(renderer: Any, agg: RendererAgg) -> None:
    """Another renderer measures words and lines as this one does."""
    renderer.get_text_width_height_descent = agg.get_text_width_height_descent
    renderer._get_font_height_metrics = agg._get_font_height_metrics


def title_size(axes: Axes) -> float:
    """The size of the title on the left, in points: get_title gives its words alone."""
    return float(axes._left_title.get_fontsize())


def retitle(axes: Axes, words: str, pad: float | None = None) -> None:
    """Other words on the left, so many points higher: set_title would undo an author's look."""
    axes._left_title.set_text(words)
    axes.stale = True
    if pad is not None:
        axes._set_title_offset_trans(pad)


def tick_size(axis: Any) -> float:
    """The size of the numbers on an axis, in points."""
    return float(axis._get_tick_label_size(axis.axis_name))


@contextmanager
def ticks_once(axes: Axes) -> Iterator[None]:
    """with ticks_once(axes): where its ticks are and how large their numbers, found out only once.

    For one drawing or measuring of the axes Matplotlib does it four times, for the labels, the
    title and each spine anew.
    """
    found = "_update_ticks", "_get_ticklabel_bboxes"
    changed = [axis for axis in (axes.xaxis, axes.yaxis) if not vars(axis).keys() & set(found)]
    for axis in changed:
        vars(axis).update({name: _once(getattr(axis, name)) for name in found})
    try:
        yield
    finally:
        for axis in changed:
            for name in found:
                vars(axis).pop(name, None)  # gone, if another thread has drawn the axes meanwhile


def _once(function: Callable[..., Any]) -> Callable[..., Any]:
    results: list[Any] = []

    def call(*arguments: Any) -> Any:
        results or results.append(function(*arguments))
        return results[0]

    return call


class Renderer(RendererAgg):
    """Agg that remembers from one figure to the next how large words and formulas are.

    Matplotlib measures all anew in each figure.
    """

    _formulas = MathTextParser("path")  # parsing one takes 10 ms

    def __init__(self, width: float, height: float, dpi: float):
        super().__init__(width, height, dpi)
        self.mathtext_parser = self._formulas

    def get_text_width_height_descent(
        self, s: str, prop: FontProperties, ismath: Any
    ) -> tuple[float, float, float]:
        return size_of_words(s, prop.copy(), ismath, self.dpi)

    def _get_font_height_metrics(self, prop: FontProperties) -> tuple[float, float, float]:
        return _size_of_lines(prop.copy(), self.dpi)


@lru_cache(8192)
def size_of_words(
    s: str, prop: FontProperties, ismath: Any, dpi: float
) -> tuple[float, float, float]:
    return RendererAgg.get_text_width_height_descent(_measure(dpi), s, prop, ismath)


@lru_cache(256)
def _size_of_lines(prop: FontProperties, dpi: float) -> tuple[float, float, float]:
    """Ascent, descent and gap of lines, as text.py reads them from the font."""
    font = get_font(fontManager.findfont(prop))
    line, units = font.get_sfnt_table("OS/2"), font.get_sfnt_table("head")["unitsPerEm"]
    up, down, gap = (line[f"sTypo{name}"] for name in ("Ascender", "Descender", "LineGap"))
    scale = prop.get_size_in_points() * dpi / 72 / units
    return up * scale, -down * scale, gap * scale


@lru_cache(4)
def _measure(dpi: float) -> Renderer:
    return Renderer(1, 1, dpi)


class Canvas(FigureCanvasAgg):
    """The canvas of a Figure: FigureCanvasAgg with our Renderer."""

    def get_renderer(self) -> Renderer:
        key = *self.get_width_height(physical=True), self.figure.dpi
        if self._lastKey != key:
            self.renderer, self._lastKey = Renderer(*key), key
        return self.renderer
