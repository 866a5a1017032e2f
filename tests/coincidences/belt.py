"""A mass on a spring, carried by a belt of speed 1: v' = −x ∓ F. It sticks while |x| ≤ F, slips
when the spring is stronger. Constant friction: circles in closed form; friction that falls with
the speed of slip: integrated by SciPy, mode by mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from scipy.integrate import solve_ivp

from labkit import Mode, System, Transition

from .findings import OTHER, Complaint, compare, finished, instants, run

METHODS = ("RK4", "RK45", "DOP853", "Radau")
HORIZON = 20.0


def friction(law: str, F: float, slip: float) -> float:
    return F if law == "constant" else F * (1 + 0.5 * math.exp(-slip)) / 1.5


@cache
def belt(law: str, directed: bool) -> System:
    flows = {
        "constant": (
            lambda t, s, p: (s.v, -s.x + p.F),
            lambda t, s, p: (s.v, -s.x - p.F),
        ),
        "falling": (
            lambda t, s, p: (s.v, -s.x + p.F * (1 + 0.5 * math.exp(s.v - 1)) / 1.5),
            lambda t, s, p: (s.v, -s.x - p.F * (1 + 0.5 * math.exp(1 - s.v)) / 1.5),
        ),
    }[law]
    return System(
        "belt",
        {"x": "m", "v": "m/s"},
        {"F": 1.5},
        [Mode("slower", flows[0]), Mode("faster", flows[1])],
        [
            Transition(
                "slower", "faster", guard=lambda t, s, p: s.v - 1, direction=1 if directed else 0
            ),
            Transition(
                "faster", "slower", guard=lambda t, s, p: s.v - 1, direction=-1 if directed else 0
            ),
        ],
        start={"x": 0.0, "v": 0.0},
    )


@dataclass(frozen=True)
class Case:
    law: str
    F: float
    x: float
    v: float
    directed: bool
    rtol: float


def generate(random) -> Case:
    start = random.choice(((0.0, 0.0), (0.0, 0.0), (1.0, 2.0), (-2.5, -0.5), (2.0, 0.25)))
    return Case(
        random.choice(("constant", "falling")),
        float(np.linspace(0.3, 3, 201)[random.randint(0, 200)]),
        *start,
        random.random() < 0.6,
        10.0 ** -random.randint(6, 10),
    )


def slip(law: str, F: float, t: float, x: float, v: float, slower: bool):
    """(t, x, v, well-conditioned) where v reaches 1 next, or None within the horizon."""
    sign = 1 if slower else -1
    if law == "constant":  # a circle about ±F
        radius, angle = math.hypot(x - sign * F, v), math.atan2(v, x - sign * F)
        if radius <= 1:
            return t + 2 * HORIZON, x, v, radius < 0.999
        # clockwise: from below to the point with v = 1 on the left, from above to that on the right
        side = math.asin(1 / radius)
        turn = (angle - (math.pi - side if slower else side)) % (2 * math.pi)
        if turn < 1e-9 or turn > 2 * math.pi - 1e-9:
            turn = 2 * math.pi
        x_end = sign * F + (-sign) * math.sqrt(radius**2 - 1)
        return t + turn, x_end, 1.0, radius > 1.001

    def flow(t, y):
        return y[1], -y[0] + sign * friction(law, F, abs(y[1] - 1))

    def crossing(t, y):
        return y[1] - 1 if t > begin + 1e-6 else -sign

    begin = t
    crossing.terminal, crossing.direction = True, sign
    path = solve_ivp(
        flow, (t, t + HORIZON), (x, v), "DOP853", rtol=1e-12, atol=1e-13, events=crossing,
        max_step=0.02,
    )  # fmt: skip
    near = path.y[1][1:-1]
    peak = (np.diff(near[:-1]) * sign > 0) & (np.diff(near[1:]) * sign < 0)
    grazes = bool(np.any(np.abs(near[1:-1][peak] - 1) < 2e-3))
    if not len(path.t_events[0]):
        return t + 2 * HORIZON, x, v, not grazes
    (x_end, v_end), end = path.y_events[0][0], path.t_events[0][0]
    return end, x_end, v_end, not grazes


@lru_cache(maxsize=10_000)
def story(law: str, F: float, x: float, v: float) -> tuple[list[float], list[tuple], float]:
    """Instants of events, stretches of sticking (t, end, x) and until when all this is certain.

    It is not where v only grazes the belt's speed, or reaches it where |x| = F.
    """
    t, slower, events, sticks = 0.0, v < 1, [], []
    while True:
        end, x, v, sure = slip(law, F, t, x, v, slower)
        if end > HORIZON:
            # nothing more happens, unless the path comes too close to the belt's speed
            return events, sticks, HORIZON if sure else t
        if not sure or abs(abs(x) - F) < 5e-3:
            return events, sticks, t
        t = end
        events.append(t)
        if abs(x) < F:
            sticks.append((t, t + F - x, x))
            t += F - x
            if t > HORIZON:
                return events, sticks, HORIZON
            x, v, slower = F, 1.0, True
            events.append(t)
            if law == "constant":  # from here a circle that comes back to just this point
                return events, sticks, min(HORIZON, t + 6)
        else:
            slower = not slower


def expected(case: Case) -> int:
    return len(story(case.law, case.F, case.x, case.v)[0])


def check(case: Case, backend: str, method: str) -> list[Complaint]:
    done = run(
        belt(case.law, case.directed), HORIZON, backend, method,
        start={"x": case.x, "v": case.v}, mode="slower" if case.v < 1 else "faster", F=case.F,
        rtol=case.rtol, atol=case.rtol / 100, step=5e-3,
    )  # fmt: skip
    exact, sticks, certain = story(case.law, case.F, case.x, case.v)
    tolerance = max(1e-6, 3e3 * case.rtol)
    if method == "Radau":
        tolerance = max(1e-4, 1e4 * case.rtol)
    complaints = finished(done)
    inside = [e.t for e in done.events if e.t <= certain - tolerance]
    exact = [t for t in exact if t <= certain - tolerance]
    complaints += compare(instants(inside, tolerance), exact, tolerance, "stick or slip")
    for begin, end, x in sticks:
        for part in (0.1, 0.5, 0.9):
            t = begin + part * (end - begin)
            if t < min(certain, done.t[-1]):
                at = done.at(t)
                if abs(at["v"] - 1) > tolerance or abs(at["x"] - x - t + begin) > tolerance:
                    text = f"sticks from {begin!r}, but x, v = {at['x']!r}, {at['v']!r} at {t!r}"
                    complaints.append(Complaint(OTHER, text))
                    break
    if case.law == "constant" and sticks and sticks[-1][1] < done.t[-1]:
        # the circle of radius 1 about F for ever, whatever happens where it grazes the belt's speed
        t = np.linspace(sticks[-1][1], done.t[-1], 50)
        at = done.at(t)
        off = np.hypot(at["x"] - case.F, at["v"]) - 1
        if np.max(np.abs(off)) > 10 * tolerance:
            text = f"{np.max(np.abs(off)):.3g} off the circle after sticking"
            complaints.append(Complaint(OTHER, text))
    return complaints
