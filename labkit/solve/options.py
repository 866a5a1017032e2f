"""The options of a simulation, checked: what `simulate` and `simulate_many` are asked for.

Options(system, t_end, t0, method, …)      raises ModelError; no memory, no model code
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from ..model import ModelError, System, check_names, listed, number
from .layout import EPS
from .methods import METHODS

__all__ = ["Options"]

BACKENDS = ("auto", "compiled", "plain")
MOST = 2**62  # what the core can count to
_OWN = ("system", "dense", "grid")  # of Options, not of `simulate`


@dataclass(frozen=True, eq=False)
class Options:
    """Options(system, t_end, …): what `simulate` says of its arguments, checked and made numbers.

    What was left out (None) stays None; `grid` are the times of the samples, (samples,).
    Raises ModelError, naming the option, its value and the mend.
    """

    system: System
    t_end: float
    t0: float
    method: str
    rtol: float
    atol: float | None | Mapping[str, float]
    step: float | None
    max_step: float | None
    points: int | np.ndarray
    locate: bool
    backend: str
    max_events: int
    max_steps: int
    dense: bool  # whether the pieces are kept, for values between samples
    grid: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        system = self.system
        t0, t_end = number(self.t0, "t0"), number(self.t_end, "t_end")
        if t_end <= t0:
            raise ModelError(
                f"t_end = {t_end:g} must lie after t0 = {t0:g}: runs go forward in time"
            )
        for value, known, what in (
            (self.method, METHODS, "method"),
            (self.backend, BACKENDS, "backend"),
        ):
            if value not in known:
                raise ModelError(f"there is no {what} {value!r}; there are {listed(known)}")
        rtol = number(self.rtol, "rtol")
        if not 0 < rtol < 1:
            raise ModelError(f"rtol = {rtol:g} must lie between 0 and 1")
        for key in ("step", "max_step"):
            if (value := getattr(self, key)) is not None:
                value = number(value, key)
                if value <= 0:
                    raise ModelError(f"{key} = {value:g} must be positive, or None")
                self._put(key, value)
        self._put("t0", t0)
        self._put("t_end", t_end)
        self._put("rtol", max(rtol, 100 * EPS))
        self._put("atol", _absolute(self.atol, system))
        if not isinstance(self.locate, bool | np.bool_):
            raise ModelError(f"locate is True or False, not {self.locate!r}")
        self._put("locate", bool(self.locate))
        self._put("max_events", count(self.max_events, "max_events"))
        self._put("max_steps", count(self.max_steps, "max_steps"))
        self._put("points", _points(self.points, t0, t_end))
        grid = self.points
        if isinstance(grid, int):
            grid = np.linspace(t0, t_end, max(2, grid))
        self._put("grid", grid)

    def _put(self, key: str, value: object) -> None:
        object.__setattr__(self, key, value)

    @cached_property
    def given(self) -> dict[str, object]:
        """options.given: name -> value of those that are arguments of `simulate`."""
        names = (each.name for each in fields(self) if each.name not in _OWN)
        return {name: getattr(self, name) for name in names}


def _absolute(atol: object, system: System) -> float | None | dict[str, float]:
    """None, a number of at least 0, or state name -> number."""
    if atol is None:
        return None
    if not isinstance(atol, Mapping):
        atol = number(atol, "atol")
        if atol < 0:
            raise ModelError(f"atol = {atol:g} must not be negative")
        return atol
    states = [name for name in system.units if name not in system.held]
    check_names(atol, states, "atol names the unknown state(s) {}")
    made = {name: number(value, f"atol of {name!r}") for name, value in atol.items()}
    if negative := [name for name, value in made.items() if value < 0]:
        raise ModelError(f"atol of {listed(negative)} must not be negative")
    return made


def _points(points: object, t0: float, t_end: float) -> int | np.ndarray:
    what = (
        f"points must be a number of samples, or times in rising order between t0 = {t0:g} and "
        f"t_end = {t_end:g}"
    )
    try:
        if points is None or isinstance(points, str) or np.ndim(points) == 0:
            return count(points, "points")
        times = np.array(points, dtype=float)  # a copy: the caller's may change
    except (TypeError, ValueError):  # also of count
        raise ModelError(f"{what}, not {points!r:.60}") from None
    if times.ndim > 1:
        raise ModelError(f"{what}, not an array of shape {times.shape}")
    rising = np.all(np.diff(times) > 0) and np.all(np.isfinite(times))
    if not (rising and len(times) and times[0] >= t0 and times[-1] <= t_end):
        raise ModelError(f"{what}, not {np.array2string(times, threshold=6, edgeitems=2)}")
    times.setflags(write=False)
    return times


def count(value: object, what: str) -> int:
    """count(value, "max_events") -> a whole number of at least 1; else ModelError."""
    try:
        if not isinstance(value, bool | str) and int(value) == value and value >= 1:
            return min(int(value), MOST)  # type: ignore[call-overload]
    except (TypeError, ValueError, OverflowError):  # None, NaN, inf
        pass
    raise ModelError(f"{what} must be a whole number of at least 1, not {value!r}")
