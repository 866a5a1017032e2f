"""Sliding along the surface between two modes: fields that are constant or change linearly
along it, so that arrival, Filippov's mixture and the end of sliding are known in closed form.

In terms of ξ = x − k·y − d: ξ' = α + β·y with an α for each mode, y' = c in both, z' another
constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from labkit import Mode, Output, System, Transition

from .findings import OTHER, Complaint, close, compare, finished, instants, run

METHODS = ("RK4", "RK45", "DOP853", "RK45", "DOP853", "Radau")
HORIZON = 6.0


@cache
def fields(below: int, above: int) -> System:
    """Mode A is meant for ξ < 0, B for ξ > 0; the directions of leaving them."""
    return System(
        "two fields",
        {"x": "", "y": "", "z": ""},
        dict.fromkeys(("k", "d", "c", "beta", "alpha", "alphb", "za", "zb"), 0.0),
        [
            Mode("A", lambda t, s, p: (p.alpha + p.beta * s.y + p.k * p.c, p.c, p.za)),
            Mode("B", lambda t, s, p: (p.alphb + p.beta * s.y + p.k * p.c, p.c, p.zb)),
        ],
        [
            Transition("A", "B", guard=lambda t, s, p: s.x - p.k * s.y - p.d, direction=below),
            Transition("B", "A", guard=lambda t, s, p: s.x - p.k * s.y - p.d, direction=above),
        ],
        start={"x": 0.0, "y": 0.0, "z": 0.0},
        outputs={"rate": Output({"A": lambda t, s, p: p.za, "B": lambda t, s, p: p.zb})},
    )


@dataclass(frozen=True)
class Case:
    k: float
    d: float
    c: float
    beta: float
    a: float  # push of A where y = 0
    b: float  # and of B
    za: float
    zb: float
    gap: float  # ξ at the start
    y: float
    directions: tuple[int, int]
    t0: float


class Grazing(Exception):
    """An arrival or an end that is not clear-cut."""


@dataclass(frozen=True)
class Stretch:
    """A piece of the exact path: from t on in "A", "B" or "on" the surface, beginning at (ξ, y,
    z).
    """

    t: float
    where: str
    gap: float
    y: float
    z: float


def first_root(gap: float, rate: float, bend: float) -> float:
    """The first τ > 0 with gap + rate·τ + bend·τ²/2 = 0, infinity if there is none."""
    if (
        gap == 0
    ):  # begins on the surface: comes back if it is bent, and did not end sliding (rate 0)
        back = -2 * rate / bend if bend and abs(rate) > 1e-9 else 0.0
        return back if back > 0 else math.inf
    if bend == 0:
        return -gap / rate if gap * rate < 0 else math.inf
    disc = rate**2 - 2 * bend * gap
    if abs(disc) < 1e-2:
        raise Grazing
    if disc < 0:
        return math.inf
    roots = [(-rate + s * math.sqrt(disc)) / bend for s in (1, -1)]
    return min((r for r in roots if r > 0), default=math.inf)


def path(case: Case) -> list[Stretch]:
    """The exact pieces up to the horizon, times counted from the start."""
    now = Stretch(0.0, "A" if case.gap < 0 else "B", case.gap, case.y, 0.0)
    found = [now]
    bend = case.beta * case.c
    while True:
        a, b = case.a + case.beta * now.y, case.b + case.beta * now.y
        if now.where == "on":
            to_a = -a / bend if bend < 0 else math.inf
            to_b = -b / bend if bend > 0 else math.inf
            tau, where = (to_a, "A") if to_a < to_b else (to_b, "B")
        else:
            rate = a if now.where == "A" else b
            tau = first_root(now.gap, rate, bend)
            where = ""
        if now.t + tau > HORIZON:
            if now.t + tau < HORIZON + 0.05:
                raise Grazing
            return found
        y, z = now.y + case.c * tau, state(case, now, tau)[2]
        if not where:
            a, b = case.a + case.beta * y, case.b + case.beta * y
            if min(abs(a), abs(b)) < 0.1:
                raise Grazing
            where = "on" if a > 0 > b else "B" if now.where == "A" else "A"
        now = Stretch(now.t + tau, where, 0.0, y, z)
        found.append(now)
        if now.t + 0.05 > HORIZON or len(found) > 6:
            raise Grazing


def part(case: Case, y: float) -> float:
    """Filippov's λ at a place on the surface."""
    return (case.a + case.beta * y) / (case.a - case.b)


def state(case: Case, piece: Stretch, tau: float) -> tuple[float, float, float]:
    """(ξ, y, z) a time after the beginning of a piece."""
    y = piece.y + case.c * tau
    if piece.where == "on":  # λ is linear in time, so its mean is that of the ends
        mean = (part(case, piece.y) + part(case, y)) / 2
        return 0.0, y, piece.z + (case.za + (case.zb - case.za) * mean) * tau
    alpha, rate = (case.a, case.za) if piece.where == "A" else (case.b, case.zb)
    gap = piece.gap + (alpha + case.beta * piece.y) * tau + case.beta * case.c * tau**2 / 2
    return gap, y, piece.z + rate * tau


def generate(random) -> Case:
    def number(most):
        return round(random.uniform(-most, most), 2)

    while True:
        case = Case(
            random.choice((0.0, 1.0, number(2))),
            random.choice((0.0, 1.0, number(2), 100.0)),
            number(1.5),
            random.choice((0.0, number(1), number(1))),
            round(random.uniform(0.3, 3), 2) * random.choice((1, 1, 1, -1)),
            round(random.uniform(0.3, 3), 2) * random.choice((-1, -1, -1, 1)),
            number(2),
            number(2),
            number(2) or 1.0,
            number(1),
            random.choice(((1, -1), (0, 0), (1, 0), (0, -1))),
            random.choice((0.0, 0.0, 1e3)),
        )
        try:
            if case.a > case.b and len(path(case)) > 1:
                return case
        except Grazing:
            continue


def expected(case: Case) -> int:
    return len(path(case)) - 1


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    pieces = path(case)
    done = run(
        fields(*case.directions),
        case.t0 + HORIZON,
        backend,
        method,
        t0=case.t0,
        mode=pieces[0].where,
        start={"x": case.gap + case.k * case.y + case.d, "y": case.y, "z": 0.0},
        step=0.01,
        **{"k": case.k, "d": case.d, "c": case.c, "beta": case.beta},
        **{"alpha": case.a, "alphb": case.b, "za": case.za, "zb": case.zb},
    )
    tolerance = 1e-4 if method == "Radau" else 1e-7
    complaints = finished(done)
    times = instants((e.t - case.t0 for e in done.events), tolerance)
    complaints += compare(times, [piece.t for piece in pieces[1:]], tolerance, "end of a stretch")
    ends = [*(piece.t for piece in pieces[1:]), HORIZON]
    for piece, end in zip(pieces, ends, strict=True):
        tau = (end - piece.t) / 2
        if case.t0 + piece.t + tau > done.t[-1]:
            break
        gap, y, z = state(case, piece, tau)
        at = done.at(case.t0 + piece.t + tau)
        exact = {"x": gap + case.k * y + case.d, "y": y, "z": z}
        if piece.where == "on":
            exact["rate"] = case.za + (case.zb - case.za) * part(case, y)
        elif at["mode"] != piece.where:
            text = f"mode {at['mode']} in the middle of a stretch in {piece.where}"
            complaints.append(Complaint(OTHER, text))
        complaints += close(at, exact, 10 * tolerance)
    return complaints
