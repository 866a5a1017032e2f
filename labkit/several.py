"""Several systems behind one set of sliders: explore({"plain": …, "warned": …}, …)."""

from __future__ import annotations

import re
from collections import namedtuple
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .model import ModelError, System, listed
from .run import Ended, Run

__all__ = ["Merged", "Several", "file_name"]


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
        self.start: dict[str, float] = {}
        self.modes = ("",)  # none that a word about all of them could name
        self.time = next(iter(self.systems.values())).time
        said: dict[str, tuple[str, Any]] = {}  # by whom first
        for label, one in self.systems.items():
            alike: dict[str, Any] = {"the time": one.time}
            for name, made in one.parameters.items():
                alike[f"parameter {name!r} (unit, low, high)"] = made.unit, made.low, made.high
            alike |= {f"state {name!r} (unit)": unit for name, unit in one.units.items()}
            for what, value in alike.items():
                first, was = said.setdefault(what, (label, value))
                if was != value:
                    raise ModelError(
                        f"{what} is {was!r} in {first!r} and {value!r} in {label!r}: one slider "
                        "cannot be both; declare it alike, or give it another name in one of them"
                    )
            self.parameters |= {k: v for k, v in one.parameters.items() if k not in self.parameters}
            self.units |= one.units
            self.start = {**one.start, **self.start}
        if both := [name for name in self.parameters if name in self.units]:
            raise ModelError(
                f"{listed(both)} is a parameter of one of {self.name} and a state of another: "
                "rename one of them"
            )
        self.P = namedtuple("P", self.parameters)  # type: ignore[misc]

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
        runs = reversed(self.values())
        return self.system.P(**{k: v for run in runs for k, v in run.p._asdict().items()})

    @property
    def start(self) -> dict[str, float]:
        return {k: v for run in reversed(self.values()) for k, v in run.start.items()}

    def at(self, t: float) -> dict[str, dict[str, Any]]:
        return {name: run.at(float(np.clip(t, *run.t[[0, -1]]))) for name, run in self.items()}

    @property
    def _worst(self) -> tuple[str, Run]:
        """The first one that did not come to its end, else the first."""
        fine = (Ended.FINISHED, Ended.TERMINAL)
        bad = [each for each in self.items() if each[1].ended not in fine]
        return (bad or list(self.items()))[0]

    @property
    def ended(self) -> Ended:
        return self._worst[1].ended

    @property
    def stopped(self) -> str:
        name, run = self._worst
        return f"{name}: {run.stopped}"

    def files(self, path: str | Path) -> list[Path]:
        """runs.files("run.csv") -> a path for each, "run_plain.csv", "run_warned.csv"."""
        path, words = Path(path), [file_name(name) for name in self]
        if len(set(words)) < len(words):
            words = [f"{k}_{word}" for k, word in enumerate(words, 1)]
        return [path.with_stem(f"{path.stem}_{word}") for word in words]

    def to_csv(self, path: str | Path) -> list[Path]:
        return [run.to_csv(p) for run, p in zip(self.values(), self.files(path), strict=True)]

    def to_npz(self, path: str | Path) -> list[Path]:
        return [run.to_npz(p) for run, p in zip(self.values(), self.files(path), strict=True)]


def file_name(words: str) -> str:
    """file_name("Damped, once") -> "damped_once": as every disk takes it."""
    return re.sub(r"\W+", "_", words).strip("_").lower()
