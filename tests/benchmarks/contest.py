"""What a contestant is, and how well it did.

    Contestant("solve_ivp", "RK45", make=lambda tol: lambda: Answer(state, instants))

`make(tol)` prepares everything that a user prepares once (compilation, solver objects); the
function that it returns is one run from the start to the end, the thing that is timed. It may be
called any number of times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .problems import Problem

#: A loop that has met so many events gives up: at a loose tolerance a ball may lose so much that
#: its bounces pile up.
ENOUGH = 2000


class Answer(NamedTuple):
    """State at the end, and the instants of all events that the run has made."""

    state: Sequence[float]
    instants: Sequence[float]


class Contestant(NamedTuple):
    """A tool with one of its methods, on one problem."""

    tool: str
    method: str
    make: Callable[[float], Callable[[], Answer]]


def judge(problem: Problem, answer: Answer) -> tuple[float, int, int]:
    """judge(problem, answer) -> (largest error of the final state, events missed, events invented).

    Missed is an event of the reference that the run has not made to within a quarter of the usual
    (median) time between two events, invented one of the run that the reference does not have; each
    is matched once, in order of time.
    """
    instants, state = problem.reference()
    error = max(abs(float(a) - b) for a, b in zip(answer.state, state, strict=True))
    near = 0.25 * float(np.median(np.diff(instants))) if len(instants) > 1 else 0.0
    left = sorted(
        float(t) for t in answer.instants if t < problem.t_end * (1 - 1e-9)
    )  # a clock may tick at the very end
    missed = 0
    for t in instants:
        place = next((k for k, other in enumerate(left) if abs(other - t) < near), None)
        if place is None:
            missed += 1
        else:
            del left[place]
    return error if error == error else float("inf"), missed, len(left)
