"""A point in a rectangle whose walls send it back: unfolded it flies straight. Corners are
aimed at, and hit exactly or up to rounding, by the units.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np

from labkit import Mode, System, Transition

from .findings import EPS, THROUGH, UNITS, Complaint, close, compare, finished, run

METHODS = ("Heun", "RK4", "RK45", "DOP853")
PRIORITIES = ((0, 0, 0, 0), (0, 0, 1, 1), (1, 0, 0, 1), (3, 2, 1, 0))


@cache
def table(direction: int, priorities: tuple[int, ...]) -> System:
    walls = (
        (lambda t, s, p: p.left - s.x, lambda t, s, p: (s.x, s.y, -s.vx, s.vy)),
        (lambda t, s, p: s.x - p.left - p.wide, lambda t, s, p: (s.x, s.y, -s.vx, s.vy)),
        (lambda t, s, p: p.low - s.y, lambda t, s, p: (s.x, s.y, s.vx, -s.vy)),
        (lambda t, s, p: s.y - p.low - p.high, lambda t, s, p: (s.x, s.y, s.vx, -s.vy)),
    )
    return System(
        "billiard",
        {"x": "", "y": "", "vx": "", "vy": ""},
        {"left": 0.0, "low": 0.0, "wide": 2.0, "high": 1.0},
        [Mode("roll", lambda t, s, p: (s.vx, s.vy, 0.0, 0.0))],
        [
            Transition(
                "roll",
                "roll",
                guard=guard,
                direction=direction,
                reset=reset,
                priority=q,
                label=name,
            )
            for (guard, reset), q, name in zip(
                walls, priorities, ("left", "right", "bottom", "top"), strict=True
            )
        ],
        start={"x": 1.0, "y": 0.5, "vx": 1.0, "vy": 1.0},
    )


@dataclass(frozen=True)
class Case:
    wide: Fraction
    high: Fraction
    x: Fraction
    y: Fraction
    vx: Fraction
    vy: Fraction
    direction: int
    priorities: tuple[int, ...]
    left: float
    low: float
    t0: float
    horizon: Fraction
    units: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of x, y, t


def hits(place: Fraction, speed: Fraction, width: Fraction, horizon: Fraction) -> list[Fraction]:
    """When place + speed·t is a multiple of the width."""
    if speed == 0:
        return []
    ends = sorted((place, place + speed * horizon))
    first, last = -(-ends[0] // width), ends[1] // width
    return sorted((k * width - place) / speed for k in range(int(first), int(last) + 1))


def folded(place: Fraction, speed: Fraction, width: Fraction) -> tuple[Fraction, Fraction]:
    """Where and how fast the folded point is: (place within the width, speed)."""
    turn, rest = divmod(place, width)
    return (rest, speed) if turn % 2 == 0 else (width - rest, -speed)


def generate(random, shapes: int = len(PRIORITIES)) -> Case:
    wide, high = Fraction(random.randint(2, 12), 4), Fraction(random.randint(2, 12), 4)
    x, y = wide * Fraction(random.randint(1, 7), 8), high * Fraction(random.randint(1, 7), 8)
    if random.random() < 0.8:  # into a corner of the unfolded plane at a chosen instant
        when = Fraction(random.choice((1, 2, 4, 3)), 2)
        vx = (random.randint(-3, 3) * wide - x) / when
        vy = (random.randint(-3, 3) * high - y) / when
    else:
        vx, vy = (Fraction(random.randint(-8, 8), 4) for _ in range(2))
    times = hits(x, vx, wide, Fraction(40)) + hits(y, vy, high, Fraction(40))
    horizon = Fraction(random.randint(8, 30)) / 2 + Fraction(1, 7)
    while any(abs(t - horizon) < Fraction(1, 100) for t in times):
        horizon += Fraction(1, 41)
    left, low = random.choice(((0.0, 0.0), (0.0, 0.0), (-1024.0, 512.0)))
    return Case(
        wide, high, x, y, vx, vy,
        random.choice((0, 1)), PRIORITIES[random.randrange(shapes)],
        left, low, random.choice((0.0, 0.0, 1e5)), horizon,
        (random.choice(UNITS), random.choice(UNITS), random.choice(UNITS)),
    )  # fmt: skip


def walls_hit(case: Case) -> list[Fraction]:
    return sorted(
        hits(case.x, case.vx, case.wide, case.horizon)
        + hits(case.y, case.vy, case.high, case.horizon)
    )


def expected(case: Case) -> int:
    return len(walls_hit(case))


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    # every hit stands on the clock's grid, and the way back begins where it stands
    wide, high, second = case.units
    clock = 4 * EPS * case.t0 * (1 + expected(case))
    done = run(
        table(case.direction, case.priorities),
        case.t0 + float(case.horizon) * second,
        backend,
        method,
        t0=case.t0,
        step=0.125 * second,
        start={
            "x": case.left + float(case.x) * wide,
            "y": case.low + float(case.y) * high,
            "vx": float(case.vx) * wide / second,
            "vy": float(case.vy) * high / second,
        },
        wide=float(case.wide) * wide,
        high=float(case.high) * high,
        left=case.left,
        low=case.low,
    )
    off = 1e-11 + 1e-12 * abs(case.left) / min(wide, high) + clock / second  # in units
    times = [float(t) for t in walls_hit(case)]
    complaints = finished(done)
    complaints += compare([(e.t - case.t0) / second for e in done.events], times, off, "wall")
    x, y = (done["x"] - case.left) / wide, (done["y"] - case.low) / high
    out = max(-np.min(x), -np.min(y), np.max(x) - float(case.wide), np.max(y) - float(case.high))
    speed = 1.0 + float(max(abs(case.vx), abs(case.vy)))
    if out > off * speed:
        complaints.append(Complaint(THROUGH, f"{out:.3g} outside"))
    T = case.horizon
    x, vx = map(float, folded(case.x + case.vx * T, case.vx, case.wide))
    y, vy = map(float, folded(case.y + case.vy * T, case.vy, case.high))
    end = done.final
    found = {"x": (end["x"] - case.left) / wide, "y": (end["y"] - case.low) / high}
    found |= {"vx": end["vx"] * second / wide, "vy": end["vy"] * second / high}
    exact = {"x": x, "y": y, "vx": vx, "vy": vy}
    return complaints + close(found, exact, off * speed)
