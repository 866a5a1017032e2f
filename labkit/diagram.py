"""The modes of a system and the transitions between them as a picture.

Boxes stand in a row, with arcs above (forward) and below (back).

    mode_diagram(boost)
    mode_diagram(boost, axes=fig.axes[1])     # a View: the mode of the cursor's instant is lit

In a row arcs nest and never meet a box, whatever the graph. Every label is measured and set at
the lowest height where it meets neither another label nor another arc (in a crowd perhaps a line,
never a label). One data unit is one inch.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from .arguments import asked
from .draw.figure import INK, VEIL, Figure, figure, mode_colors, style, tint, when_resized
from .draw.view import View
from .equations import Equations
from .model import At, Every, System, Transition

__all__ = ["mode_diagram"]

LINE = "#555555"
CLEAR = 0.04  # inches kept free round every label
LETTERS = {1: 24, 2: 22, 3: 18, 4: 15}  # a label's line, by the number of modes; 12 with more


@dataclass
class _Node:
    """A box, or the end mark (no texts), by its centre; y = 0 for all."""

    width: float
    height: float
    texts: list[Text] = field(default_factory=list)
    x: float = 0.0


@dataclass
class _Arc:
    source: int
    target: int
    text: Text | None
    dashed: bool = False
    ends: list[float] = field(default_factory=lambda: [0.0, 0.0])  # x where it leaves and arrives
    height: float = 0.0  # of its top over the boxes
    control: np.ndarray | None = None  # (4, 2) of its Bézier curve
    points: np.ndarray | None = None
    box: Bbox | None = None  # of its label

    @property
    def side(self) -> int:
        return -1 if self.target < self.source else 1


@asked
def mode_diagram(system: System, axes: Axes | None = None) -> Figure | View:
    """mode_diagram(system) -> figure: modes as boxes in their colours, transitions as arrows.

    The dot is the start, the ring the end. Under a transition's name stands its condition: y ↓ 0
    means that y falls through 0. Dashed: taken when events pile up (Zeno).

    mode_diagram(system, axes=fig.axes[1]) -> a View for the list that a panel's `draw` returns:
    names and arrows only, and the mode of the cursor's instant is lit. An inch of height is enough.

    Raises ModelError for what is no System.
    """
    if axes is not None:
        return _Lit(system, axes)
    with style():
        fig = figure()
        fig.set_layout_engine("none")
        axes = fig.axes[0]
        axes.set_position([0, 0, 1, 1])
        axes.set_axis_off()
        nodes = _nodes(axes, system)
        arcs = _arcs(axes, system)
        _place_nodes(nodes, arcs)
        _place_ends(nodes, arcs)
        _place_labels(nodes, arcs)
        _draw(fig, axes, system, nodes, arcs)
    return fig


def _nodes(axes: Axes, system: System) -> list[_Node]:
    nodes = []
    for name, mode in system.modes.items():
        texts = [_text(axes, textwrap.fill(name, 16), 10.5, fontweight="bold")]
        if mode.meaning:
            texts.append(_text(axes, textwrap.fill(mode.meaning, 20), 8.5))
        sizes = [_size(text) for text in texts]
        width = max(0.9, max(w for w, _ in sizes) + 0.3)
        nodes.append(_Node(width, sum(h for _, h in sizes) + 0.07 * len(texts) + 0.24, texts))
    height = max(node.height for node in nodes)
    for node in nodes:
        node.height = height
    ends = any(tr.target is None for tr in system.transitions)
    return [*nodes, _Node(0.3, 0.3)] if ends else nodes


def _arcs(axes: Axes, system: System) -> list[_Arc]:
    keys = {name: i for i, name in enumerate([*system.modes, None])}
    letters = LETTERS.get(len(system.modes), 12)
    formulas = Equations(system, whole=False)
    arcs = []
    for k, tr in enumerate(system.transitions):
        lines = textwrap.fill(tr.label, letters), _condition(axes, formulas, k, tr, letters)
        words = "\n".join(filter(None, lines))
        sources = sorted(tr.sources, key=lambda source: -abs(keys[source] - keys[tr.target]))
        for i, source in enumerate(sources):
            # from three sources on, one label at the widest arc is enough
            said = words and (i == 0 or len(sources) < 3)
            text = _text(axes, words, 9, bbox=VEIL) if said else None
            arcs.append(_Arc(keys[source], keys[tr.target], text))
        arcs += [
            _Arc(keys[source], keys[tr.zeno], _text(axes, "Zeno", 9), dashed=True)
            for source in sources
            if tr.zeno not in (None, source)
        ]
    return arcs


def _condition(axes: Axes, formulas: Equations, k: int, tr: Transition, letters: int) -> str:
    """The second line of a label; nothing where it is too long or more than Matplotlib can set."""
    guard = formulas.guards[k]
    if isinstance(tr.at, Every):
        text = f"every ${formulas.latex(tr.at.period)}$"
        if tr.at.first is not None:
            text += f", first ${formulas.latex(tr.at.first)}$"
    elif isinstance(tr.at, At):
        text = "at $t = " + ",\\ ".join(map(formulas.latex, tr.at.instants)) + "$"
    elif hasattr(guard, "why"):
        return ""
    else:
        sign = {-1: r"\downarrow", 1: r"\uparrow", 0: "="}[tr.direction]
        text = f"${formulas.latex(guard)} {sign} 0$"
        text = text.replace("\\left|", "|").replace("\\right|", "|").replace("\\frac", "\\dfrac")
    if callable(tr.delay) or isinstance(tr.delay, str) or tr.delay:
        text += f", delay ${formulas.latex(tr.delay)}$"
    try:
        MathTextParser("path").parse(text)
    except ValueError:
        return ""
    trial = _text(axes, text, 9)
    width = _size(trial)[0]
    trial.remove()
    return text if width < letters * 0.09 else ""


def _text(axes: Axes, words: str, size: float, **options: object) -> Text:
    look = {"ha": "center", "va": "center", "color": INK, "linespacing": 1.25, "zorder": 5}
    return axes.text(0, 0, words, fontsize=size, **look, **options)


def _size(text: Text) -> tuple[float, float]:
    """Width and height in inches."""
    box = text.get_window_extent(text.figure.canvas.get_renderer())
    return box.width / text.figure.dpi, box.height / text.figure.dpi


def _place_nodes(nodes: list[_Node], arcs: list[_Arc]) -> None:
    """From left to right, with gaps that hold the labels between neighbours."""
    x = 0.0
    for i, node in enumerate(nodes):
        between = [a.text for a in arcs if a.text and {a.source, a.target} == {i - 1, i}]
        x += max([0.75, *(_size(text)[0] - 0.15 for text in between)]) if i else 0.0
        node.x = x + node.width / 2
        x += node.width


def _place_ends(nodes: list[_Node], arcs: list[_Arc]) -> None:
    """Spread the arcs over the top and bottom edges so that those of one box nest.

    Short ones are outside, self loops amid.
    """
    for i, node in enumerate(nodes):
        for side in (1, -1):
            here = []
            for k, arc in enumerate(arcs):
                pair = (arc.source, arc.target)
                for end in (0, 1) if arc.side == side else ():
                    if pair[end] == i:  # from the left, among itself, to the right
                        far = pair[1 - end] - i
                        turn = k if far else k + 1 if end else -k - 1
                        here.append((np.sign(far), -far, -turn if far > 0 else turn, arc, end))
            here.sort(key=lambda item: item[:3])
            for position, (*_, arc, end) in enumerate(here):
                arc.ends[end] = node.x + node.width * 0.84 * ((position + 0.5) / len(here) - 0.5)


def _place_labels(nodes: list[_Node], arcs: list[_Arc]) -> None:
    """Short arcs first; each as low as its label, and what lies already, allow."""
    done: list[_Arc] = []
    for arc in sorted(arcs, key=lambda arc: abs(arc.ends[0] - arc.ends[1])):
        span = abs(arc.ends[0] - arc.ends[1])
        size = np.array(_size(arc.text)) if arc.text else np.zeros(2)
        lowest = 0.34 + 0.12 * span
        shifts = (0.0, -0.12, 0.12, -0.25, 0.25, -0.4, 0.4)
        shifts = [shift for shift in shifts if abs(shift) <= 0.3 * max(span, 0.5)]
        best = None
        for height, shift in product(lowest + 0.07 * np.arange(60), shifts):
            _shape(nodes, arc, height)
            top = arc.points[:, 1].max() if arc.side > 0 else arc.points[:, 1].min()
            middle = np.array([sum(arc.ends) / 2 + shift, top + arc.side * (0.05 + size[1] / 2)])
            arc.box = Bbox([middle - size / 2, middle + size / 2]) if arc.text else None
            clashes = sum(_clash(arc, other) for other in done if other.side == arc.side)
            if best is None or clashes < best[0]:
                best = clashes, height, arc.control, arc.points, arc.box
            if clashes == 0:
                break
        _, arc.height, arc.control, arc.points, arc.box = best
        done.append(arc)


def _shape(nodes: list[_Node], arc: _Arc, height: float) -> None:
    (x0, y0), (x1, y1) = (
        (x, arc.side * nodes[k].height / 2)
        for x, k in zip(arc.ends, (arc.source, arc.target), strict=True)
    )
    bulge = 0.3 * np.sign(x1 - x0) if arc.source == arc.target else 0.0  # a self loop is rounder
    top = arc.side * (max(abs(y0), abs(y1)) + 4 / 3 * height)
    arc.control = np.array([(x0, y0), (x0 - bulge, top), (x1 + bulge, top), (x1, y1)])
    u = np.linspace(0, 1, 41)[:, None]
    weights = np.hstack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
    arc.points = weights @ arc.control


def _clash(a: _Arc, b: _Arc) -> int:
    """How bad it is that two arcs lie as they do: 100 a label on a label, 1 a label on a line."""
    boxes = [arc.box.padded(CLEAR) if arc.box else None for arc in (a, b)]
    count = 100 * bool(all(boxes) and boxes[0].overlaps(b.box))
    return count + sum(
        box is not None and box.count_contains(arc.points) > 0
        for box, arc in zip(boxes, (b, a), strict=True)
    )


def _box(axes: Axes, color: str) -> FancyBboxPatch:
    """A mode's box in its colour; `_fill` gives it its place."""
    look = {"fc": tint(color, 0.18), "ec": color, "lw": 1.8, "zorder": 3}
    rounded = "round,pad=0,rounding_size=0.12"
    return axes.add_patch(FancyBboxPatch((0, 0), 1, 1, boxstyle=rounded, **look))


def _fill(box: FancyBboxPatch, node: _Node) -> None:
    """Puts a box and the words in it, one below the other, where its node is."""
    box.set_bounds(node.x - node.width / 2, -node.height / 2, node.width, node.height)
    sizes = [_size(text)[1] for text in node.texts]
    y = (sum(sizes) + 0.07 * (len(sizes) - 1)) / 2
    for text, height in zip(node.texts, sizes, strict=True):
        text.set_position((node.x, y - height / 2))
        y -= height + 0.07


def _draw(fig: Figure, axes: Axes, system: System, nodes: list[_Node], arcs: list[_Arc]) -> None:
    colors = mode_colors(system)
    for node, (name, color) in zip(nodes, colors.items(), strict=False):
        _fill(_box(axes, color), node)
        decides = callable(system.mode)  # the start state does: then the dot is open
        if decides or system.mode == name:  # where a run begins
            edge = node.x - node.width / 2
            _arrow(axes, posA=(edge - 0.36, 0), posB=(edge, 0), shrinkA=0, shrinkB=0)
            _circle(axes, edge - 0.36, 0.055, 4, fc="white" if decides else LINE, lw=1.3)
    for node in nodes[len(colors) :]:
        _circle(axes, node.x, 0.15, 3, fc="white", lw=1.3)
        _circle(axes, node.x, 0.085, 4, fc=LINE)
    for arc in arcs:
        _draw_arc(axes, arc)
        if arc.text and arc.box:
            arc.text.set_position(((arc.box.x0 + arc.box.x1) / 2, (arc.box.y0 + arc.box.y1) / 2))
    words = f"{system.name}: modes and transitions"
    title = axes.text(0, 0, words, fontsize=11, color=INK, ha="left", va="top")
    boxes = [arc.box for arc in arcs if arc.box]
    boxes += [Bbox([arc.points.min(axis=0), arc.points.max(axis=0)]) for arc in arcs]
    for node in nodes:
        left, low = node.x - node.width / 2 - 0.42, -node.height / 2
        boxes.append(Bbox.from_bounds(left, low, node.width + 0.42, node.height))
    whole = Bbox.union(boxes).padded(0.15)
    whole.x1 = max(whole.x1, whole.x0 + _size(title)[0] + 0.3)
    whole.y1 += 0.3
    title.set_position((whole.x0 + 0.1, whole.y1 - 0.08))
    fig.set_size_inches(whole.width, whole.height)
    axes.set(xlim=(whole.x0, whole.x1), ylim=(whole.y0, whole.y1))


def _draw_arc(axes: Axes, arc: _Arc) -> FancyArrowPatch:
    path = Path(arc.control, [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])
    return _arrow(axes, path=path, ls="--" if arc.dashed else "-")


def _arrow(axes: Axes, **options: Any) -> FancyArrowPatch:
    look = {"arrowstyle": "-|>", "mutation_scale": 11, "lw": 1.3, "color": LINE}
    return axes.add_patch(FancyArrowPatch(**options, **look))


def _circle(axes: Axes, x: float, radius: float, zorder: int, **look: Any) -> None:
    axes.add_patch(Circle((x, 0), radius, ec=LINE, zorder=zorder, **look))


class _Lit(View):
    """The boxes and arrows alone, stretched over axes; the box of the present mode is filled.

    Words keep their size in axes of any size, so the figure has all placed anew when that changes.
    """

    ready = False

    def __init__(self, system: System, axes: Axes):
        self.axes, self.figure, self.now = axes, axes.get_figure(), ""
        axes.set_axis_off()
        self.colors, self.arrows = mode_colors(system), []
        self.boxes = {name: _box(axes, color) for name, color in self.colors.items()}
        self.words = {name: _text(axes, name, 10.5) for name in self.colors}
        self.artists = [*self.boxes.values(), *self.words.values()]
        keys = {name: k for k, name in enumerate(self.colors)}
        self.pairs = {
            (keys[source], keys[target])
            for tr in system.transitions
            for source in tr.sources
            for target in (tr.target, tr.zeno)
            if target is not None and target != source
        }
        when_resized(axes, self._fit)
        self._fit(*axes.get_position().size * self.figure.get_size_inches())

    def _fit(self, wide: float, high: float) -> None:
        """Fits all into so many inches: words on as many lines, and gaps as small, as must be.

        Where even this is too wide, only the name of the present mode is written.
        """
        for letters, gap in ((14, 0.6), (14, 0.12), (1, 0.12)):
            for name, text in self.words.items():
                text.set(text=textwrap.fill(name, letters, break_long_words=False), visible=True)
            sizes = np.array([_size(text) for text in self.words.values()])
            widths = np.maximum(sizes[:, 0] + 0.12, 1.5 * gap)
            total = widths.sum() + gap * len(widths)
            if total <= wide:
                break
        self.whole = total <= wide
        if not self.whole:
            widths[:] = total / len(widths) - gap
            for name, text in self.words.items():
                text.set_text(textwrap.fill(name, 14))
        middles = np.cumsum(widths + gap) - widths / 2 - gap / 2
        columns = zip(widths, self.words.values(), middles, strict=True)
        nodes = [_Node(width, 0.9, [text], x) for width, text, x in columns]
        arcs = [_Arc(source, target, None) for source, target in sorted(self.pairs)]
        _place_ends(nodes, arcs)
        _place_labels(nodes, arcs)
        above = max([0.0, *(np.abs(arc.points[:, 1]).max() - 0.35 for arc in arcs)])
        need = sizes[:, 1].max() + 0.08  # inches, once all is stretched to the height
        for node in nodes:
            node.height = max(0.9, 2 * above * need / max(high - need, 0.2 * high))
        for arrow in self.arrows:
            arrow.remove()
        for arc in arcs:
            _shape(nodes, arc, arc.height)
        self.arrows = [_draw_arc(self.axes, arc) for arc in arcs]
        for box, node in zip(self.boxes.values(), nodes, strict=True):
            _fill(box, node)
        for text in self.words.values():
            text.set_bbox(None if self.whole else VEIL)
            text.set_x(text.get_position()[0] if self.whole else total / 2)
        tall = nodes[0].height / 2 + above
        self.axes.set(xlim=(0, total), ylim=(-tall, tall))
        self._light()

    def update(self, run: Any) -> None:
        self.at(run, run.t[0])

    def at(self, run: Any, t: float) -> None:
        self.now = run.at(t)["mode"]
        self._light()

    def _light(self) -> None:
        for name, box in self.boxes.items():
            now = name == self.now
            box.set_facecolor(tint(self.colors[name], 0.75 if now else 0.06))
            box.set_linewidth(3.0 if now else 1.2)
            self.words[name].set_visible(self.whole or now)
