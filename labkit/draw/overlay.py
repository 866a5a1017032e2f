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
from ..model import ModelError
from ..run import Run
from .figure import COLORS, DASHES, FAINT, INK
from .layers import _strung
from .view import Shows, View

__all__ = ["Handle", "Overlay"]


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
        self.axes, self.figure, self.meaning = (
            axes,
            axes.get_figure(),
            meaning or ", ".join(names) or "handle",
        )
        self.click = click
        self.place = place or (
            lambda run: tuple(
                run.start[name] if name in run.start else getattr(run.p, name) for name in names
            )
        )
        self.values = values or (lambda x, y: dict(zip(names, (x, y), strict=True)))
        self.dot = Line2D(
            [],
            [],
            linestyle="none",
            marker="o",
            markersize=10,
            markerfacecolor="white",
            markeredgecolor=color,
            markeredgewidth=2.4,
            zorder=9,
        )
        axes.add_artist(self.dot)
        self.artists = [self.dot]

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
        grey = {"color": FAINT, "linewidth": 2.6, "alpha": 0.55, "zorder": 2.7}
        self.ghosts = [  # told apart by their dashes, as the curves are
            [Line2D([], [], **grey, linestyle=DASHES[k % 4]) for k, _ in enumerate(show.names)]
            for show in self.shows
        ]
        dots = {"linestyle": "none", "marker": "o"}
        self.lines = self._each(color=INK, linewidth=0.9, alpha=0.7, zorder=8)
        for show, line in zip(self.shows, self.lines, strict=True):
            line.set_transform(show.axes.get_xaxis_transform())
        self.dots = self._each(
            **dots, markersize=7, color=COLORS[1], markeredgecolor="white", zorder=8.5
        )
        self.curves = self._each(color=COLORS[2], linewidth=1.5, zorder=4.6)
        self.starts = self._each(
            **dots, markersize=5, color=COLORS[2], markerfacecolor="white", zorder=4.7
        )
        self.artists = []
        for show, *artists, ghosts in zip(
            self.shows, self.lines, self.dots, self.curves, self.starts, self.ghosts, strict=True
        ):
            for artist in (*artists, *ghosts):
                artist.set_in_layout(False)
                show.axes.add_artist(artist)
                self.artists.append(artist)

    def _each(self, **look: Any) -> list[Line2D]:
        return [Line2D([], [], **look) for _ in self.shows]

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

    def add(self, runs: Sequence[Run]) -> None:
        for show, curve, starts in zip(self.shows, self.curves, self.starts, strict=True):
            if show.plane:
                runs = [one for run in runs for one in _each(run)]
                paths = [np.column_stack([run[show.x], run[show.names[0]]]) for run in runs]
                curve.set_data(*_strung(paths))
                starts.set_data([path[0, 0] for path in paths], [path[0, 1] for path in paths])


def _each(run: Run | Mapping[str, Run]) -> list[Run]:
    return list(run.values()) if isinstance(run, Mapping) else [run]
