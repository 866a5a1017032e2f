"""What a hand adds to a picture on the screen.

Handles to drag, a time cursor, a held run, trajectories that a click has started.

    Handle(axes, "alpha", "beta")         # its place sets two parameters; a panel's `draw` lists it
    Handle(axes, place=lambda run: (…, …), values=lambda x, y: {"a": …, "b": …})
    Overlay(view.shows)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..arguments import asked
from ..model import ModelError, check_names
from ..run import Run
from .figure import COLORS, DASHES, FAINT, INK, stroke
from .layers import strung
from .view import Shows, View


class Handle(View):
    """Handle(axes, "x", "v"): a dot that mouse, finger and arrow keys move.

    Its place sets parameters or start values.

    names    two parameters or states: the dot stands at their values, (x, v), in the coordinates of
             the axes
    place    place(run) -> (x, y), where the dot stands for a run, if that is something else
    values   values(x, y) -> {name: value} for a new place, if that is something else; may be fewer
             or more than two
    click    True: a click anywhere in the axes brings the dot there (a map of a sweep)
    A panel clips the values to the ranges of the sliders. Raises ModelError when names are missing.
    """

    ready = False

    @asked
    def __init__(
        self,
        axes: Axes,
        *names: str,
        place: Callable[[Run], tuple[float, float]] | None = None,
        values: Callable[[float, float], Mapping[str, float]] | None = None,
        color: str = COLORS[1],
        meaning: str = "",
        click: bool = False,
    ):
        if len(names) != 2 and (place is None or values is None):
            raise ModelError(
                "a Handle needs the names of two parameters or states, or place= and values="
            )
        self.axes, self.figure, self.click = axes, axes.get_figure(), click
        self.meaning = meaning or ", ".join(names) or "handle"
        self.names = names
        self.place = place or self._stands
        self.values = values or (lambda x, y: dict(zip(names, (x, y), strict=True)))
        look = {"ls": "none", "marker": "o", "ms": 10, "mfc": "white", "mec": color, "mew": 2.4}
        self.dot = stroke(axes, zorder=9, **look)
        self.artists = [self.dot]

    def _stands(self, run: Run) -> tuple[float, ...]:
        known = {**run.p._asdict(), **run.start}
        said = f"a Handle names {{}}, no parameter or state of {run.system.name!r}"
        check_names(self.names, known, said)
        return tuple(known[name] for name in self.names)

    def update(self, run: Run) -> None:
        self.at_place = tuple(map(float, self.place(run)))
        self.dot.set_data(*([value] for value in self.at_place))


class Overlay(View):
    """Overlay(shows): artists over the axes of a view; all are empty at first.

    overlay.point(run, t)   the cursor: a line in time plots, a dot on every curve; t = None takes
                            it away
    overlay.hold(run)       the run as a grey ghost; None takes it away
    overlay.add(runs)       trajectories that clicks have started, in all planes
    """

    def __init__(self, shows: Iterable[Shows]):
        self.shows = list(shows)
        self.artists, self.lines, self.dots = [], [], []
        self.curves, self.starts, self.ghosts = [], [], []
        dots = {"ls": "none", "marker": "o"}
        orange = {"color": COLORS[1], "mec": "white", "zorder": 8.5}
        green = {"color": COLORS[2], "mfc": "white", "zorder": 4.7}
        grey = {"color": FAINT, "lw": 2.6, "alpha": 0.55, "zorder": 2.7}
        for show in self.shows:
            ax, upright = show.axes, show.axes.get_xaxis_transform()
            look = {"color": INK, "lw": 0.9, "alpha": 0.7, "zorder": 8}
            self.lines.append(self._stroke(ax, transform=upright, **look))
            self.dots.append(self._stroke(ax, ms=7, **dots, **orange))
            self.curves.append(self._stroke(ax, color=COLORS[2], lw=1.5, zorder=4.6))
            self.starts.append(self._stroke(ax, ms=5, **dots, **green))
            # told apart by their dashes, as the curves are
            dashes = [DASHES[k % len(DASHES)] for k, _ in enumerate(show.names)]
            self.ghosts.append([self._stroke(ax, ls=dash, **grey) for dash in dashes])

    def _stroke(self, axes: Axes, **look: Any) -> Line2D:
        self.artists.append(stroke(axes, **look))
        self.artists[-1].set_in_layout(False)
        return self.artists[-1]  # type: ignore[return-value]

    def update(self, run: Run) -> None:
        """Nothing: what stands here belongs to instants and to other runs."""

    def point(self, run: Run, t: float | None) -> None:
        for show, line, dot in zip(self.shows, self.lines, self.dots, strict=True):
            there = [] if t is None else show.points(run, t)
            dot.set_data([x for x, _ in there], [y for _, y in there])
            line.set_data(*(([t, t], [0, 1]) if there and show.x == "t" else ([], [])))

    def hold(self, run: Run | None) -> None:
        for show, lines in zip(self.shows, self.ghosts, strict=True):
            for name, line in zip(show.names, lines, strict=True):
                line.set_data(*(([], []) if run is None else show.curve(run, name)))

    def add(self, runs: Sequence[Run | Mapping[str, Run]]) -> None:
        alone = [
            one for run in runs for one in (run.values() if isinstance(run, Mapping) else [run])
        ]
        for show, curve, starts in zip(self.shows, self.curves, self.starts, strict=True):
            if show.plane:
                name = show.names[0]
                seen = [one for one in alone if show.has(one, name)]
                paths = [np.column_stack(show.curve(one, name)) for one in seen]
                curve.set_data(*strung(paths))
                starts.set_data(*np.reshape([path[0] for path in paths], (-1, 2)).T)
