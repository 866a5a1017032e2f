"""Bodies that come to rest against something else than a floor: a spring pressed on a stop, a
pendulum on a wall, a table that shakes; any restitution, also none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk, ellipkinc

from labkit import Mode, Parameter, System, Transition

from .findings import OTHER, THROUGH, Complaint, compare, run

METHODS = ("RK4", "RK45", "DOP853")
FREE, REST = "free", "rest"
G = 9.8


@cache
def stop(zeno: str | None) -> System:
    """A spring presses a mass against a stop at x0 > 0."""
    return System(
        "spring on a stop",
        {"x": "m", "v": "m/s"},
        {"e": Parameter(0.5, "", "restitution", 0, 1), "x0": 0.5},
        [Mode(FREE, lambda t, s, p: (s.v, -s.x)), Mode(REST, lambda t, s, p: (0.0, 0.0))],
        [
            Transition(
                FREE,
                FREE,
                guard=lambda t, s, p: s.x - p.x0,
                direction=-1,
                reset=lambda t, s, p: (p.x0, -p.e * s.v),
                zeno=zeno,
                label="stop",
            )
        ],
        start={"x": 1.0, "v": 0.0},
    )


@cache
def pendulum(zeno: str | None) -> System:
    """A pendulum (g/L = 1) that leans on a wall at an angle x0 > 0."""
    return System(
        "pendulum on a wall",
        {"x": "rad", "v": "rad/s"},
        {"e": Parameter(0.5, "", "restitution", 0, 1), "x0": 0.5},
        [
            Mode(FREE, lambda t, s, p: (s.v, -math.sin(s.x))),
            Mode(REST, lambda t, s, p: (0.0, 0.0)),
        ],
        [
            Transition(
                FREE,
                FREE,
                guard=lambda t, s, p: s.x - p.x0,
                direction=-1,
                reset=lambda t, s, p: (p.x0, -p.e * s.v),
                zeno=zeno,
                label="wall",
            )
        ],
        start={"x": 1.0, "v": 0.0},
    )


@cache
def table() -> System:
    """A ball on a table at A sin wt; what is lost is lost of the speed against the table."""
    return System(
        "shaken table",
        {"y": "m", "v": "m/s"},
        {"g": G, "e": Parameter(0.5, "", "restitution", 0, 1), "A": 0.1, "w": 6.0},
        [Mode(FREE, lambda t, s, p: (s.v, -p.g))],
        [
            Transition(
                FREE,
                FREE,
                guard=lambda t, s, p: s.y - p.A * math.sin(p.w * t),
                direction=-1,
                reset=lambda t, s, p: (
                    p.A * math.sin(p.w * t),
                    (1 + p.e) * p.A * p.w * math.cos(p.w * t) - p.e * s.v,
                ),
                label="bounce",
            )
        ],
        start={"y": 1.0, "v": 0.0},
    )


@dataclass(frozen=True)
class Case:
    body: str
    e: float
    x0: float = 0.5
    x: float = 1.0
    zeno: str | None = REST
    A: float = 0.0
    w: float = 1.0
    t0: float = 0.0


def generate(random) -> Case:
    e = random.choice((0.0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.8, 0.9))
    body = random.choice(("stop", "pendulum", "table"))
    if body == "table":
        A, w = round(random.uniform(0.02, 0.3), 3), round(random.uniform(2, 15), 2)
        return Case(body, e, x=round(random.uniform(0.5, 2), 3), zeno=None, A=A, w=w)
    x0 = random.choice((0.1, 0.3, 0.5, 0.8))
    t0 = random.choice((0.0, 0.0, 1e5))
    return Case(
        body, e, x0, x0 + random.choice((0.1, 0.5, 1.0)), random.choice((REST, None)), t0=t0
    )


def flight_of_spring(x0: float, v: float) -> float:
    """x'' = −x from (x0, v) until x0 again."""
    return 2 * math.atan2(v, x0)


def flight_of_pendulum(x0: float, v: float) -> float:
    """x'' = −sin x from (x0, v) until x0 again: a part of the swing's period, by elliptic
    integrals.
    """
    k = math.sqrt(math.sin(x0 / 2) ** 2 + v**2 / 4)
    return 2 * (ellipk(k**2) - ellipkinc(math.asin(math.sin(x0 / 2) / k), k**2))


def pressed(case: Case) -> tuple[list[tuple[float, float]], float]:
    """[(time, impact speed) …] and when the body lies still."""
    if case.body == "stop":
        flight, v = flight_of_spring, math.sqrt(case.x**2 - case.x0**2)
    else:
        flight, v = flight_of_pendulum, math.sqrt(2 * (math.cos(case.x0) - math.cos(case.x)))
    t, hits = flight(case.x0, v) / 2, []
    while v > 1e-9:
        hits.append((t, v))
        v *= case.e
        t += flight(case.x0, v) if v > 0 else 0.0
    return hits, t


def shaken(case: Case, t_end: float) -> tuple[list[float], float]:
    """Instants of the bounces and until when they are certain: flights in closed form, found on
    a grid and by Brent's method, as long as the error of one bounce grows by less than a
    million.
    """
    A, w, e = case.A, case.w, case.e
    t, y, v, hits, growth = 0.0, case.x, 0.0, [], 1.0
    while True:

        def gap(q, t=t, y=y, v=v):
            return y + v * q - G * q**2 / 2 - A * np.sin(w * (t + q))

        longest = (v + math.sqrt(v * v + 2 * G * (abs(y) + A))) / G + 1e-9
        grid = np.linspace(1e-6 if hits else 0.0, longest, 20_001)
        below = np.flatnonzero(gap(grid) < 0)
        if not len(below) or below[0] == 0:
            return hits, t
        q = brentq(gap, grid[below[0] - 1], grid[below[0]], xtol=1e-15)
        table = A * w * math.cos(w * (t + q))
        speed = table - (v - G * q)
        growth *= 1 + 2 * (G + A * w**2) / speed * q
        if t + q > t_end or speed < 0.05 or growth > 1e6:
            return hits, min(t_end, t + 0.9 * q)
        t, y, v = t + q, A * math.sin(w * (t + q)), (1 + e) * table - e * (v - G * q)
        hits.append(t)
        if e == 0:
            return hits, t


def expected(case: Case) -> int:
    if case.body == "table":
        return len(shaken(case, 6.0)[0])
    return sum(v > 1e-3 for _, v in pressed(case)[0])


def check_table(case: Case, backend: str, method: str) -> list[Complaint]:
    # the last bounces before the table carries the ball pile up in a run without a mode for that
    done = run(
        table(), 6.0, backend, method, start={"y": case.x}, e=case.e, A=case.A, w=case.w,
        rtol=1e-10, atol=1e-12, step=2e-3, points=2000,
    )  # fmt: skip
    hits, certain = shaken(case, 6.0)
    found = [e.t for e in done.events if e.t <= certain + 1e-9]
    complaints = compare(found, hits, 1e-6, "bounce")
    low = float(np.max(case.A * np.sin(case.w * done.t) - done["y"]))
    if low > 1e-7:
        complaints.append(Complaint(THROUGH, f"{low:.3g} below the table: {done.stopped}"))
    if not done.stopped.startswith(("finished", "Zeno", "resting contact")):
        complaints.append(Complaint(OTHER, done.stopped))
    return complaints


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    if case.body == "table":
        return check_table(case, backend, method)
    hits, rest = pressed(case)
    done = run(
        {"stop": stop, "pendulum": pendulum}[case.body](case.zeno),
        case.t0 + rest + 2.0,
        backend,
        method,
        t0=case.t0,
        start={"x": case.x},
        e=case.e,
        x0=case.x0,
        rtol=1e-10,
        atol=1e-12,
        step=rest / 4000,
    )
    # Impacts that are not too slow must be resolved, by accuracy and by the clock.
    slowest, tolerance = (1e-2, 1e-5) if method == "RK4" else (1e-3, 1e-6)
    sure = [t for t, v in hits if v > slowest]
    times = [e.t - case.t0 for e in done.events if e.target == FREE]
    if case.e == 0:
        times = times[:1]  # whether a body that does not bounce is a bounce first is left open
        sure = sure[: len(times)]
    found = [t for t in times if t <= sure[-1] + tolerance] if sure else []
    complaints = compare(found, sure, tolerance, "impact")
    low = case.x0 - float(np.min(done["x"]))
    if low > 1e-8:
        complaints.append(Complaint(THROUGH, f"{low:.3g} beyond the stop: {done.stopped}"))
    loose = 1e-5 / (1 - case.e)
    if case.zeno:
        lies = [e.t - case.t0 for e in done.events if e.target == REST]
        if len(lies) != 1 or abs(lies[0] - rest) > loose or done.stopped != "finished":
            text = f"at rest at {lies}, right {rest!r}: {done.stopped}"
            complaints.append(Complaint(OTHER, text))
    elif not done.stopped.startswith(("Zeno", "resting contact")):
        complaints.append(Complaint(OTHER, f"ends at {done.t[-1]!r}: {done.stopped}"))
    elif abs(done.t[-1] - case.t0 - rest) > loose:
        text = f"ends at {done.t[-1] - case.t0!r}, right {rest!r}: {done.stopped}"
        complaints.append(Complaint(OTHER, text))
    return complaints
