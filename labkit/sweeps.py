"""Many runs over a grid of parameters, starts or options, and one result of each.

m = sweep(system, 0.04, mean, d=np.linspace(0.1, 0.9, 17), R=np.geomspace(20, 500, 12))
m.values, m.axes, m.reasons; m.picture("d", "R", contour=[30, 40, 60]); m.to_csv("map.csv")
"""

from __future__ import annotations

import inspect
import itertools
import os
from collections.abc import Collection, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .arguments import asked
from .exports import frame, lines
from .model import ModelError, System, check_names, listed, number
from .portions import Lane, Measure, Task, portions
from .progress import Progress
from .run import Ended, write_whole
from .solve import simulate_many
from .solve.options import Options

__all__ = ["Sweep", "sweep"]

#: How a run may end that is measured.
GOOD = (Ended.FINISHED, Ended.TERMINAL, Ended.ZENO, Ended.CONTACT)
#: Options that may be an axis: each of their values is a call of its own
CHOICES = ("method", "rtol", "atol", "step", "max_step", "locate", "backend")
#: Options of `simulate_many` -> what they are when left out
OPTIONS = {
    name: what.default
    for name, what in inspect.signature(simulate_many).parameters.items()
    if what.kind is what.KEYWORD_ONLY and name != "start"
}
OWN = frozenset({"executor", "progress", "accept", "start"})


@dataclass(frozen=True, repr=False, eq=False)
class Sweep:
    """The result of `sweep`. Arrays have the shape of the grid, axes in the order of the call.

    axes       name -> values along it, numbers or names
    values     the result of each run: numbers with nan, or objects (text, True) with None, where
               there is none;  m["peak"]: of one of several results, of which values is the first
    reasons    place in the grid -> sentence, of the runs that gave none
    failed     where that is, an array of True and False
    """

    system: System
    axes: Mapping[str, np.ndarray]
    results: Mapping[str, np.ndarray]
    reasons: Mapping[tuple[int, ...], str]
    name: str = ""
    units: Mapping[str, str] = field(default_factory=dict)  # of axes

    @property
    def values(self) -> np.ndarray:
        return next(iter(self.results.values()))

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def failed(self) -> np.ndarray:
        found = np.zeros(self.shape, dtype=bool)
        for place in self.reasons:
            found[place] = True
        return found

    @asked
    def __getitem__(self, name: str) -> np.ndarray:
        check_names([name], self.results, "the sweep has no result {}")
        return self.results[name]

    @asked
    def picture(self, x: str | None = None, y: str | None = None, **look: Any) -> Any:
        """m.picture("d", "R", contour=[30, 40], title="Mean output") -> figure.

        One axis: a curve. Two: a map, of numbers with a colour bar, of words with a legend; with
        x alone a curve for each value of the other. Three: a map for each value of the third.

        what      which of several results;  contour: a number of lines, their levels, or the name
                  of another result, whose lines are drawn;  levels: its levels
        label     of the colour bar or of the upward axis, with unit: "mean output [V]"
        log       names of axes with a logarithmic scale; left out: those in equal ratios
        even      names of axes whose values stand at equal distances, whatever they are
        title, width, height    as in `figure`
        axes      draws into axes of a figure that there is; with Handle(axes, "d", "R", click=True)
                  in a panel the map sets the sliders

        Runs without a result are hatched. Further curves: picture.axes[0].plot(…).
        Raises ModelError for an unknown axis or result, and for more maps than six.
        """
        from .draw.maps import picture  # Matplotlib is loaded only for a picture

        return picture(self, x, y, **look)

    @asked
    def to_csv(self, path: str | os.PathLike) -> Path:
        """m.to_csv("map.csv") -> path: a line for each run: axes, results, reason.

        The file is written whole or not at all. Raises ModelError when it cannot be written.
        """
        columns = self.columns()
        heads = [f"{name} [{u}]" if (u := self.units.get(name)) else name for name in columns]
        return write_whole(path, lines(heads, zip(*columns.values(), strict=True)))

    def columns(self) -> dict[str, list]:
        """m.columns() -> {"d": […], "R": […], result: […], "reason": […]}, a value for each run.

        A result with the name of another column is called "d of the run".
        """
        places = list(np.ndindex(self.shape))
        made = {
            name: [axis[place[k]].item() for place in places]
            for k, (name, axis) in enumerate(self.axes.items())
        }
        for name, result in self.results.items():
            name = name or self.name or "value"
            taken = name in made or name == "reason"
            made[f"{name} of the run" if taken else name] = result.ravel().tolist()
        return {**made, "reason": [self.reasons.get(place, "") for place in places]}

    def to_frame(self) -> Any:
        """m.to_frame() -> pandas.DataFrame, a line for each run; ModelError without pandas."""
        return frame(self.columns())

    def __repr__(self) -> str:
        grid = " × ".join(f"{len(axis)} {name}" for name, axis in self.axes.items())
        lost = ""
        for place, why in list(self.reasons.items())[:1]:
            lost = f"; {len(self.reasons)} without a result, first {place}: {why}"
        return f"Sweep of {self.system.name!r}: {grid}{lost}"


@asked
def sweep(
    system: System,
    horizon: float,
    measure: Measure,
    /,
    *,
    start: Mapping[str, object] | None = None,
    executor: Executor | None = None,
    progress: bool = True,
    accept: Collection[Ended] = GOOD,
    **names: object,
) -> Sweep:
    """sweep(system, 0.04, mean, d=duties, R=loads) -> Sweep: all runs of the grid, measured.

    measure    measure(run) -> a number, a short text, True or False; or a dict of several,
               name -> such a thing
    names      parameters, states (their start) or options of `simulate_many`. A sequence of numbers
               is an axis, one to three of them; a single number holds for all. Of the options,
               method, rtol, atol, step, max_step, locate and backend may be an axis
    start      as in `simulate_many`; a value may be a function of the parameters, f(p)
    executor   any Executor of concurrent.futures; left out, compiled runs are shared out over the
               processors by themselves. To other processes the model goes pickled: its functions
               and measure then are written with def in a module, or the package cloudpickle is
               there; a ThreadPoolExecutor takes any
    progress   whether to show it where somebody looks
    accept     which ends of a run are measured; accept=Ended: all but refused starts

    Runs are made in portions and forgotten once they are measured. A run that cannot start, ends
    otherwise, or of which measure raises, is one lane's reason; an interrupt from the keyboard
    ends the sweep and keeps what there is. Raises ModelError for bad input, for a name that is both
    an option and a state, and when no run at all gave a result.
    """
    if not callable(measure):
        raise ModelError(f"measure of sweep must be a function of one run, not {measure!r:.60}")
    axes, fixed, options, start = _sorted(system, names, start or {})
    shape = tuple(map(len, axes.values()))
    total = int(np.prod(shape))
    found: list[Lane] = [(None, "not computed: interrupted")] * total
    places = dict(zip(axes, np.indices(shape).reshape(len(shape), total), strict=True))
    choices = [name for name in axes if name in CHOICES]
    jobs = []
    for chosen in itertools.product(*(range(len(axes[name])) for name in choices)):
        mine = np.ones(total, dtype=bool)
        how = dict(options)
        for name, k in zip(choices, chosen, strict=True):
            mine &= places[name] == k
            how[name] = axes[name][k].item()
        jobs.append((np.flatnonzero(mine), how))
        rest = {k: v for k, v in (OPTIONS | how).items() if k not in ("mode", "workers")}
        Options(system, horizon, **rest, dense=False)  # type: ignore[arg-type]  # what is wrong in all lanes
    columns = {name: axes[name][places[name]] for name in axes if name not in choices} | fixed
    task = Task(system, horizon, measure, tuple(accept), start)
    interrupted = None
    with Progress(total, "runs", progress) as shown:
        try:
            for which, lanes in portions(task, columns, jobs, executor):
                for lane, result in zip(which.tolist(), lanes, strict=True):
                    found[lane] = result
                shown.add(len(which))
        except KeyboardInterrupt as error:
            interrupted = error
    if all(result is None for result, _ in found):
        raise interrupted or ModelError(
            f"no run of the sweep gave a result. The first: {found[0][1]}"
        )
    name = getattr(measure, "__name__", "").strip("<>").replace("_", " ")
    units = {name: system.unit(name) for name in axes if name not in OPTIONS}
    units |= {name: system.time for name in ("step", "max_step") if name in axes}
    ends = zip(np.ndindex(shape), found, strict=True)
    reasons = {place: why for place, (result, why) in ends if result is None}
    kept = _arrays([result for result, _ in found], shape)
    return Sweep(system, axes, kept, reasons, "" if name == "lambda" else name, units)


def _sorted(
    system: System, names: Mapping[str, object], start: Mapping[str, object]
) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, object], dict[str, object]]:
    """Axes, single values of parameters and states, options and starts, checked."""
    known = [*system.parameters, *system.units]
    axes: dict[str, np.ndarray] = {}
    fixed: dict[str, float] = {}
    options: dict[str, object] = {}
    check_names(start, system.units, "start names the unknown state(s) {}")
    if twice := [name for name in start if name in names]:
        raise ModelError(f"{listed(twice)} stands both in start and among the names: give it once")
    spread = {name: what for name, what in start.items() if _rows(name, what) == 1}
    begin = {name: what for name, what in start.items() if name not in spread}
    own = f"nor a state of {system.name!r}, nor an option of simulate_many"
    check_names(names, [*known, *OPTIONS], f"{{}} is neither a parameter {own}")
    for name, what in {**names, **spread}.items():
        option = name in OPTIONS
        if name in known and (option or name in OWN):
            kind = "parameter" if name in system.parameters else "state"
            raise ModelError(
                f"{name!r} is both an option and a {kind} of {system.name!r}: rename the {kind}"
            )
        is_axis = not option or name in CHOICES
        if is_axis and _rows(name, what):
            axes[name] = _axis(system, name, what)
        elif option:
            options[name] = what
        else:
            fixed[name] = _checked(system, name, what)
    if not 1 <= len(axes) <= 3:
        raise ModelError(
            f"a sweep has one to three axes, here {len(axes)} ({listed(axes)}): give sequences of "
            "values, d=np.linspace(0.1, 0.9, 17)"
        )
    return axes, fixed, options, begin


def _rows(name: str, what: Any) -> int:
    """The dimensions of an array, 1 for a row; ModelError for rows of different lengths."""
    try:
        return np.ndim(what)
    except ValueError:
        raise ModelError(f"{name!r} must be numbers in one row, not {what!r:.60}") from None


def _axis(system: System, name: str, what: object) -> np.ndarray:
    values = np.asarray(what)
    if values.ndim != 1 or not len(values):
        raise ModelError(
            f"axis {name!r} must be a sequence of values, not an array of shape {values.shape}"
        )
    if name not in CHOICES:
        values = np.array([_checked(system, name, value) for value in values.tolist()])
    return values


def _checked(system: System, name: str, value: object) -> float:
    """A value of a parameter, in its range, or of a state."""
    if name in system.parameters:
        return system.parameters[name].check(name, value)
    return number(value, f"start of {name!r}")


def _arrays(found: list[Mapping[str, object] | None], shape: tuple[int, ...]) -> dict:
    """name -> array of the results: numbers, or objects where there are words."""
    made = {}
    for name in dict.fromkeys(name for result in found for name in result or ()):
        column = [(result or {}).get(name) for result in found]
        kind: Any = object
        if all(value is None or isinstance(value, float) for value in column):
            kind = float  # of None: NaN
        elif all(isinstance(value, bool) for value in column):
            kind = bool
        made[name] = np.array(column, dtype=kind).reshape(shape)
    return made
