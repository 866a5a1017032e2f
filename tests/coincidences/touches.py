"""A swing that comes up to a limit: passed by more than the tolerance it is an event, missed by
more nothing, and between a touch, reported once, whatever the sign of the numerical error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from labkit import Mode, System, Transition

from .findings import OTHER, Complaint, compare, finished, run

METHODS = ("RK45", "DOP853")
PEAKS = 3


@cache
def swing(form: str, direction: int, tolerance: float) -> System:
    """Direction +1: the limit is 1 above; −1: −1 below. In the state, or in the guard alone."""
    guards = {
        ("state", 1): lambda t, s, p: s.x - 1,
        ("state", -1): lambda t, s, p: s.x + 1,
        ("guard", 1): lambda t, s, p: p.a * math.sin(t - p.begin) - 1,
        ("guard", -1): lambda t, s, p: p.a * math.sin(t - p.begin) + 1,
    }
    return System(
        "swing up to a limit",
        {"x": "", "v": ""},
        {"a": 1.0, "begin": 0.0},
        [Mode("swing", lambda t, s, p: (s.v, -s.x))],
        [
            Transition(
                "swing",
                "swing",
                guard=guards[form, direction],
                direction=direction,
                tolerance=tolerance,
                urgent=False,
                label="limit",
            )
        ],
        start={"x": 0.0, "v": 1.0},
    )


@dataclass(frozen=True)
class Case:
    form: str
    direction: int
    tolerance: float
    rtol: float
    part: float  # (peak − limit)/tolerance
    t0: float

    @property
    def amplitude(self) -> float:
        return 1 + self.part * self.tolerance


def generate(random) -> Case:
    """Tolerances of the limit stay far above the error that the integration makes in three
    swings.
    """
    rtol = 10.0 ** -random.randint(4, 12)
    powers = [k for k in range(-8, -1) if 10.0**k >= 2e3 * rtol] or [-1]
    return Case(
        random.choice(("state", "guard")),
        random.choice((1, -1)),
        10.0 ** random.choice(powers),
        rtol,
        random.choice((0.0, 0.0, 0.0, 0.3, -0.3, 0.7, -0.7, 1.5, -1.5, 3.0, -3.0, -1e4)),
        random.choice((0.0, 0.0, 1e3)),
    )


def peaks(case: Case) -> list[float]:
    first = 0.5 if case.direction > 0 else 1.5
    return [math.pi * (first + 2 * k) for k in range(PEAKS)]


def expected(case: Case) -> int:
    return PEAKS if case.part >= -1 else 0


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    a = max(case.amplitude, 0.1)
    done = run(
        swing(case.form, case.direction, case.tolerance),
        case.t0 + 2 * math.pi * PEAKS,
        backend,
        method,
        t0=case.t0,
        rtol=case.rtol,
        atol=case.rtol / 100,
        max_step=0.5,
        a=a,
        begin=case.t0,
        start={"x": 0.0, "v": a},
    )
    touched = peaks(case) if abs(case.part) <= 1 else []
    passed = []
    if case.part > 1:  # the event is where the limit is passed by its tolerance
        early = math.acos((1 + case.tolerance) / a)
        passed = [peak - early for peak in peaks(case)]
    # a peak is flat: an error of a thousandth of the tolerance moves its place by the root of it
    wide = 0.1 + math.sqrt(case.tolerance)
    complaints = finished(done)
    complaints += compare([e.t - case.t0 for e in done.events], passed, wide, "limit passed")
    complaints += compare([e.t - case.t0 for e in done.touches], touched, wide, "touch")
    for touch in done.touches:
        if abs(touch.by - (a - 1)) > 0.3 * case.tolerance:
            complaints.append(Complaint(OTHER, f"touched by {touch.by!r}, right {a - 1!r}"))
    return complaints
