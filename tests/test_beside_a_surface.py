"""Where the error of the integration leaves a state beside the surface on which it is: the ends of
sliding, and modes that would send each other back at once. By exact answers.
"""

import math
import random

import numpy as np
import pytest
from scipy.optimize import brentq

from labkit import At, Mode, System, Transition, simulate

WAYS = [
    *((m, b, r) for m in ("RK45", "DOP853") for b in ("plain", "compiled") for r in (1e-4, 1e-8)),
    ("RK4", "plain", 1e-8),
    *(("Radau", "plain", r) for r in (1e-4, 1e-6)),
    ("LSODA", "plain", 1e-8),
    ("BDF", "plain", 1e-10),
]
ways = pytest.mark.parametrize(("method", "backend", "rtol"), WAYS)


def ledger(run):
    assert run.stopped == "finished"
    return [e.transition for e in run.events], np.array([e.t for e in run.events])


# ---------------------------------------------------------------- a heater that follows a wave


def heater(direction: int) -> System:
    """T follows a set point 20 + A·sin 0.3t; where that falls faster than the room cools, it
    leaves.
    """

    def above(t, s, p):
        return s.T - 20 - p.A * math.sin(0.3 * t)

    return System(
        "following heater",
        {"T": "K"},
        {"A": 1.5},
        [
            Mode("on", lambda t, s, p: (-0.02 * (s.T - 5) + 1.1,)),
            Mode("off", lambda t, s, p: (-0.02 * (s.T - 5),)),
        ],
        [
            Transition("on", "off", guard=above, direction=direction, label="off"),
            Transition("off", "on", guard=above, direction=-direction, label="on"),
        ],
        start={"T": 19.0},
    )


def follows(A: float) -> list[float]:
    """When it comes to the set point, leaves it, and comes again."""

    def wave(t):
        return 20 + A * math.sin(0.3 * t)

    def push(t):
        return -0.02 * (wave(t) - 5) - 0.3 * A * math.cos(0.3 * t)

    first = brentq(lambda t: 60 - 41 * math.exp(-0.02 * t) - wave(t), 0, 5, xtol=1e-14)
    leaves = brentq(push, math.pi / 0.6, math.pi / 0.3, xtol=1e-14)
    cold = wave(leaves) - 5
    again = brentq(
        lambda t: 5 + cold * math.exp(-0.02 * (t - leaves)) - wave(t),
        leaves + 1, leaves + 13, xtol=1e-14,
    )  # fmt: skip
    return [first, leaves, again]


@ways
@pytest.mark.parametrize("direction", [1, 0])
def test_sliding_ends_where_the_push_ends_and_not_beside_it(method, backend, rtol, direction):
    """Located 8e-5 s early, a guard without direction took the dip to come for a crossing, and
    heated for ever.
    """
    for A in (1.2, 1.5, 1.8, 2.1):
        first, leaves, again = follows(A)
        for t_end in (again - 2, again + 1, 0.5 * (leaves + again)):
            run = simulate(
                heater(direction), t_end, A=A, method=method, rtol=rtol, backend=backend, step=0.02
            )
            names, times = ledger(run)
            right = (
                [first, first, leaves, again, again] if t_end > again else [first, first, leaves]
            )
            assert len(names) == len(right), (A, t_end, names, times)
            assert np.abs(times - right).max() < max(3e3 * rtol, 1e-6), (A, times - right)
            assert run.mode[-1] == ("off" if t_end < again else run.mode[-1])


# ---------------------------------------------------------------- back at once


def rectifier() -> System:
    """v follows the source 12.3·sin ωt while the diode conducts, and falls by itself until the
    source is above it. v is integrated: it is the source but for the method's error.
    """
    return System(
        "half-wave rectifier",
        {"v": "V"},
        {"V": 12.3, "w": 100 * math.pi, "R": 1e3, "C": 22e-6},
        [
            Mode("on", lambda t, s, p: (p.V * p.w * math.cos(p.w * t),)),
            Mode("off", lambda t, s, p: (-s.v / (p.R * p.C),)),
        ],
        [
            Transition(
                "on", "off", label="off", direction=-1,
                guard=lambda t, s, p: p.C * p.V * p.w * math.cos(p.w * t) + s.v / p.R,
            ),
            Transition(
                "off", "on", label="on", direction=1,
                guard=lambda t, s, p: p.V * math.sin(p.w * t) - s.v,
            ),
        ],
        start={"v": 0.0},
    )  # fmt: skip


@ways
def test_a_diode_opens_once_and_closes_once(method, backend, rtol):
    """Two modes without a jump between them: an error of 1e-9 V sent each back to the other."""
    V, w, RC, period = 12.3, 100 * math.pi, 0.022, 0.02
    opens = (math.pi - math.atan(w * RC)) / w
    level = V * math.sin(w * opens)
    closes = brentq(
        lambda t: V * math.sin(w * t) - level * math.exp(-(t - opens) / RC), 0.02, 0.025, xtol=1e-16
    )
    right = [t + k * period for k in range(5) for t in (opens, closes)][:9]
    run = simulate(rectifier(), 0.1, method=method, rtol=rtol, backend=backend, step=5e-5)
    names, times = ledger(run)
    assert names == ["off", "on"] * 4 + ["off"]
    assert np.abs(times - right).max() < max(30 * rtol, 1e-9) * period


def rider() -> System:
    """A body on a shaken table: it lifts off where the table falls faster than it would."""
    return System(
        "body on a shaken table",
        {"y": "m", "v": "m/s"},
        {"A": 0.03, "w": 25.0},
        [
            Mode(
                "on",
                lambda t, s, p: (p.A * p.w * math.cos(p.w * t), -p.A * p.w**2 * math.sin(p.w * t)),
            ),
            Mode("off", lambda t, s, p: (s.v, -9.81)),
        ],
        [
            Transition(
                "on", "off", label="lift", direction=1,
                guard=lambda t, s, p: p.A * p.w**2 * math.sin(p.w * t) - 9.81,
            ),
            Transition(
                "off", "on", label="land", direction=-1,
                guard=lambda t, s, p: s.y - p.A * math.sin(p.w * t),
                reset=lambda t, s, p: (p.A * math.sin(p.w * t), p.A * p.w * math.cos(p.w * t)),
            ),
        ],
        start={"y": 0.0, "v": 0.75},
    )  # fmt: skip


@ways
def test_a_body_lifts_off_once_by_its_third_derivative(method, backend, rtol):
    A, w, g = 0.03, 25.0, 9.81
    lift = math.asin(g / (A * w * w)) / w
    y, v = A * math.sin(w * lift), A * w * math.cos(w * lift)
    land = brentq(
        lambda t: y + v * (t - lift) - g / 2 * (t - lift) ** 2 - A * math.sin(w * t),
        lift + 0.05, lift + 0.24, xtol=1e-15,
    )  # fmt: skip
    right = [t + k * 2 * math.pi / w for k in range(4) for t in (lift, land)]
    run = simulate(rider(), 1.0, method=method, rtol=rtol, backend=backend, step=5e-4)
    names, times = ledger(run)
    assert names == ["lift", "land"] * 4
    assert np.abs(times - right).max() < max(30 * rtol, 1e-8)


# ---------------------------------------------------------------- along a surface, and slowly

FALLS = [("RK4", 1e-8), ("RK45", 1e-8), ("DOP853", 1e-12)]
falls = pytest.mark.parametrize(("method", "rtol"), FALLS)
both = pytest.mark.parametrize("backend", ["plain", "compiled"])


@both
@falls
@pytest.mark.parametrize("unit", [1.0, 1 / 3, 0.1])
@pytest.mark.parametrize("urgent", [None, True])
def test_balls_that_fall_together_stay_together(method, rtol, backend, unit, urgent):
    """The distance that they keep is on a surface for ever, though both go far along it."""
    fall = lambda t, s, p: (s.v, -2.0, s.w, -2.0 * p.b)  # noqa: E731
    system = System(
        "two balls", {"x": "", "v": "", "y": "", "w": ""}, {"b": unit},
        [Mode("A", fall), Mode("B", fall)],
        [
            Transition("A", "B", at=At(1.0)),
            Transition(
                "B", "B", guard=lambda t, s, p: s.x - s.y / p.b + 1, direction=1, urgent=urgent
            ),
        ],
        {"x": 1.5, "v": -2.1, "y": 2.5 * unit, "w": -2.1 * unit},
    )  # fmt: skip
    run = simulate(system, 4.0, method=method, rtol=rtol, step=1 / 16, backend=backend)
    assert [e.index for e in run.events] == [0]


@both
@falls
@pytest.mark.parametrize("counts", [False, True])
def test_what_has_no_reset_takes_no_speed(method, rtol, backend, counts):
    """On entering B its guard is zero and leaves by the second order: an event, and no rest."""
    system = System(
        "push", {"x": "", "v": ""}, {},
        [Mode("A", lambda t, s, p: (s.v, 0.0)), Mode("B", lambda t, s, p: (s.v, 1.0))],
        [
            Transition("A", "B", at=At(1.0)),
            Transition(
                "B", "B", guard=lambda t, s, p: s.x, direction=1,
                reset={"k": lambda t, s, p: s.k + 1} if counts else None,
            ),
        ],
        {"x": 0.0, "v": 0.0}, held={"k": ("", 0.0)},
    )  # fmt: skip
    run = simulate(system, 3.0, method=method, rtol=rtol, step=1 / 16, backend=backend)
    assert [(e.index, e.t) for e in run.events] == [(0, 1.0), (1, 1.0)]
    assert run.final["x"] == pytest.approx(2.0, abs=1e-12)
    assert run.final["k"] == counts


@both
@falls
@pytest.mark.parametrize("t0", [0.0, 1e3, 1e5 / 3])
def test_a_ball_at_its_apex_has_not_come_fast(method, rtol, backend, t0):
    """The guard crosses there with slope c, and back c/1.5 s later, when it has risen by c²/6."""
    for c in (1e-3, 1e-4, 1e-5):
        system = System(
            "apex", {"x": "", "v": ""}, {"c": c, "d": 1.5 + c + c * t0},
            [Mode("A", lambda t, s, p: (s.v, -2.0))],
            [Transition("A", "A", guard=lambda t, s, p: 1.5 * s.x + p.c * t - p.d, urgent=False)],
            {"x": 0.0, "v": 2.0},
        )  # fmt: skip
        run = simulate(
            system, t0 + 4, t0=t0, method=method, rtol=rtol, step=1 / 16, backend=backend
        )
        assert len(run.events) == 2, (c, [e.t - t0 for e in run.events])
        assert run.events[1].t - t0 == pytest.approx(1 + c / 1.5, abs=1e-7)


@both
@falls
@pytest.mark.parametrize("unit", [1.0, 9.81, 0.3, 1e-3])
def test_what_goes_on_faster_the_same_way_does_not_rest(method, rtol, backend, unit):
    """A guard falls by 6.7e-6 a second when the reset comes, and by 1.4 after it."""
    system = System(
        "slow, then fast", {"x": "", "v": "", "y": "", "w": ""}, {"u": unit},
        [Mode("A", lambda t, s, p: (s.v, -0.5 * p.u, s.w, p.u))],
        [
            Transition(
                "A", "A", direction=-1, urgent=False, reset={"v": lambda t, s, p: -s.v},
                guard=lambda t, s, p: (
                    (-s.x / 3 - s.y / 2 + s.w / 3) / p.u + 1.00001 / 3 * t - 0.677090833333333333
                ),
            )
        ],
        {"x": unit, "v": -unit, "y": 0.0, "w": 0.5 * unit},
    )  # fmt: skip
    run = simulate(system, 4.0, method=method, rtol=rtol, step=1 / 16, backend=backend)
    assert run.stopped == "finished"
    assert [e.t for e in run.events] == pytest.approx([2.25002], abs=1e-7)


@falls
@pytest.mark.parametrize("slope", [1e-1, 1e-2, 1e-3, 1e-4])
def test_a_slow_curved_guard_meets_a_clock(method, rtol, slope):
    """Both are due at T, and the clock goes first; the guard is zero there to its rounding only."""
    dice, tried = random.Random(f"{method} {slope}"), 0
    for _ in range(40):
        a, v, x = (round(dice.uniform(-3, 3), 2) for _ in range(3))
        T, b = round(dice.uniform(0.5, 3), 2), dice.choice((-1, 1)) * round(dice.uniform(0.1, 1), 2)
        c = slope - a - b * (v + a * T)
        if 0 < 2 * slope < b * a * T:  # it is zero before T, too
            continue
        tried += 1
        d = v + a * T + b * (x + v * T + a * T * T / 2) + c * T
        fall = lambda t, s, p: (s.v, p.a)  # noqa: E731
        system = System(
            "slow", {"x": "", "v": ""}, {"a": a, "b": b, "c": c, "d": d, "T": T},
            [Mode("A", fall), Mode("B", fall)],
            [
                Transition("A", "B", guard=lambda t, s, p: s.v + p.b * s.x + p.c * t - p.d),
                Transition("A", "A", at=At("T"), priority=1),
            ],
            {"x": x, "v": v},
        )  # fmt: skip
        run = simulate(system, T, method=method, rtol=rtol, step=1 / 16, backend="plain")
        assert [e.index for e in run.events if abs(e.t - T) < 1e-7] == [1, 0], (a, b, T, x, v)
    assert tried > 4


@pytest.mark.parametrize("units", [("", ""), ("m", "m/s")])
@pytest.mark.parametrize("method", ["BDF", "LSODA", "Radau", "RK45"])
def test_no_unit_matters_with_names_of_units_or_without(method, units):
    """A ball of 1 m, 1 mm, 1 µm and 1 nm on clocks of its own: the same relative error."""
    found = []
    for length, time in ((1.0, 1.0), (1e-3, 1e-3), (1e-6, 1e-6), (1e-9, 1e-6)):
        system = System(
            "ball", dict(zip("yv", units, strict=True)), {"g": 9.81 * length / time**2},
            [Mode("flight", lambda t, s, p: (s.v, -p.g))],
            [
                Transition(
                    "flight", "flight", guard=lambda t, s, p: s.y, direction=-1,
                    reset=lambda t, s, p: (0.0, -0.9 * s.v),
                )
            ],
            {"y": 0.7 * length, "v": 0.0},
        )  # fmt: skip
        run = simulate(system, 3 * time, method=method, rtol=1e-5, backend="plain")
        found.append([e.t / time for e in run.events])
    first = math.sqrt(2 * 0.7 / 9.81)
    right = [first * (1 + 2 * sum(0.9**k for k in range(1, n))) for n in range(1, 6)]
    for times in found:
        assert times[:5] == pytest.approx(right, rel=1e-3)
        assert times == pytest.approx(found[0], rel=1e-5)


# ---------------------------------------------------------------- many steps of fixed length


@pytest.mark.parametrize("method", ["Euler", "Heun", "RK4"])
@pytest.mark.parametrize("steps", [100, 1_400, 100_000])
def test_the_rounding_of_many_steps_does_not_part_what_coincides(method, steps):
    """One tank is full at t = 7 as the other runs dry; 1,400 roundings had parted them, and what
    came second stood 1e-14 before its limit for ever.
    """
    system = System(
        "two tanks",
        {"a": "m", "b": "m"},
        {},
        [
            Mode("normal", lambda t, s, p: (-0.3, 0.1)),
            Mode("full", lambda t, s, p: (-0.3, 0.0)),
            Mode("dry", lambda t, s, p: (0.0, 0.1)),
            Mode("both", lambda t, s, p: (0.0, 0.0)),
        ],
        [
            Transition("normal", "full", guard=lambda t, s, p: s.b - 0.8, direction=1),
            Transition("normal", "dry", guard=lambda t, s, p: s.a, direction=-1),
            Transition("full", "both", guard=lambda t, s, p: s.a, direction=-1),
            Transition("dry", "both", guard=lambda t, s, p: s.b - 0.8, direction=1),
        ],
        start={"a": 2.1, "b": 0.1},
    )
    run = simulate(system, 10.0, method=method, step=7.0 / steps * 1.0001)
    assert [e.target for e in run.events] == ["full", "both"]
    assert run.events[0].t == run.events[1].t == pytest.approx(7, abs=1e-14)


# ---------------------------------------------------------------- the edge of a flow's domain

TANKS = {  # (flow, when a tank of height h is empty)
    "root": (lambda t, s, p: (-p.k * math.sqrt(s.h),), lambda h, k: 2 * math.sqrt(h) / k),
    "power": (lambda t, s, p: (-p.k * s.h**0.3,), lambda h, k: h**0.7 / 0.7 / k),
}


def tank(flow, edge: float = 0.0) -> System:
    return System(
        "tank that runs dry",
        {"h": "m"},
        {"k": 0.3, "edge": edge},
        [Mode("full", flow), Mode("empty", lambda t, s, p: (0.0,))],
        [
            Transition(
                "full", "empty", guard=lambda t, s, p: s.h, direction=-1, reset={"h": 0.0},
                label="dry",
            )
        ],
        start={"h": 1.7},
    )  # fmt: skip


@ways
@pytest.mark.parametrize("name", TANKS)
def test_a_tank_runs_dry_where_its_root_ends(method, backend, rtol, name):
    """The flow is no number below the surface: every step that reaches it fails."""
    if method == "RK4":
        pytest.skip("a step of fixed length cannot end at the surface: it says 'not a number'")
    flow, empty = TANKS[name]
    for h, k in ((1.7, 0.3), (1.0, 1.0), (0.3, 0.3)):
        run = simulate(
            tank(flow), 40.0, start={"h": h}, k=k, method=method, rtol=rtol, backend=backend
        )
        names, times = ledger(run)
        assert names == ["dry"]
        assert run.final == {"h": 0.0}
        right = empty(h, k)
        assert abs(times[0] / right - 1) < max(3 * rtol**0.5, 1e-3 * rtol), (h, k, times[0] - right)


@pytest.mark.parametrize("method", ["RK45", "DOP853", "Radau", "LSODA", "BDF", "RK4"])
def test_an_edge_that_is_no_surface_is_said(method):
    flow = lambda t, s, p: (-p.k * math.sqrt(s.h - p.edge),)  # noqa: E731
    run = simulate(tank(flow, edge=0.2), 40.0, method=method, backend="plain", max_steps=5000)
    assert run.stopped.startswith(("not a number", "too many steps"))
    assert not run.events
