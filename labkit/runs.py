"""Many runs of one system, as `simulate_many` leaves them: each a Run, all together arrays.

runs = simulate_many(ball, 12.0, e=np.linspace(0, 0.9, 10))
runs[3].events["bounce"].t; [run.ended for run in runs]; runs.final["y"]; runs["y"].shape
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .arguments import asked
from .ledger import Events, Touch
from .model import System
from .run import Ended, Run, Samples, Work

__all__ = ["Runs", "Samples"]


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

    @asked
    def __getitem__(self, which: int | slice | str) -> Run | list[Run] | np.ndarray:
        if isinstance(which, str):
            return self._padded(self._flat(which), np.nan)
        if isinstance(which, slice):
            return [self._run(k) for k in range(len(self))[which]]
        return self._run(range(len(self))[operator.index(which)])

    def _rows(self, lane: int) -> slice:
        return slice(int(self.ends[lane - 1]) if lane else 0, int(self.ends[lane]))

    def _run(self, lane: int) -> Run:
        ended, stopped = self.endings[lane]
        events, last = int(self.events[lane]), int(self._last_event[lane])
        costs, work = self.costs[lane].tolist(), self.work
        return Run(
            system=self.system,
            p=self.p[lane],
            **self.samples.cut(self._rows(lane))._asdict(),
            events=Events(self.system, self.ledger[last - events : last]),
            stopped=stopped,
            work=Work(*costs, events, float("nan"), work.method, work.backend),
            pieces=np.empty((0, 4)) if ended is Ended.REFUSED else None,
            touches=self.touches.get(lane, []),
            ended=ended,
            said=self.notes.get(lane, []),
            options=self.options(lane),
            make=self.make,
        )

    def _flat(self, name: str) -> np.ndarray:
        """A state, held variable or output at all samples of all lanes."""
        if name not in self.system.outputs:  # the parameters do not matter: all lanes at once
            return self.samples.column(self.system, (), name)
        parts = (self.samples.cut(self._rows(k)) for k in range(len(self)))
        return np.concatenate(
            [c.column(self.system, p, name) for c, p in zip(parts, self.p, strict=True)]
        )

    def _padded(self, flat: np.ndarray, filling: float) -> np.ndarray:
        """(lanes, m) of what stands in a row."""
        counts = self._counts
        shape = (len(counts), int(counts.max()), *flat.shape[1:])
        if len(flat) == shape[0] * shape[1]:  # no lane had an event, or all had as many
            return np.ascontiguousarray(flat.reshape(shape))
        found = np.full(shape, filling, dtype=flat.dtype)
        found[np.arange(shape[1]) < counts[:, None]] = flat
        return found

    @property
    def _counts(self) -> np.ndarray:
        return np.diff(self.ends, prepend=0)

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
        most = self._counts.max()
        return f"Runs of {self.system.name!r}: {len(self)} runs, up to {most} samples each"
