"""Six equal elastic bodies on a line: they hand on their velocities, so the exact answer is
free flight with labels exchanged. Distances and velocities are small multiples of 1/4 of some
units, so many impacts coincide, exactly or up to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np

from labkit import Mode, System, Transition

from .findings import EPS, THROUGH, UNITS, Complaint, close, compare, finished, run

METHODS = ("Heun", "RK4", "RK45", "DOP853")
PRIORITIES = ((0, 0, 0, 0, 0), (0, 1, 0, 2, 0), (2, 1, 0, 1, 2), (0, 1, 2, 3, 4), (4, 3, 2, 1, 0))


def roll(t, s, p):
    return s.v1, s.v2, s.v3, s.v4, s.v5, s.v6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


def hit_12(t, s, p):
    return s.x1, s.x2, s.x3, s.x4, s.x5, s.x6, s.v2, s.v1, s.v3, s.v4, s.v5, s.v6


def hit_23(t, s, p):
    return s.x1, s.x2, s.x3, s.x4, s.x5, s.x6, s.v1, s.v3, s.v2, s.v4, s.v5, s.v6


def hit_34(t, s, p):
    return s.x1, s.x2, s.x3, s.x4, s.x5, s.x6, s.v1, s.v2, s.v4, s.v3, s.v5, s.v6


def hit_45(t, s, p):
    return s.x1, s.x2, s.x3, s.x4, s.x5, s.x6, s.v1, s.v2, s.v3, s.v5, s.v4, s.v6


def hit_56(t, s, p):
    return s.x1, s.x2, s.x3, s.x4, s.x5, s.x6, s.v1, s.v2, s.v3, s.v4, s.v6, s.v5


@cache
def line(direction: int, priorities: tuple[int, ...]) -> System:
    pairs = [
        (lambda t, s, p: s.x2 - s.x1, hit_12),
        (lambda t, s, p: s.x3 - s.x2, hit_23),
        (lambda t, s, p: s.x4 - s.x3, hit_34),
        (lambda t, s, p: s.x5 - s.x4, hit_45),
        (lambda t, s, p: s.x6 - s.x5, hit_56),
    ]
    names = [f"{k}{i}" for k in "xv" for i in range(1, 7)]
    return System(
        "bodies on a line",
        dict.fromkeys(names, ""),
        {},
        [Mode("roll", roll)],
        [
            Transition(
                "roll",
                "roll",
                guard=gap,
                direction=direction,
                priority=q,
                reset=hit,
                label=f"{k + 1}",
            )
            for k, ((gap, hit), q) in enumerate(zip(pairs, priorities, strict=True))
        ],
        start=dict.fromkeys(names, 0.0),
    )


@dataclass(frozen=True)
class Case:
    x: tuple[Fraction, ...]
    v: tuple[Fraction, ...]
    direction: int
    priorities: tuple[int, ...]
    shift: float
    t0: float
    horizon: Fraction
    units: tuple[float, float] = (1.0, 1.0)  # of x, t


def crossings(x, v) -> list[Fraction]:
    """When two of the free lines meet: each pair that comes closer is one impact."""
    return sorted(
        (x[j] - x[i]) / (v[i] - v[j]) for i in range(6) for j in range(i + 1, 6) if v[i] > v[j]
    )


def generate(random, shapes: int = len(PRIORITIES)) -> Case:
    direction = random.choice((-1, -1, 0))
    shape = random.choice(("random", "meeting", "cradle" if direction else "meeting"))
    quarter = Fraction(1, 4)
    v = [random.randint(-8, 8) * quarter for _ in range(6)]
    if shape == "random":
        x = [Fraction(0)]
        for _ in range(5):
            x.append(x[-1] + random.randint(1, 8) * quarter)
    elif shape == "meeting":  # bodies that meet in one point at one instant, in two groups
        groups = random.choice(((6,), (3, 3), (4, 2), (5, 1), (2, 4)))
        x, v, place = [], [], Fraction(0)
        for size in groups:
            # different velocities: bodies that touch and move alike have no side without direction
            fast = sorted(random.sample(range(-8, 9), size), reverse=True)
            when = random.randint(1, 8) * quarter
            here = [place + (fast[0] - f) * quarter * when for f in fast]
            x += here
            v += [f * quarter for f in fast]
            place = x[-1] + random.randint(17, 24) * quarter * 8
        order = sorted(range(6), key=lambda k: x[k])
        x, v = [x[k] for k in order], [v[k] for k in order]
    else:  # some swing in together, the others hang and touch
        count = random.randint(1, 3)
        speed = random.randint(1, 8) * quarter
        x = [Fraction(-random.randint(1, 4))] * count + [Fraction(0)] * (6 - count)
        v = [speed] * count + [Fraction(0)] * (6 - count)
    times = crossings(x, v)
    horizon = Fraction(random.randint(4, 40), 4) + Fraction(1, 7)
    while any(abs(t - horizon) < Fraction(1, 100) for t in times):
        horizon += Fraction(1, 41)
    return Case(
        tuple(x),
        tuple(v),
        direction,
        PRIORITIES[random.randrange(shapes)],
        random.choice((0.0, 0.0, 1e3)),
        random.choice((0.0, 0.0, 1e5)),
        horizon,
        (random.choice(UNITS), random.choice(UNITS)),
    )


def expected(case: Case) -> int:
    return sum(t <= case.horizon for t in crossings(case.x, case.v))


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    unit, second = case.units
    clock = 4 * EPS * case.t0 * (1 + expected(case))
    tolerance = 1e-11 * max(case.units) + 1e-12 * case.shift + clock * max(1.0, unit / second)
    start = {f"x{i + 1}": float(x) * unit + case.shift for i, x in enumerate(case.x)}
    start |= {f"v{i + 1}": float(v) * unit / second for i, v in enumerate(case.v)}
    system = line(case.direction, case.priorities)
    end = case.t0 + float(case.horizon) * second
    step = 0.125 * second
    done = run(system, end, backend, method, t0=case.t0, start=start, step=step)
    times = [float(t) * second for t in crossings(case.x, case.v) if t <= case.horizon]
    complaints = finished(done)
    found = [e.t - case.t0 for e in done.events]
    complaints += compare(found, times, tolerance * max(1.0, second / unit), "impact")
    low = min(float(np.min(done[f"x{i + 1}"] - done[f"x{i}"])) for i in range(1, 6))
    if low < -tolerance:
        complaints.append(Complaint(THROUGH, f"a body is {-low:.3g} beyond its neighbour"))
    T = case.horizon
    free = sorted((x + v * T, v) for x, v in zip(case.x, case.v, strict=True))
    exact = {f"x{i + 1}": float(x) * unit + case.shift for i, (x, _) in enumerate(free)}
    exact |= {f"v{i + 1}": float(v) * unit / second for i, (_, v) in enumerate(free)}
    complaints += close(done.final, exact, tolerance)
    return complaints
