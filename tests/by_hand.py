"""Results that no engine made: what pictures and exports need, put together from arrays."""

import numpy as np

from labkit.run import Ended, Work
from labkit.runs import Runs, Samples


def lanes(system, t, modes, values, ends, p=None):
    """lanes(system, t, modes, values, ends) -> Runs of samples in a row, lane k up to ends[k]."""
    count, nothing = len(ends), np.empty((0, 5 + 2 * values.shape[1]))
    return Runs(
        system,
        np.array([system.values()] * count) if p is None else p,
        Samples(t, modes, np.zeros(len(t), dtype=int), values),
        np.array(ends),
        [(Ended.FINISHED, "finished")] * count,
        np.zeros(count, dtype=int),
        nothing,
        np.zeros((count, 4), dtype=int),
        Work(0, 0, 0, 0, 0, 0.0, "hand", "hand"),
    )
