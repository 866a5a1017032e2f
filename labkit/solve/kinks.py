"""Where tables of the time bend: instants that a step must not pass over.

A flow that reads a table, np.interp(t, T, Q), bends at every entry of T, and a short pulse between two
entries is invisible to a solver whose steps pass over it. Which tables there are is seen by calling the
model's functions once with a time that notes what it is looked up in.

    kinks(system, p, t0, t_end, s by mode) -> times between t0 and t_end, rising
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model import System

__all__ = ["MOST", "kinks"]

MOST = 2_000  # a finer table is as good as smooth, and a step an entry would cost too much


class _Clock(float):
    """A time that notes the tables it is looked up in (NumPy's own protocol for foreign arguments)."""

    tables: list[np.ndarray]

    def __array_function__(self, function, types, args, kwargs):
        if function is np.interp and args and args[0] is self:
            self.tables.append(np.asarray(args[1], dtype=float))
        plain = [float(each) if each is self else each for each in args]
        return function(*plain, **{k: float(v) if v is self else v for k, v in kwargs.items()})


def kinks(
    system: System, p: tuple, t0: float, t_end: float, states: Mapping[str, tuple]
) -> np.ndarray:
    """kinks(system, p, 0.0, 10.0, {"flight": s}) -> (k,) times at which tables of the time bend."""
    clock = _Clock(t0)
    clock.tables = []
    for mode, s in states.items():
        guards = [system.transitions[i].guard for i in system.leaving[mode]]
        for function in (system.modes[mode].flow, *guards):
            if function is not None:
                try:
                    function(clock, s, p)
                except Exception:  # what is wrong with it is told where it is tried with a plain time
                    continue
    times = np.unique(np.concatenate([np.empty(0), *map(np.ravel, clock.tables)]))
    times = times[(times > t0) & (times < t_end)]
    return times if len(times) <= MOST else np.empty(0)
