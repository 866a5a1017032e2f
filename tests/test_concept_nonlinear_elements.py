"""concepts/nonlinear_elements: its numbers against closed forms and SciPy, from the equations."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

from .helpers import load

NAME = "concepts/nonlinear_elements"


def flow(x, u, t):
    """e' = r, r' = −q − r, q' = u − q from x after t seconds with a constant u."""
    (e, r, q), fade = x, math.exp(-t)
    return np.array(
        [
            e - u * t + (r + u) * (1 - fade) - (q - u) * (1 - (1 + t) * fade),
            -u + (r + u - (q - u) * t) * fade,
            u + (q - u) * fade,
        ]
    )


def half_cycle(a):
    """(half period, state at the switch to +K at e = a): x(h) = −x(0) with u = 1 (Tsypkin)."""

    def miss(z):
        h, r, q = z
        return flow((a, r, q), 1.0, h) + [a, r, q]

    h, r, q = fsolve(miss, (4.0 if a else 3.2, 0.6, -0.4), xtol=1e-13)
    assert np.abs(miss((h, r, q))).max() < 1e-10 and h > 1 and r > 0
    return h, (a, r, q)


def size(h, x):
    """Largest e in the half period after the switch to +K."""
    top = brentq(lambda t: flow(x, 1.0, t)[1], 0.0, h)
    return flow(x, 1.0, top)[0]


def switching(e, level, t_end, a):
    """Instants of the switches of a relay with a dead zone (a = 0: a relay) from rest at e."""
    step = 0.05
    t, x, times = 0.0, np.array([e, 0.0, 0.0]), []
    where = level(e)
    while t < t_end:
        new = flow(x, where, step)
        crossed = [edge for edge in {a, -a} if (x[0] - edge) * (new[0] - edge) < 0]
        if not crossed:
            t, x = t + step, new
            continue
        edge = min(crossed, key=lambda edge: abs(x[0] - edge))

        def beyond(s, x=x, edge=edge, where=where):
            return flow(x, where, s)[0] - edge

        s = brentq(beyond, 0.0, step, xtol=1e-15)
        t, x = t + s, flow(x, where, s)
        where = level(edge + 1e-9 * np.sign(x[1]))
        x[0] = edge + 1e-14 * np.sign(x[1])
        times.append((t, x[1]))
    return times


def relay(e):
    return float(np.sign(e))


def dead(e):
    return float(np.sign(e)) if abs(e) > 0.3 else 0.0


def test_the_self_oscillation_is_the_exact_cycle():
    names = load(NAME)
    h, x = half_cycle(0.0)
    assert names["cycle"].period == pytest.approx(2 * h, rel=1e-9)
    assert names["size"] == pytest.approx(size(h, x), rel=1e-8)
    for amplitude, omega, _ in names["ends"]:
        assert [amplitude, omega] == pytest.approx([size(h, x), math.pi / h], rel=1e-6)
    h, x = half_cycle(0.3)
    assert list(names["hysteresis"][:2]) == pytest.approx([size(h, x), math.pi / h], rel=1e-6)


def test_the_phase_is_that_of_the_start():
    """Amplitude and frequency are not; each phase from a run of this file's own."""
    names = load(NAME)
    period = 2 * half_cycle(0.0)[0]
    for place in (0, 20, 60, 99):
        ups = [t for t, r in switching(names["fan"][place], relay, 120.0, 0.0) if r > 0]
        gap = (names["phases"][place] + ups[-1] / period) % 1
        assert min(gap, 1 - gap) < 1e-5
    assert np.ptp(names["phases"]) > 0.9
    assert names["independent"] == ["amplitude", "frequency"]


def test_the_describing_function_is_the_first_harmonic():
    names = load(NAME)
    theta = np.linspace(0, 2 * np.pi, 200_001)[:-1]
    for kind, small, large, _ in (
        (k, names["answer"](k, 0.6), names["answer"](k, 1.2), 0) for k in names["kinds"]
    ):
        for amplitude, found in ((0.6, small), (1.2, large)):
            x, v = amplitude * np.sin(theta), np.cos(theta)
            u = {
                "relay": np.sign(x),
                "saturation": np.clip(x / 0.3, -1, 1),
                "relay with dead zone": np.sign(x) * (np.abs(x) > 0.3),
                "relay with hysteresis": np.where(v > 0, np.sign(x - 0.3), np.sign(x + 0.3)),
            }[kind]
            assert found == pytest.approx(2 * abs(np.mean(u * np.exp(1j * theta))), rel=1e-4)
    assert names["proportional"] == 0


def test_the_dead_zone_oscillates_from_the_step_on_that_is_said():
    names = load(NAME)
    v = names["first_to_swing"]
    lives = [switching(v + d, dead, 300.0, 0.3)[-1][0] > 280 for d in (-1e-4, 1e-4)]
    assert lives == [False, True]
    assert not switching(0.2, dead, 50.0, 0.3)
    rest = [simulated for simulated in names["rests"] if simulated < 0]
    t, r = switching(0.32, dead, 100.0, 0.3)[-1]
    assert len(rest) == 1 and t < 50


def test_the_pole_stays_up_to_the_step_that_is_said():
    names = load(NAME)

    def falls(v, y=0.0):
        def law(t, s):
            return s[1], s[0] - 0.5 * s[1] + np.clip(2 * (v - s[0]), -1, 1)

        def down(t, s):
            return abs(s[0]) - 1.5

        down.terminal = True
        run = solve_ivp(
            law, (0, 60), (y, 0.0), method="DOP853", rtol=1e-10, atol=1e-12, events=down
        )
        return run.status == 1

    v = names["largest_step"]
    assert [falls(v - 1e-5), falls(v + 1e-5)] == [False, True]
    assert [falls(0.0, 0.999), falls(0.0, 1.001)] == [False, True]


def test_superposition_holds_only_where_the_loop_is_linear():
    names = load(NAME)
    for kind, small, large in names["rows"]:
        assert (small < 1e-6) == (kind == "saturation") and large > 0.1, kind
    linear = np.array([[0, 1, 0], [0, -1, -1], [1.25, 0, -1]])
    for v in (0.2, 0.4):
        run = names["simulate"](names["loops"]["saturation"], 20.0, start={"e": v}, rtol=1e-11)
        assert np.abs(run["e"]).max() < 0.8
        assert run.final["e"] == pytest.approx((expm(linear * 20) @ [v, 0, 0])[0], abs=1e-9)


def test_rest_and_oscillation_both_attract_with_the_same_dead_zone():
    names = load(NAME)
    ends = set(names["basins"]["end"].ravel())
    assert ends == {"nothing", "settles", "oscillates"}
    assert names["balance"] == pytest.approx(
        [  # N = 2 with N = 4/(πA) √(1 − (a/A)²)
            0.3 / math.sqrt((1 + way * math.sqrt(1 - (math.pi * 0.3) ** 2)) / 2) for way in (1, -1)
        ],
        abs=4e-3,
    )
