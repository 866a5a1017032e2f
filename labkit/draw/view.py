"""What all pictures share.

The protocol view.figure / view.update / view.artists, and limits that follow the data calmly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from ..model import ModelError, System
from .figure import Figure


@dataclass(frozen=True)
class Shows:
    """Shows(axes, "t", ("x", "v")): the quantity to the right, "t" or a state, and those upwards.

    These are states or outputs, or names of curves that data(run, name) gives as (x, y).
    """

    axes: Axes
    x: str
    names: tuple[str, ...]
    data: Callable[[Any, str], tuple[np.ndarray, np.ndarray]] | None = None

    @property
    def plane(self) -> bool:
        return self.x != "t"

    def curve(self, run: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
        """show.curve(run, "x") -> the curve of that name, to the right and upwards.

        Of several runs by name, one after the other, NaN between them.
        """
        if self.data is not None:
            return self.data(run, name)
        if isinstance(run, Mapping):
            pairs = [self.curve(one, name) for one in run.values() if self.has(one, name)]
            gap = np.full(1, np.nan)
            x, y = ([part for pair in pairs for part in (pair[k], gap)] for k in (0, 1))
            return (np.concatenate(x), np.concatenate(y)) if pairs else (gap, gap)
        return (run.t if self.x == "t" else run[self.x]), run[name]

    def has(self, run: Any, *names: str) -> bool:
        known = {"t", *run.system.units, *run.system.outputs}
        return {self.x, *names} <= known

    def points(self, run: Any, t: float) -> list[tuple[float, float]]:
        """show.points(run, t) -> where its curves are at the instant t."""
        if self.data is not None:
            made = (self.data(run, name) for name in self.names)
            return [(t, float(np.interp(t, x, y))) for x, y in made if len(x)]
        if isinstance(run, Mapping):
            live = [one for one in run.values() if one.t[0] <= t <= one.t[-1] and self.has(one)]
            return [point for one in live for point in self.points(one, t)]
        values = {"t": t, **run.at(t)}
        names = [name for name in self.names if name in values and self.x in values]
        return [(values[self.x], values[name]) for name in names]


def same_system(run: Any, system: System) -> None:
    """Raises ModelError for a run of a system that a picture of this one cannot show."""
    for part in ("units", "modes"):
        if list(getattr(run.system, part)) != list(getattr(system, part)):
            raise ModelError(
                f"this picture was made for {system.name!r}, update got a run of "
                f"{run.system.name!r}"
            )


class View:
    """A picture that can show another run without being built anew.

    It shows itself as the last line of a cell.

    view.figure         its Figure
    view.update(run)    shows another run (or runs), by changing the data of the artists that are
                        there
    view.artists        the artists that update() changes, in drawing order; all others stay as they
                        are
    view.relimited      the last update() moved the limits or other still parts: the rest must be
                        drawn again as well
    view.shows          what its axes show, as far as a cursor, a click or a held run can use it
    view.at(run, t)     shows an instant of a run (a mechanism in its place)
    view.ready          False for a view that was made without a run: a panel updates it first
    """

    figure: Figure
    artists: list[Artist]
    relimited: bool = False
    ready: bool = True
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
    """Together(view, view): several views that were drawn into one figure, as one view.

    Raises ModelError when they were drawn into different figures.
    """

    def __init__(self, *views: View):
        self.views, self.figure = views, views[0].figure
        for k, view in enumerate(views):
            if getattr(view, "figure", self.figure) is not self.figure:
                raise ModelError(
                    f"view {k + 1} of {len(views)}, {view!r:.60}, was drawn into another figure "
                    "than the first: make fig = figure(…) once and give each view axes=fig.axes[k]"
                )

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


class Only(View):
    """Only("plain", view): a view that is given several runs by name and shows one of them.

    Once this one has ended it stays as it was then, while the others play on.
    """

    def __init__(self, name: str, view: View):
        self.name, self.view, self.figure = name, view, view.figure
        self.artists, self.shows, self.ready = view.artists, (), view.ready

    def update(self, run: Any) -> None:
        self.view.update(run[self.name])
        self.relimited = self.view.relimited

    def at(self, run: Any, t: float) -> None:
        one = run[self.name]
        self.view.at(one, float(np.clip(t, *one.t[[0, -1]])))


class Window:
    """Window(axes, "y", low, high): limits of one axis around the data's low … high.

    `margin` is a share of the range. `fit(low, high)` widens them when data leave (by `room`, a
    share too, so that a dragged slider does not move them at each picture), and narrows them again,
    never below the first ones, when they would fill less than a half; without room (time), at once.
    Shares of a logarithmic axis (`log`) are those of decades. A user's own zoom is left alone, and
    all in a figure that is `steady`.
    """

    def __init__(
        self,
        axes: Axes,
        which: str,
        low: float,
        high: float,
        margin: float = 0.07,
        room: float = 0.2,
        log: bool = False,
        near: bool = True,
    ):
        self.axes, self.which, self.room, self.log, self.near = axes, which, room, log, near
        low, high = self._proper(low, high)
        self.first = (low - margin * (high - low), high + margin * (high - low))
        self._set(*self.first)
        self.home = self.now  # as they are read back

    def _proper(self, low: float, high: float) -> tuple[float, float]:
        if not self.log:
            return proper(low, high)
        if not (np.isfinite(low) and np.isfinite(high) and low > 0):
            return -1.0, 1.0
        low, high = np.log10((low, high))
        return (low, high) if high - low > 0.1 else (low - 0.5, high + 0.5)

    def _set(self, low: float, high: float) -> None:
        limits = 10.0 ** np.array([low, high]) if self.log else (low, high)
        getattr(self.axes, f"set_{self.which}lim")(*limits)
        self.now = self._shown()

    def _shown(self) -> tuple[float, float]:
        limits = getattr(self.axes, f"get_{self.which}lim")()
        return tuple(map(float, np.log10(limits) if self.log else limits))  # type: ignore

    def fit(self, low: float, high: float) -> bool:
        """window.fit(low, high) -> True when the limits had to move.

        Values that are not finite are ignored.
        """
        if self._shown() == self.home:  # brought home by a Reset: no zoom of the user
            self.now = self.home
        if (
            not (np.isfinite(low) and np.isfinite(high))
            or self._shown() != self.now
            or getattr(self.axes.get_figure(), "steady", False)
            or (self.log and low <= 0)
        ):
            return False
        if self.log:
            low, high = map(float, np.log10((low, high)))
        wanted, wide = self._wanted(low, high), self.now[1] - self.now[0]
        slack = 1e-9 * wide
        outside = low < self.now[0] - slack or high > self.now[1] + slack
        much = (2 if self.room else 1) * (wanted[1] - wanted[0]) + slack
        if moves := outside or wide > much:
            self._set(*wanted)
        return moves

    def _wanted(self, low: float, high: float) -> tuple[float, float]:
        """Limits for such data, whatever they are now."""
        bottom, top = self.first
        if self.near and (top - bottom) / 1000 < high - low < (top - bottom) / 4:
            room = (high - low) / 2 if self.room else 0.0
            return low - room, high + room
        room = self.room * max(high - low, top - bottom)
        return (
            low - room if low < bottom else bottom,
            high + room if high > top else top,
        )


def extent(*arrays: np.ndarray) -> tuple[float, float]:
    """extent(x, y) -> smallest and largest finite value of all, (nan, nan) when there is none."""
    finite = [good for array in arrays if len(good := array[np.isfinite(array)])]
    if not finite:
        return np.nan, np.nan
    return float(min(good.min() for good in finite)), float(max(good.max() for good in finite))


def proper(low: float, high: float) -> tuple[float, float]:
    """proper(low, high): limits of some width, also for a constant or for no data at all."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        room = 0.2 * max(abs(low), abs(high)) or 1.0
        return low - room, high + room
    return low, high
