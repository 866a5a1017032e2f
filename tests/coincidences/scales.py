"""A guard on its own scale: times 1e-16 … 1e16 it is the same guard, and a state of 1e9 beside it
changes nothing; a start beyond it is refused all the same."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from labkit import Mode, ModelError, System, Transition

from .findings import OTHER, Complaint, compare, finished, run

METHODS = ("RK45", "DOP853")
HORIZON = 20.0


def swing(t, s, p):
    return s.v, -s.x, 0.0


@cache
def scaled(direction: int) -> System:
    """A swing of amplitude p.a beside a state P, watched at p.part of the amplitude by a guard
    times p.k.
    """
    return System(
        "scaled guard",
        {"x": "", "v": "", "P": ""},
        {"k": 1.0, "a": 1.0, "part": 0.0},
        [Mode("swing", swing)],
        [
            Transition(
                "swing",
                "swing",
                guard=lambda t, s, p: p.k * (s.x - p.part * p.a),
                direction=direction,
                urgent=False,
                label="level",
            )
        ],
        start={"x": 1.0, "v": 0.0, "P": 0.0},
    )


@cache
def growing(direction: int) -> System:
    """y' = y, which says nothing of the clock; and a level far below."""
    return System(
        "growth beside a clock",
        {"y": "", "x": ""},
        {"when": 40.0, "level": 0.5},
        [Mode("grow", lambda t, s, p: (s.y, 0.01))],
        [
            Transition(
                "grow", "grow", guard=lambda t, s, p: t - p.when, direction=direction, label="clock"
            ),
            Transition(
                "grow", "grow", guard=lambda t, s, p: s.x - p.level, direction=direction, label="x"
            ),
        ],
        start={"y": 1.0, "x": 0.0},
    )


@cache
def refusing(direction: int) -> System:
    return System(
        "start beyond",
        {"P": "", "x": ""},
        {"k": 1.0},
        [Mode("only", lambda t, s, p: (0.0, p.k))],
        [
            Transition(
                "only",
                None,
                guard=lambda t, s, p: p.k * (s.x - 1),
                direction=direction,
                label="end",
            )
        ],
        start={"P": 0.0, "x": 0.0},
    )


@dataclass(frozen=True)
class Case:
    form: str
    direction: int
    power: int  # of the guard's factor
    size: int  # power of ten of the amplitude
    P: float
    part: float


def generate(random) -> Case:
    form = random.choice(("swing", "swing", "swing", "growth", "refused"))
    return Case(
        form,
        random.choice((0, 1, -1)) if form == "swing" else random.choice((0, 1)),
        random.choice((0, 0, random.randint(-16, 16))),
        random.choice((0, random.randint(-10, 0))),
        random.choice((0.0, 1e3, 1e6, 1e9, -1e9)),
        random.choice((0.0, 0.5, -0.25, 0.875)),
    )


def levels(case: Case) -> list[float]:
    """When cos t = part, rising (+1) or falling (−1) as asked."""
    first = math.acos(case.part)
    falls = [first + 2 * math.pi * k for k in range(4)]
    rises = [2 * math.pi - first + 2 * math.pi * k for k in range(4)]
    times = (falls if case.direction <= 0 else []) + (rises if case.direction >= 0 else [])
    return sorted(t for t in times if t <= HORIZON)


def expected(case: Case) -> int:
    return {"swing": len(levels(case)), "growth": 2, "refused": 0}[case.form]


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    a, k = 10.0**case.size, 10.0**case.power
    if case.form == "swing":
        done = run(
            scaled(case.direction), HORIZON, backend, method,
            start={"x": a, "v": 0.0, "P": case.P}, k=k, a=a, part=case.part,
            rtol=1e-10, atol=1e-12 * a,
        )  # fmt: skip
        times = [e.t for e in done.events]
        return finished(done) + compare(times, levels(case), 1e-7, "level")
    if case.form == "growth":
        level = 0.1 + abs(case.part) / 4
        done = run(growing(case.direction), 60.0, backend, method, when=40.0, level=level)
        complaints = finished(done)
        for label, time in (("clock", 40.0), ("x", 100 * level)):
            found = [e.t for e in done.events if e.transition == label]
            complaints += compare(found, [time], 1e-8, label)
        return complaints
    start = {"P": case.P, "x": 1.5}
    try:
        done = run(refusing(1), 5.0, backend, method, start=start, k=k)
    except ModelError:
        return []
    return [Complaint(OTHER, f"a start 0.5 beyond is taken: {done.stopped}")]
