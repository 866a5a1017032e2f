"""Where a run meets a section: Poincaré points, and the state once a period.

section(run, 2 * pi)["x"]; section(run, lambda t, s, p: s.v, direction=1).t
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .arguments import asked
from .model import Function, ModelError, check_names, number
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

    @asked
    def __getitem__(self, name: str) -> np.ndarray:
        check_names([name], self.values, "there is no {} on the section")
        return self.values[name]

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return f"Section of {len(self)} points"


@asked
def section(
    run: Run, where: float | Function, direction: int = 0, since: float | None = None
) -> Section:
    """section(run, 2 * pi) or section(run, lambda t, s, p: s.v, direction=1) -> Poincaré points.

    where      a period: the states at the start, one period later, … (after events there); or a
               function g(t, s, p): the states where it passes zero along the flow, rising
               (direction 1), falling (-1) or both (0), located on the polynomials of the steps
    since      points before this time are left out

    At an event: where the flow before it comes to zero there is one point, a fall if it comes from
    above, with the state before the event; a jump of the state across zero is none. A start on
    the section is a point, a rise if it goes up, and so is an end on it; a touch of zero between
    events is none.
    Two zeros within an eighth of a step are missed: then simulate with a smaller max_step.
    Raises ModelError for a period that is not positive, and as run.at does.
    """
    since = run.t[0] if since is None else number(since, "since")
    if direction not in (-1, 0, 1):
        raise ModelError(f"direction is 1 (rising), -1 (falling) or 0 (both), not {direction!r}")
    if not callable(where):
        period = number(where, "the period of a section")
        if period <= 0:
            raise ModelError(f"the period of a section must be positive, not {period:g}")
        count = int(np.floor((run.t[-1] - run.t[0]) / period * (1 + 1e-12))) + 1
        t = np.minimum(run.t[0] + period * np.arange(count), run.t[-1])
    else:
        t = _zeros(run, where, direction)
    t = np.clip(t[t >= since], run.t[0], run.t[-1])
    return Section(t, run.at(t, side="before" if callable(where) else "after"))


def _zeros(run: Run, g: Function, direction: int) -> np.ndarray:
    """Where g comes from one side to the other along the flow, or to zero at an event."""
    from scipy.optimize import brentq  # takes 0.3 s, and `periodic` does without

    system, width, held = run.system, run.system.width, len(run.system.held)
    # as run.at reads them, each polynomial holds up to where the next one begins
    ends = np.append(run._pieces[1:, 0], run.t[-1])
    lasts = (ends - run._pieces[:, 0]) / run._pieces[:, 1]
    pieces, lasts, ends = (what[lasts > 0] for what in (run._pieces, lasts, ends))
    kinds = [(system.S[mode], list(system.places(mode).values())) for mode in system.modes]

    def measured(pieces: np.ndarray, x: np.ndarray) -> list[float]:
        states, _ = between(pieces, x, width, held)
        found = []
        for mode, t, y in zip(pieces[:, 2], pieces[:, 0] + x * pieces[:, 1], states, strict=True):
            kind, places = kinds[int(mode)]
            found.append(float(g(float(t), kind(*y[places].tolist()), run.p)))  # type: ignore[arg-type]
        return found

    thetas = np.linspace(0, lasts, PARTS + 1, axis=1)
    each = np.repeat(pieces, PARTS + 1, axis=0)
    values = np.reshape(measured(each, thetas.ravel()), thetas.shape)
    most = np.abs(values).max(axis=1, initial=0.0)
    steep = np.abs(np.diff(values)).max(axis=1, initial=0.0) * PARTS / (lasts * pieces[:, 1])
    clock = 4 * EPS * np.abs(pieces[:, 0] + pieces[:, 1])
    slack = np.tile((ZERO * most + clock * steep)[:, None], PARTS + 1)  # what counts as zero
    # both sides of an instant are measured alike
    slack[1:, 0] = slack[:-1, -1] = np.maximum(slack[1:, 0], slack[:-1, -1])
    events = {*(event.t for event in run.events), float(run.t[-1])}
    points, start = [], True  # (t, whether it rises)
    side, last, zero = 0.0, (0, 0), None  # the side g was on, at which node, where it became zero
    signs = np.where(np.abs(values) <= slack, 0.0, np.sign(values))
    for k, (piece, theta) in enumerate(zip(pieces, thetas, strict=True)):
        for i, sign in enumerate(signs[k].tolist()):
            when = piece[0] + theta[i] * piece[1]
            if sign == 0:
                zero = when if zero is None else zero
                continue
            if start and zero is not None:
                points.append((run.t[0], sign > 0))
            start = False
            if side * sign < 0:
                if last[0] == k:
                    crossing = brentq(
                        lambda x, own=piece[None]: measured(own, np.array([x]))[0],
                        theta[last[1]],
                        theta[i],
                        xtol=1e-15,
                    )
                    when = piece[0] + piece[1] * crossing
                points.append((when if zero is None or last[0] == k else zero, sign > 0))
            side, last, zero = sign, (k, i), None
        if float(ends[k]) in events:
            start = False
            if zero is not None and side:
                points.append((ends[k], side < 0))
            side, zero = 0.0, None  # what comes after has a side of its own
    wanted = {0: (True, False), 1: (True,), -1: (False,)}[direction]
    return np.array([t for t, rises in points if rises in wanted], dtype=float)
