"""What a run should say of states that shrank below their tolerance and grew again from there.

The tolerance that follows from a state's own size follows from its largest size so far. Of a state
that then decays to less than that nothing is known but that it is small; and if it grows again by
itself, like a population that was almost extinct, what it grows to is not known either.
"""

from __future__ import annotations

import numpy as np

from . import core
from .settings import Settings

__all__ = ["faded"]

_GROWN = 1e3  # a state that has become so many times larger counts again


def faded(settings: Settings, pieces: np.ndarray, p: tuple) -> list[str]:
    """faded(settings, rows of Run.pieces, p) -> sentences, one a state; mostly none."""
    if settings.fixed["i0"][core.ADAPTIVE] == 0 or len(pieces) < 3:
        return []
    width, least = settings.width, 0.01 * settings.rtol
    sizes = np.abs(pieces[:, 4 : 4 + width])
    low = sizes < least * sizes.max()
    if not low[1:].any():
        return []
    mode_of, found = pieces[:, 2].astype(int), {}
    for k in np.flatnonzero(low[1:].any(axis=0)).tolist():
        kinds = settings.fixed["kind"][mode_of]
        alike = np.where(kinds == kinds[:, [k]], sizes, 0.0).max(axis=1)
        known = np.maximum.accumulate(alike)
        floor = least * known
        below = (sizes[:, k] < floor) & (settings.absolute[mode_of, k] < 0)
        edges = np.flatnonzero(np.diff(np.r_[False, below, False]))
        for begin, end in edges.reshape(-1, 2).tolist():
            if begin == 0 or end - begin < 2:  # a small start, or a state that changes its sign
                continue
            deepest, last = begin + int(np.argmin(sizes[begin:end, k])), end - 1
            least_size = max(sizes[deepest, k], 1e-300)
            grown = max(sizes[last:, k].max() / floor[last], sizes[last, k] / least_size)
            names = list(settings.system.states_of(settings.modes[mode_of[last]]))
            if grown > _GROWN and k < len(names) and _by_itself(settings, pieces[last], k, p):
                found.setdefault(names[k], (floor[last], pieces[deepest, 0]))
    return [
        f"{name} fell below its tolerance, {size:.1g}, and grew again by itself from "
        f"t = {t:.6g} on: what it grew to is not known. Give it a smaller one, "
        f"atol={{{name!r}: …}}, or 0: then its relative error counts"
        for name, (size, t) in found.items()
    ]


def _by_itself(settings: Settings, piece: np.ndarray, k: int, p: tuple) -> bool:
    """Does state k grow at the start of this step, and not if it were zero there?"""
    system, mode = settings.system, settings.modes[int(piece[2])]
    n, held = len(system.states_of(mode)), len(piece) - (settings.length - settings.width)
    here = [*piece[4 : 4 + n].tolist(), *piece[held:].tolist()]
    gone = [*here[:k], 0.0, *here[k + 1 :]]
    flow, s = system.modes[mode].flow, system.S[mode]
    try:
        rates = [float(flow(float(piece[0]), s(*y), p)[k]) for y in (here, gone)]
    except Exception:  # whatever it is, it has been said where it mattered
        return False
    return rates[0] * here[k] > 0.0 and abs(rates[1]) < 0.1 * abs(rates[0])
