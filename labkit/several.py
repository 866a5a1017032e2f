"""Several systems behind one set of sliders: explore({"plain": …, "warned": …}, …).

merged = Merged({"plain": system, "warned": other})
runs = Several(merged, {"plain": run, "warned": another});  runs["plain"]["x"]
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .model import ModelError, System, listed
from .run import Ended, Run

__all__ = ["Merged", "Several"]


class Merged:
    """Merged({"plain": system, "warned": other}): their parameters and states together, by name.

    A parameter or state that several have is one, and then has one unit and one declared range:
    else ModelError says which differ. Values may differ: see `own`.
    """

    def __init__(self, systems: Mapping[str, System]):
        if len(systems) < 2 or not all(isinstance(one, System) for one in systems.values()):
            raise ModelError(
                "explore takes a System, or a dict of two or more: "
                '{"plain": system, "warned": system_two}'
            )
        self.systems = {str(name): one for name, one in systems.items()}
        self.name = ", ".join(self.systems)
        self.parameters: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        self.meanings: dict[str, str] = {}
        self.start: dict[str, float] = {}
        self.modes = ("",)  # none that a word about all of them could name
        first, where = next(iter(self.systems)), {}
        self.time = self.systems[first].time
        for label, one in self.systems.items():
            self._alike("the time", (first, self.time), (label, one.time))
            for name, made in one.parameters.items():
                said = (made.unit, made.low, made.high)
                was = where.setdefault(("parameter", name), (label, said))
                self._alike(f"parameter {name!r} (unit, low, high)", was, (label, said))
                self.parameters.setdefault(name, made)
            for name, unit in one.units.items():
                was = where.setdefault(("state", name), (label, unit))
                self._alike(f"state {name!r} (unit)", was, (label, unit))
                self.units.setdefault(name, unit)
                self.meanings.setdefault(name, one.meanings.get(name, ""))
            self.start = {**one.start, **self.start}
        if both := [name for name in self.parameters if name in self.units]:
            raise ModelError(
                f"{listed(both)} is a parameter of one of {self.name} and a state of another: "
                "rename one of them"
            )
        self.P = namedtuple("P", self.parameters)  # type: ignore[misc]

    @staticmethod
    def _alike(what: str, one: tuple[str, object], other: tuple[str, object]) -> None:
        if one[1] != other[1]:
            raise ModelError(
                f"{what} is {one[1]!r} in {one[0]!r} and {other[1]!r} in {other[0]!r}: one slider "
                "cannot be both; declare it alike, or give it another name in one of them"
            )

    def unit(self, name: str) -> str:
        found = (one for one in self.systems.values() if name in {**one.units, **one.outputs})
        return next(found).unit(name)


class Several(dict):
    """Several(merged, {"plain": run, "warned": other}): name -> Run, and what a panel asks of one.

    runs.at(t)   name -> the values of that run at the instant t, or at its end
    """

    def __init__(self, merged: Merged, runs: Mapping[str, Run]):
        super().__init__(runs)
        self.system = merged

    @property
    def t(self) -> np.ndarray:
        """From the first start to the last end."""
        ends = [(run.t[0], run.t[-1]) for run in self.values()]
        return np.array([min(a for a, _ in ends), max(b for _, b in ends)])

    @property
    def p(self) -> tuple:
        values = {}
        for run in self.values():
            values = {**run.p._asdict(), **values}
        return self.system.P(**values)

    @property
    def start(self) -> dict[str, float]:
        values: dict[str, float] = {}
        for run in self.values():
            values = {**run.start, **values}
        return values

    def at(self, t: float) -> dict[str, dict[str, Any]]:
        return {name: run.at(float(np.clip(t, *run.t[[0, -1]]))) for name, run in self.items()}

    @property
    def _worst(self) -> tuple[str, Run]:
        fine = (Ended.FINISHED, Ended.TERMINAL)
        return next(
            ((n, r) for n, r in self.items() if r.ended not in fine), next(iter(self.items()))
        )

    @property
    def ended(self) -> Ended:
        """Of the first one that did not come to its end, else of the first."""
        return self._worst[1].ended

    @property
    def stopped(self) -> str:
        name, run = self._worst
        return f"{name}: {run.stopped}"

    def to_csv(self, path: str | Path) -> Path:
        return self._export("to_csv", path)

    def to_npz(self, path: str | Path) -> Path:
        return self._export("to_npz", path)

    def _export(self, what: str, path: str | Path) -> Path:
        """A file for each, "run_plain.csv", "run_warned.csv"."""
        path = Path(path)
        for name, run in self.items():
            getattr(run, what)(path.with_stem(f"{path.stem}_{name}"))
        return path
