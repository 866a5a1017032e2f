"""A ball over a floor anywhere, on any clock, losing little or much: bounces at their exact
times while they can be resolved, at rest at t1 + (2 v1/g)·e/(1 − e), never below the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from labkit import Mode, Parameter, System, Transition

from .findings import EPS, OTHER, SCIPY, THROUGH, Complaint, compare, run

METHODS = ("Heun", "RK4", "RK45", "DOP853", "RK45", "DOP853", "LSODA", "Radau", "BDF")
G = 9.8


@cache
def ball(zeno: str | None) -> System:
    return System(
        "ball over a floor",
        {"y": "m", "v": "m/s"},
        {"g": G, "e": Parameter(0.5, "", "restitution", 0, 1), "H": 0.0},
        [
            Mode("flight", lambda t, s, p: (s.v, -p.g)),
            Mode("rest", lambda t, s, p: (0.0, 0.0)),
        ],
        [
            Transition(
                "flight",
                "flight",
                guard=lambda t, s, p: s.y - p.H,
                direction=-1,
                reset=lambda t, s, p: (p.H, -p.e * s.v),
                zeno=zeno,
                label="bounce",
            )
        ],
        start={"y": 1.0, "v": 0.0},
    )


@dataclass(frozen=True)
class Case:
    H: float
    height: float  # of the start over the floor
    v: float
    e: float
    t0: float
    zeno: str | None

    @property
    def impact(self) -> float:
        """Speed of the first impact."""
        return math.sqrt(self.v**2 + 2 * G * self.height)

    @property
    def first(self) -> float:
        return (self.v + self.impact) / G

    @property
    def rest(self) -> float:
        return self.first + 2 * self.impact / G * self.e / (1 - self.e)

    def bounces(self, slowest: float) -> list[tuple[float, float]]:
        """(time from t0, speed before) of every bounce that is faster."""
        t, v, found = self.first, self.impact, []
        while v > slowest:
            found.append((t, v))
            v *= self.e
            t += 2 * v / G
        return found

    def blur(self, method: str) -> float:
        """How well a height over the floor is known."""
        scale = abs(self.H) + self.height + self.v**2 / (2 * G)
        return scale * (1e-6 if method in SCIPY else 64 * EPS) + (1e-8 if method in SCIPY else 0)

    def slowest(self, method: str) -> float:
        """Impacts faster than this must be resolved: they rise a hundred times higher than what
        is known of the height, and fly a thousand times longer than the clock's rounding.
        """
        clock = EPS * (self.t0 + self.rest)
        return max(math.sqrt(200 * G * self.blur(method)), 500 * G * clock) / self.e


def generate(random) -> Case:
    sign = random.choice((-1, 0, 1))
    return Case(
        sign * 10.0 ** random.randint(-3, 3),
        round(10 ** random.uniform(-1.5, 1.0), 3),
        round(random.uniform(0, 5), 2),
        random.choice((0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)),
        random.choice((0.0, 0.0, 1.0, 1e3, 3e5, 1e6)),
        random.choice(("rest", None)),
    )


def expected(case: Case) -> int:
    return len(case.bounces(case.slowest("RK45")))


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    options = {"step": case.rest / 400} if method in ("Heun", "RK4") else {}
    done = run(
        ball(case.zeno),
        case.t0 + case.rest + 3.0,
        backend,
        method,
        t0=case.t0,
        start={"y": case.H + case.height, "v": case.v},
        e=case.e,
        H=case.H,
        **options,
    )
    blur, slowest = case.blur(method), case.slowest(method)
    clock = EPS * (case.t0 + case.rest)
    exact = case.bounces(slowest)
    # A height off by `blur` is a bounce off by blur/v, and every bounce stands on the clock's grid;
    # what a speed is off by then lengthens all flights that follow, e + e² + … times.
    bounds = [
        1e-9 * (1 + t) + 4 * (blur / (v * case.e) + (k + 1) * clock) / (1 - case.e)
        for k, (t, v) in enumerate(exact)
    ]
    times = [e.t - case.t0 for e in done.events if e.target == "flight"]
    complaints = compare(times[: len(exact)], [t for t, _ in exact], bounds, "bounce")
    low = case.H - float(np.min(done["y"]))
    if low > 4 * blur + 16 * case.impact * clock:
        complaints.append(Complaint(THROUGH, f"{low:.3g} below the floor: {done.stopped}"))
    # What was not resolved may take as long as the flights after the last one that must be.
    loose = 1e-8 * (1 + case.rest) + 2 * slowest / G / (1 - case.e) + 1e3 * clock / (1 - case.e)
    loose += bounds[-1] if bounds else 0.0
    end = done.t[-1] - case.t0
    if case.zeno:
        lies = [e.t - case.t0 for e in done.events if e.target == "rest"]
        if len(lies) != 1 or abs(lies[0] - case.rest) > loose or done.stopped != "finished":
            text = f"at rest at {lies}, right {case.rest!r} within {loose:.1g}: {done.stopped}"
            complaints.append(Complaint(OTHER, text))
        elif abs(done.final["y"] - case.H) > blur or done.mode[-1] != "rest":
            text = f"ends at {done.final['y']!r} in mode {done.mode[-1]!r}"
            complaints.append(Complaint(OTHER, text))
    elif not done.stopped.startswith(("Zeno", "resting contact")):
        complaints.append(Complaint(OTHER, f"ends at {end!r}: {done.stopped}"))
    elif abs(end - case.rest) > loose:
        text = f"ends at {end!r}, right {case.rest!r} within {loose:.1g}: {done.stopped}"
        complaints.append(Complaint(OTHER, text))
    return complaints
