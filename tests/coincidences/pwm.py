"""On at every k·T, off at every (k + D)·T, x' = u − x: duty 0 and 1 put both on one instant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from labkit import Every, Mode, Parameter, System, Transition

from .findings import OTHER, Complaint, close, finished, run

METHODS = ("RK4", "RK45", "DOP853")


@cache
def modulator(priorities: tuple[int, int]) -> System:
    return System(
        "pulse-width modulator",
        {"x": ""},
        {"T": 0.02, "D": Parameter(0.25, "", "duty", 0, 1)},
        [Mode("on", lambda t, s, p: (1.0 - s.x,)), Mode("off", lambda t, s, p: (-s.x,))],
        [
            Transition(
                "on", "off", at=Every("T", lambda p: p.D * p.T), priority=priorities[0], label="off"
            ),
            Transition("off", "on", at=Every("T"), priority=priorities[1], label="on"),
        ],
        start={"x": 0.0},
    )


@dataclass(frozen=True)
class Case:
    T: float
    D: float
    x: float
    periods: int
    priorities: tuple[int, int]


def generate(random) -> Case:
    return Case(
        random.choice((0.02, 0.125, 0.1, 1 / 3, 1.0)),
        random.choice((0.0, 0.0, 1.0, 1.0, 0.25, 0.5, 0.999, round(random.uniform(0.01, 0.99), 3))),
        random.choice((0.0, 1.0, -0.5)),
        random.randint(1, 40),
        random.choice(((0, 0), (1, 0), (0, 1))),
    )


def expected(case: Case) -> int:
    return 2 * case.periods


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    # half a period past the last instant "on", so that what holds at the very end does not matter
    tail = 0.5 * case.T
    t_end = case.periods * case.T + tail
    done = run(
        modulator(case.priorities), t_end, backend, method, start={"x": case.x},
        T=case.T, D=case.D, rtol=1e-10, atol=1e-12, step=min(0.01, case.T / 20),
    )  # fmt: skip
    x = case.x
    for length in [case.T] * case.periods + [tail]:
        on = min(case.D * case.T, length)
        x = 1 + (x - 1) * math.exp(-on)
        x *= math.exp(on - length)
    complaints = finished(done) + close(done.final, {"x": x}, 1e-8)
    still_on = case.D > 0.5
    if abs(case.D - 0.5) > 1e-3 and (done.mode[-1] == "on") != still_on:
        complaints.append(Complaint(OTHER, f"ends {done.mode[-1]}"))
    return complaints
