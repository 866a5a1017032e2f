"""What all pictures share: the protocol view.figure / view.update / view.artists, and limits that follow the data calmly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from .figure import Figure

__all__ = ["Shows", "Together", "View", "Window"]


@dataclass(frozen=True)
class Shows:
    """Shows(axes, "t", ("x", "v")): the quantity to the right, "t" or a state, and those upwards, states or outputs."""

    axes: Axes
    x: str
    names: tuple[str, ...]

    @property
    def plane(self) -> bool:
        return self.x != "t"


class View:
    """A picture that can show another run without being built anew; it shows itself as the last line of a cell.

    view.figure         its Figure
    view.update(run)    shows another run (or runs), by changing the data of the artists that are there
    view.artists        the artists that update() changes, in drawing order; all others stay as they are
    view.relimited      the last update() moved the limits or other still parts: the rest must be drawn again as well
    view.shows          what its axes show, as far as a cursor, a click or a held run can use it
    view.at(run, t)     shows an instant of a run (a mechanism in its place)
    """

    figure: Figure
    artists: list[Artist]
    relimited: bool = False
    shows: Sequence[Shows] = ()

    def at(self, run: Any, t: float) -> None:
        """Nothing, for a picture that does not move in time."""

    def update(self, run: Any) -> None:
        raise NotImplementedError

    def __repr__(self) -> str:
        return type(self).__name__  # no address: the saved notebook keeps it

    def _repr_png_(self) -> bytes:
        return self.figure.png()

    def _repr_mimebundle_(
        self, include: object = None, exclude: object = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        return self.figure._repr_mimebundle_()


class Together(View):
    """Together(view, view): several views that were drawn into one figure, as one view."""

    def __init__(self, *views: View):
        self.views, self.figure = views, views[0].figure

    @property
    def artists(self) -> list[Artist]:  # type: ignore[override]
        return [artist for view in self.views for artist in view.artists]

    @property
    def shows(self) -> list[Shows]:  # type: ignore[override]
        return [show for view in self.views for show in getattr(view, "shows", ())]

    def update(self, run: Any) -> None:
        for view in self.views:
            view.update(run)
        self.relimited = any(view.relimited for view in self.views)

    def at(self, run: Any, t: float) -> None:
        for view in self.views:
            if hasattr(view, "at"):
                view.at(run, t)


class Window:
    """Window(axes, "y", low, high): limits of one axis, with a margin (a share of the range) around the data's low … high.

    `fit(low, high)` widens them when data leave (by `room`, a share too, so that a dragged slider does not move them at each
    picture), and narrows them again, never below the first ones, when they would fill less than a half; without room (time), at once.
    A user's own zoom is left alone, and all in a figure that is `steady`.
    """

    def __init__(
        self,
        axes: Axes,
        which: str,
        low: float,
        high: float,
        margin: float = 0.07,
        room: float = 0.2,
    ):
        self.axes, self.which, self.room = axes, which, room
        low, high = _proper(low, high)
        self.first = (low - margin * (high - low), high + margin * (high - low))
        self._set(*self.first)

    def _set(self, low: float, high: float) -> None:
        getattr(self.axes, f"set_{self.which}lim")(low, high)
        self.now = self._shown()

    def _shown(self) -> tuple[float, float]:
        return tuple(map(float, getattr(self.axes, f"get_{self.which}lim")()))  # type: ignore[return-value]

    def fit(self, low: float, high: float) -> bool:
        """window.fit(low, high) -> True when the limits had to move. Values that are not finite are ignored."""
        if self._shown() == self.first:  # brought home by a Reset: no zoom of the user
            self.now = self.first
        if (
            not (np.isfinite(low) and np.isfinite(high))
            or self._shown() != self.now
            or getattr(self.axes.get_figure(), "steady", False)
        ):
            return False
        room = self.room * max(high - low, self.first[1] - self.first[0])
        wanted = (
            min(low - room, self.first[0]) if low < self.first[0] else self.first[0],
            max(high + room, self.first[1]) if high > self.first[1] else self.first[1],
        )
        slack = 1e-9 * (self.now[1] - self.now[0])
        outside = low < self.now[0] - slack or high > self.now[1] + slack
        if (
            outside
            or self.now[1] - self.now[0] > (2 if self.room else 1) * (wanted[1] - wanted[0]) + slack
        ):
            self._set(*wanted)
            return True
        return False


def extent(*arrays: np.ndarray) -> tuple[float, float]:
    """extent(x, y) -> smallest and largest finite value of all, (nan, nan) when there is none."""
    low, high = np.inf, -np.inf
    for array in arrays:
        good = array[np.isfinite(array)]
        if len(good):
            low, high = min(low, float(good.min())), max(high, float(good.max()))
    return (low, high) if low <= high else (np.nan, np.nan)


def _proper(low: float, high: float) -> tuple[float, float]:
    """Limits of some width, also for a constant or for no data at all."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        room = 0.2 * max(abs(low), abs(high)) or 1.0
        return low - room, high + room
    return low, high
