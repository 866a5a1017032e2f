"""The event ledger of a run: one line an event, and the same as arrays.

run.events[0].t, run.events[0].after["v"]               one event
run.events["bounce"].t, run.events["bounce"].after["v"]  all events of a transition, as arrays
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arguments import asked
from .model import System, check_names

__all__ = ["Event", "Events", "Firings", "Touch"]

END, SLIDING = -1, -2  # in the place of a mode: the run ended; the modes slid
SLIDES = " (sliding)"  # what the name of a transition then has behind it


class Named(dict):
    """Named({"x": 1.0}): a dict that says which names there are when asked for another."""

    def __missing__(self, name: object) -> None:
        check_names([name], self, "no value is called {}")


@dataclass(frozen=True)
class Event:
    """One line of the ledger: event.t, .transition, .source, .target, .before["v"], .after["v"].

    `target` is None where the run ended; `index` is the transition's place in system.transitions.
    """

    t: float
    transition: str
    source: str
    target: str | None
    before: Mapping[str, float]
    after: Mapping[str, float]
    index: int

    def __str__(self) -> str:
        # differences of rounding size would tell of the machine, not of the system
        changed = ", ".join(
            f"{name} {self.before[name]:.6g} → {new:.6g}"
            for name, new in self.after.items()
            if name in self.before and abs(new - self.before[name]) > 1e-9 * (1 + abs(new))
        )
        way = f"{self.source} → {self.target or 'end'}"
        return f"{self.t:12.6f}  {self.transition}: {way}{f'  ({changed})' * bool(changed)}"


@dataclass(frozen=True)
class Touch:
    """A limit that was touched and not passed: run.touches[0].t, .transition, .by.

    `by` is the guard at its highest, in its own unit, within ± the transition's tolerance: below 0
    it stays short of its limit, for the sign of a numerical error decides nothing.
    """

    t: float
    transition: str
    by: float

    def __str__(self) -> str:
        far = f"by {self.by:.3g}" if self.by >= 0 else f"{-self.by:.3g} short of it"
        return f"{self.t:12.6f}  {self.transition}: touched, no event ({far})"


@dataclass(frozen=True, eq=False)
class Firings:
    """run.events["bounce"]: all events of one transition as arrays of one entry an event.

    t                (k,) instants
    before, after    state name -> (k,) values; NaN where the mode has no such state
    source, target   (k,) names of modes; target is None where the run ended
    """

    t: np.ndarray
    before: Mapping[str, np.ndarray]
    after: Mapping[str, np.ndarray]
    source: np.ndarray
    target: np.ndarray

    def __len__(self) -> int:
        return len(self.t)


class Events(Sequence):
    """Events(system, rows): the ledger as a sequence of Event, which are made when looked at.

    events[0], events[-3:]   one event; a list of them
    events["bounce"]         the Firings of a transition, empty if it never fired; "slip (sliding)"
                             for begin and end of sliding on that transition's surface
    rows                     (events, 5 + 2·length of a state): t, transition, j, source, target,
                             the state before, the state after; modes by place, or END or SLIDING

    Raises ModelError for a label that no transition has.
    """

    def __init__(self, system: System, rows: np.ndarray):
        self._system, self._rows = system, rows

    @cached_property
    def _events(self) -> list[Event]:
        system, made = self._system, []
        names = [tr.name for tr in system.transitions]
        places = {mode: system.places(mode).items() for mode in system.modes}
        middle = (5 + self._rows.shape[1]) // 2
        for at, row in zip(self._ends, self._rows.tolist(), strict=True):
            one, other, source, target = at
            before, after, who = row[5:middle], row[middle:], int(row[1])
            made.append(
                Event(
                    row[0],
                    names[who] + SLIDES * (SLIDING in row[3:5]),
                    source,
                    target,
                    Named((name, before[place]) for name, place in places[one]),
                    Named((name, after[place]) for name, place in places[other]),
                    who,
                )
            )
        return made

    @cached_property
    def _ends(self) -> list[tuple[str, str, str, str | None]]:
        """Of each event: the modes whose states stand before and after; source, target in words."""
        system, modes = self._system, list(self._system.modes)
        words = {END: None, SLIDING: "sliding", **dict(enumerate(modes))}
        ends = []
        for who, source, target in self._rows[:, [1, 3, 4]].astype(int).tolist():
            one = modes[source] if source >= 0 else system.transitions[who].sources[0]
            other = modes[target] if target >= 0 else one
            ends.append((one, other, words[source], words[target]))
        return ends

    def _firings(self, label: str) -> Firings:
        system, rows = self._system, self._rows
        names = [tr.name for tr in system.transitions]
        called = np.array([[label == name, label == name + SLIDES] for name in names], dtype=bool)
        if not called.any():
            check_names([label], names, f"no transition of {system.name!r} is called {{}}")
        sliding = (rows[:, 3:5] == SLIDING).any(axis=1).astype(int)
        mine = np.flatnonzero(called[rows[:, 1].astype(int), sliding]).tolist()
        ends, middle = [self._ends[k] for k in mine], (5 + rows.shape[1]) // 2
        one, other, source, target = (
            np.array([end[k] for end in ends], dtype=object) for k in range(4)
        )
        before = _columns(system, one, rows[mine, 5:middle])
        after = _columns(system, other, rows[mine, middle:])
        return Firings(rows[mine, 0], before, after, source, target)

    def __len__(self) -> int:
        return len(self._rows)

    @asked
    def __getitem__(self, index: int | slice | str) -> Event | list[Event] | Firings:
        return self._firings(index) if isinstance(index, str) else self._events[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._events == list(other)

    def __repr__(self) -> str:
        return repr(self._events)


def _columns(system: System, modes: np.ndarray, states: np.ndarray) -> dict[str, np.ndarray]:
    """name -> its values in states (k, length), each of its own mode; NaN where there is none."""
    found = Named((name, np.full(len(modes), np.nan)) for name in system.units)
    for mode in system.modes:
        here = modes == mode
        for name, place in system.places(mode).items():
            found[name][here] = states[here, place]
    return found
