"""Counters that meet at chosen instants: guards on a state and on the time, with direction and
without, and clocks; all are self-loops, so each crossing and each tick counts once, in the
order of priorities.
"""

from __future__ import annotations

import random as randoms
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from labkit import At, Every, Mode, System, Transition

from .findings import EPS, OTHER, UNITS, Complaint, close, finished, run

METHODS = ("Euler", "RK4", "RK45", "DOP853")
SLOTS = 8
SHAPES = 40  # what is compiled anew is the shape; everything else is a number
QUARTER = Fraction(1, 4)


@cache
def meter(directions: tuple[int, ...], priorities: tuple[int, ...]) -> System:
    """x moves with p.u; slots 0 to 2 watch x, 3 to 5 the time; 6 and 7 are clocks."""
    watched = (
        lambda t, s, p: s.x - p.c0,
        lambda t, s, p: s.x - p.c1,
        lambda t, s, p: 4.0 * (p.c2 - s.x),
        lambda t, s, p: t - p.c3,
        lambda t, s, p: t - p.c4,
        lambda t, s, p: 0.5 * (p.c5 - t),
    )
    counting = (
        lambda t, s, p: (s.x, s.k0 + 1, s.k1, s.k2, s.k3, s.k4, s.k5, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1 + 1, s.k2, s.k3, s.k4, s.k5, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2 + 1, s.k3, s.k4, s.k5, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2, s.k3 + 1, s.k4, s.k5, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2, s.k3, s.k4 + 1, s.k5, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2, s.k3, s.k4, s.k5 + 1, s.k6, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2, s.k3, s.k4, s.k5, s.k6 + 1, s.k7),
        lambda t, s, p: (s.x, s.k0, s.k1, s.k2, s.k3, s.k4, s.k5, s.k6, s.k7 + 1),
    )
    clocks = (Every("period"), At("a", "b"))
    return System(
        "counters",
        {"x": "", **{f"k{i}": "" for i in range(SLOTS)}},
        {**{f"c{i}": 0.0 for i in range(6)}, "u": 1.0, "period": 1.0, "a": 1.0, "b": 2.0},
        [Mode("only", lambda t, s, p: (p.u, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))],
        [
            Transition(
                "only",
                "only",
                guard=watched[i] if i < 6 else None,
                direction=directions[i] if i < 6 else 0,
                at=clocks[i - 6] if i >= 6 else None,
                urgent=False if i < 6 else None,
                priority=priorities[i],
                reset=counting[i],
                label=str(i),
            )
            for i in range(SLOTS)
        ],
        start={"x": 0.0, **{f"k{i}": 0.0 for i in range(SLOTS)}},
    )


@dataclass(frozen=True)
class Case:
    """Times are counted from t0."""

    u: Fraction
    x0: Fraction
    crossing: tuple[Fraction, ...]  # when slots 0 to 5 cross zero
    directions: tuple[int, ...]
    priorities: tuple[int, ...]
    period: Fraction
    at: tuple[Fraction, Fraction]
    t0: int
    horizon: Fraction
    units: tuple[float, float] = (1.0, 1.0)  # of x, t


def shape(number: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(directions, priorities) of the slots."""
    random = randoms.Random(number)
    directions = random.choice(((1, 0, -1), (0, 1, 0), (0, 0, 0), (1, 1, -1)))
    directions = tuple(random.choice((1, 0, -1)) for _ in range(3)) + directions
    return directions, tuple(random.randint(0, 2) for _ in range(SLOTS))


def generate(random, shapes: int = SHAPES) -> Case:
    places = random.sample(range(1, 17), 2)  # two instants at which most things happen

    def instant():
        return QUARTER * random.choice((*places, *places, random.randint(1, 20)))

    first, second = sorted(random.sample([*places, random.randint(17, 20)], 2))
    return Case(
        random.choice((-1, 1)) * random.choice((Fraction(1, 2), Fraction(1), Fraction(3))),
        random.randint(-8, 8) * QUARTER,
        tuple(instant() for _ in range(6)),
        *shape(random.randrange(shapes)),
        random.choice((Fraction(1, 2), Fraction(1), QUARTER * places[0], QUARTER * places[1])),
        (first * QUARTER, second * QUARTER),
        random.choice((0, 0, 180180)),  # a multiple of all periods: lcm(1 … 16)/4
        random.choice((QUARTER * places[0], QUARTER * places[1], Fraction(4), Fraction(9, 2))),
        (random.choice(UNITS), random.choice(UNITS)),
    )


def rises(case: Case, slot: int) -> bool:
    """Whether the guard of a slot goes up when it crosses zero."""
    if slot < 3:
        return (case.u > 0) != (slot == 2)
    return slot != 5


def ledger(case: Case) -> list[tuple[Fraction, int]]:
    """(instant, slot) of every event, those of one instant by priority."""
    lines = []
    for slot in range(6):
        if case.directions[slot] in (0, 1 if rises(case, slot) else -1):
            lines.append((case.crossing[slot], slot))
    lines += [(k * case.period, 6) for k in range(1, int(case.horizon / case.period) + 1)]
    lines += [(t, 7) for t in case.at]
    inside = [line for line in lines if line[0] <= case.horizon]
    return sorted(inside, key=lambda line: (line[0], -case.priorities[line[1]], line[1]))


def expected(case: Case) -> int:
    return len(ledger(case))


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    unit, second = case.units
    levels = {f"c{i}": float(case.x0 + case.u * case.crossing[i]) * unit for i in range(3)}
    levels |= {f"c{i}": float(case.t0 + case.crossing[i]) * second for i in range(3, 6)}
    done = run(
        meter(case.directions, case.priorities),
        float(case.t0 + case.horizon) * second,
        backend,
        method,
        t0=float(case.t0) * second,
        step=0.0625 * second,
        start={"x": float(case.x0) * unit},
        u=float(case.u) * unit / second,
        period=float(case.period) * second,
        a=float(case.t0 + case.at[0]) * second,
        b=float(case.t0 + case.at[1]) * second,
        **levels,
    )
    lines = ledger(case)
    tolerance = 1e-12 + 64 * EPS * case.t0
    complaints = finished(done)
    counts = {f"k{i}": float(sum(slot == i for _, slot in lines)) for i in range(SLOTS)}
    for name, right in counts.items():
        got = done.final[name]
        if got != right:
            what = "lost" if got < right else "invented"
            text = f"slot {name[1:]} counted {got:g}, right {right:g}"
            complaints.append(Complaint(what, text, int(abs(got - right))))
    order = [slot for _, slot in lines]
    if not complaints and [e.index for e in done.events] != order:
        text = f"order {[e.index for e in done.events]}, right {order}"
        complaints.append(Complaint(OTHER, text))
    if not complaints:
        late = max(
            (
                abs(e.t / second - case.t0 - float(t))
                for e, (t, _) in zip(done.events, lines, strict=True)
            ),
            default=0,
        )
        if late > tolerance:
            complaints.append(Complaint(OTHER, f"an event is {float(late):.3g} off"))
    x = float(case.x0 + case.u * case.horizon)
    return complaints + close({"x": done.final["x"] / unit}, {"x": x}, 4 * tolerance)
