"""Where a run meets a section: Poincaré points, and the state once a period.

section(run, 2 * pi)["x"]; section(run, lambda t, s, p: s.v, direction=1).t
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from .model import Function, ModelError, listed, number
from .run import Run, between

__all__ = ["Section", "section"]

PARTS = 8  # of a step, in each of which one zero of the section's function is looked for
EPS = float(np.finfo(float).eps)
ZERO = 1e-12  # of the largest value in a step: what counts as zero at its ends


@dataclass(frozen=True, repr=False, eq=False)
class Section:
    """Poincaré points: section.t (k,), section["x"] (k,) of every state, output and "mode"."""

    t: np.ndarray
    values: Mapping[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.values:
            raise ModelError(f"there is no {name!r} on the section, only {listed(self.values)}")
        return self.values[name]

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return f"Section of {len(self)} points"


def section(
    run: Run, where: float | Function, direction: int = 0, since: float | None = None
) -> Section:
    """section(run, 2 * pi) or section(run, lambda t, s, p: s.v, direction=1) -> Poincaré points.

    where      a period: the states at the start, one period later, … (after events there); or a
               function g(t, s, p): the states where it passes zero along the flow, rising
               (direction 1), falling (-1) or both (0), located on the polynomials of the steps.
               A jump of the state across it is no point; at an event the state is that before it
    since      points before this time are left out

    Two zeros within an eighth of a step are missed: then simulate with a smaller max_step.
    Raises ModelError for a period that is not positive, and as run.at does.
    """
    since = run.t[0] if since is None else number(since, "since")
    if not callable(where):
        period = number(where, "the period of a section")
        if period <= 0:
            raise ModelError(f"the period of a section must be positive, not {period:g}")
        count = int(np.floor((run.t[-1] - run.t[0]) / period * (1 + 1e-12))) + 1
        t = np.minimum(run.t[0] + period * np.arange(count), run.t[-1])
    elif direction in (-1, 0, 1):
        t = _zeros(run, where, direction)
    else:
        raise ModelError(f"direction is 1 (rising), -1 (falling) or 0 (both), not {direction!r}")
    t = np.clip(t[t >= since], run.t[0], run.t[-1])
    return Section(t, run.at(t, side="before" if callable(where) else "after"))


def _zeros(run: Run, g: Function, direction: int) -> np.ndarray:
    """Where g passes zero along the flow: in parts of steps at whose ends its sign differs."""
    system, pieces = run.system, run._pieces
    modes, width, held = list(system.modes), system.width, len(system.held)
    # an event cuts a step short: its polynomial holds up to where the next one begins
    ends = np.minimum(np.append(pieces[1:, 0], run.t[-1]), pieces[:, 0] + pieces[:, 1])
    lasts = (ends - pieces[:, 0]) / pieces[:, 1]
    kinds = {mode: (system.S[mode], list(system.places(mode).values())) for mode in modes}
    found = []
    for piece, last in zip(pieces, lasts.tolist(), strict=True):
        if last <= 0:
            continue
        theta = np.linspace(0, last, PARTS + 1)
        kind, places = kinds[modes[int(piece[2])]]

        def value(x: float, piece=piece, kind=kind, places=places) -> float:
            y, _ = between(piece[None], np.array([x]), width, held)
            t = piece[0] + x * piece[1]
            return float(g(t, kind(*y[0, places].tolist()), run.p))  # type: ignore[arg-type]

        values = np.array([value(x) for x in theta])
        steep = np.abs(np.diff(values)).max() * PARTS / (last * piece[1])
        beyond = values > ZERO * np.abs(values).max() + 4 * EPS * abs(piece[0] + piece[1]) * steep
        for k in np.flatnonzero(beyond[1:] != beyond[:-1]):
            rises = bool(beyond[k + 1])
            if direction and rises != (direction > 0):
                continue
            a, b = theta[k], theta[k + 1]
            if values[k] * values[k + 1] < 0:
                a = brentq(value, a, b, xtol=1e-15)
            elif not rises:  # it ends at zero, to rounding
                a = b
            found.append(piece[0] + a * piece[1])
    return np.array(found, dtype=float)
