"""Many runs of one system, as `simulate_many` leaves them: each a Run, all together arrays.

runs = simulate_many(ball, 12.0, e=np.linspace(0, 0.9, 10))
runs[3].events["bounce"].t; [run.ended for run in runs]; runs.final["y"]; runs["y"].shape
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .ledger import Events, Touch
from .model import System
from .run import Ended, Run, Work, column

__all__ = ["Runs", "Samples"]


class Samples(NamedTuple):
    """Samples(t, mode_index, j, values, other, part): see Run, of one run or of many in a row."""

    t: np.ndarray
    mode_index: np.ndarray
    j: np.ndarray
    values: np.ndarray
    other: np.ndarray | None = None
    part: np.ndarray | None = None

    def cut(self, rows: slice) -> Samples:
        """samples.cut(slice(10, 20)) -> those rows, in the same memory."""
        return Samples(*(None if array is None else array[rows] for array in self))

    def column(self, system: System, p: tuple, name: str) -> np.ndarray:
        """samples.column(system, p, "x") -> (m,) a state, held variable or output."""
        where = self.t, self.mode_index, self.values, self.other, self.part
        return column(system, p, name, *where)


@dataclass(frozen=True, repr=False, eq=False)
class Runs(Sequence):
    """The result of `simulate_many`: a sequence of Run, and the same as arrays, one row a run.

    runs[3]             the Run of one lane: all that `simulate` gives with the same options, to the
                        last bit; its `at` makes that run once more, alone
    t, runs["x"]        (lanes, m) times, and values of a state, held variable or output; NaN behind
                        the end of a run with fewer samples. These arrays are made when asked for:
                        where one run has many more samples than the others, they are large
    mode_index          (lanes, m) modes by place, −1 behind the end
    values              (lanes, m, length of a state)
    final               name -> (lanes,) values at the end
    ended, stopped      why each run ended: a list of Ended, a list of sentences
    events              (lanes,) number of events
    p                   the parameters of each run, a list;  work: that of all together
    """

    system: System
    parameters: np.ndarray  # (lanes, parameters)
    samples: Samples  # of all lanes, one after the other
    ends: np.ndarray  # (lanes,) where the samples of each lane end
    endings: Sequence[tuple[Ended, str]]
    events: np.ndarray  # (lanes,)
    ledger: np.ndarray  # of all lanes, one after the other: rows as in Events
    costs: np.ndarray  # (lanes, 4): steps, rejected, evaluations of flows, of guards
    work: Work
    touches: Mapping[int, list[Touch]] = field(default_factory=dict)  # of the lanes that have some
    notes: Mapping[int, list[str]] = field(default_factory=dict)
    options: Callable[[int], Mapping[str, object]] = lambda lane: {}
    make: Callable[..., Run] | None = None

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, which: int | slice | str) -> Run | list[Run] | np.ndarray:
        if isinstance(which, str):
            return self._padded(self._flat(which), np.nan)
        if isinstance(which, slice):
            return [self._run(k) for k in range(len(self))[which]]
        return self._run(range(len(self))[operator.index(which)])

    def _rows(self, lane: int) -> slice:
        return slice(int(self.ends[lane - 1]) if lane else 0, int(self.ends[lane]))

    def _run(self, lane: int) -> Run:
        samples, (ended, stopped) = self.samples.cut(self._rows(lane)), self.endings[lane]
        events, last = int(self.events[lane]), int(self._last_event[lane])
        costs, work = self.costs[lane].tolist(), self.work
        return Run(
            self.system,
            self.p[lane],
            samples.t,
            samples.j,
            samples.mode_index,
            samples.values,
            Events(self.system, self.ledger[last - events : last]),
            stopped,
            Work(*costs, events, float("nan"), work.method, work.backend),
            np.empty((0, 4)) if ended is Ended.REFUSED else None,
            self.touches.get(lane, []),
            ended,
            self.notes.get(lane, []),
            self.options(lane),
            self.make,
            samples.other,
            samples.part,
        )

    def _flat(self, name: str) -> np.ndarray:
        """A state, held variable or output at all samples of all lanes."""
        if name not in self.system.outputs:  # the parameters do not matter: all lanes at once
            return self.samples.column(self.system, (), name)
        lanes = range(len(self))
        parts = [self.samples.cut(self._rows(k)) for k in lanes]
        return np.concatenate([parts[k].column(self.system, self.p[k], name) for k in lanes])

    def _padded(self, flat: np.ndarray, filling: float) -> np.ndarray:
        """(lanes, m) of what stands in a row."""
        counts = np.diff(self.ends, prepend=0)
        shape = (len(counts), int(counts.max()), *flat.shape[1:])
        if len(flat) == shape[0] * shape[1]:  # no lane had an event, or all had as many
            return np.ascontiguousarray(flat.reshape(shape))
        found = np.full(shape, filling, dtype=flat.dtype)
        found[np.arange(shape[1]) < counts[:, None]] = flat
        return found

    @cached_property
    def p(self) -> list[tuple]:
        return [self.system.P(*values) for values in self.parameters.tolist()]

    @cached_property
    def t(self) -> np.ndarray:
        return self._padded(self.samples.t, np.nan)

    @cached_property
    def mode_index(self) -> np.ndarray:
        return self._padded(self.samples.mode_index, -1)

    @cached_property
    def values(self) -> np.ndarray:
        return self._padded(self.samples.values, np.nan)

    @cached_property
    def _last_event(self) -> np.ndarray:
        return np.cumsum(self.events)

    @property
    def ended(self) -> list[Ended]:
        return [ended for ended, _ in self.endings]

    @property
    def stopped(self) -> list[str]:
        return [sentence for _, sentence in self.endings]

    @property
    def final(self) -> dict[str, np.ndarray]:
        last = self.samples.cut(self.ends - 1)
        return {name: last.column(self.system, (), name) for name in self.system.units}

    def __repr__(self) -> str:
        most = int(np.diff(self.ends, prepend=0).max())
        return f"Runs of {self.system.name!r}: {len(self)} runs, up to {most} samples each"
