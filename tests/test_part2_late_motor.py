"""Assignment 1.h on its notebook's model: closed forms, the gear with play, locking to a force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from labkit import simulate

from .helpers import load
from .test_characteristics import exact

BOOK = "part2/1h_dead_zone_saturation_hysteresis"
few = settings(max_examples=12, deadline=None)
sizes = st.floats(0.3, 2.0)
TIGHT = {"rtol": 1e-11, "atol": 1e-12, "method": "DOP853"}


def f(x, K=1.0, a=0.4, b=0.5):
    return float(np.interp(x, [-a - b, -a, a, a + b], [-K, 0, 0, K]))


def potential(x, K, a, b):
    """∫ f: nothing, a parabola, a line."""
    x = abs(x)
    return K * min(max(x - a, 0), b) ** 2 / (2 * b) + K * max(x - a - b, 0)


@few
@given(sizes, st.floats(0.2, 1.0), sizes, st.floats(0.3, 3.0))
def test_each_turn_of_a_small_free_swing_is_the_same_number_of_times_larger(K, a, b, spring):
    system = load(BOOK)["system"]
    run = simulate(system, 15.0, K=K, a=a, b=b, k2=-spring, k3=0.0, start={"x": 1e-4}, rtol=1e-12)
    turns = np.r_[1e-4, np.abs(run.events["stop"].before["x"])]
    small = turns[turns < min(b, 2 * a)]
    assert len(small) >= 3
    right = math.sqrt(1 + K / (b * spring))
    assert small[1:] / small[:-1] == pytest.approx(right, rel=1e-6)


@few
@given(st.floats(0.3, 4.0), sizes, st.floats(0.2, 0.8), sizes, st.floats(0.3, 1.6))
def test_every_free_turn_is_that_of_the_energy(A, K, a, b, d):
    system = load(BOOK)["system"]
    run = simulate(system, 12.0, K=K, a=a, b=b, d=d, k3=0.0, start={"x": A}, rtol=1e-11)
    turns = np.abs(run.events["stop"].before["x"])[:3]
    for turn in turns:
        height = A**2 / 2 + potential(A + d * a, K, a, b)
        A = brentq(lambda B, h=height: B**2 / 2 + potential(B - d * a, K, a, b) - h, 0, 3 * A + 9)
        assert turn == pytest.approx(A, abs=1e-7)
    assert len(turns) == 3


@few
@given(st.floats(0.5, 6.0), sizes, st.floats(0.2, 0.8), sizes, st.floats(0.3, 1.6))
def test_the_work_of_a_cycle_is_its_area(A, K, a, b, d):
    book = load(BOOK)
    x = np.linspace(-A, A, 200_001)
    up, down = (
        np.interp(x + way * d * a, [-a - b, -a, a, a + b], [-K, 0, 0, K]) for way in (-1, 1)
    )
    area = np.trapezoid(down - up, x) if hasattr(np, "trapezoid") else np.trapz(down - up, x)
    p = book["system"].values({"K": K, "a": a, "b": b, "d": d})
    assert book["fed_by_theory"](A, p) == pytest.approx(area, rel=1e-6, abs=1e-8)


def test_a_hundred_seconds_are_exact():
    book = load(BOOK)
    x, v, kinks = exact(book["late"], book["system"].values()._asdict(), 100.0)
    run = simulate(book["system"], 100.0, rtol=1e-11)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert sum("through" in event.transition for event in run.events) == kinks > 0


def by_branches(x, t_end, k3=0.0, k4=0.7, delta=0.2):
    """(x, v, turns): the formula, one branch after the other, each until x' = 0."""
    t, y, way, turns = 0.0, [x, 0.0], -1, []
    while True:

        def rate(t, y, way=way):
            push = k3 * math.sin(k4 * t) - delta * y[1]
            return y[1], -f(y[0] - way * 0.4) - y[0] + push

        def stop(t, y, way=way, since=t):
            return y[1] if t > since + 1e-3 else way * 1.0

        stop.terminal = True
        done = solve_ivp(rate, (t, t_end), y, events=stop, max_step=0.02, **TIGHT)
        if not done.t_events[0].size:
            return *done.y[:, -1], turns
        t, y, way = done.t_events[0][0], [done.y_events[0][0][0], 0.0], -way
        turns.append((t, y[0]))


def test_the_own_swing_is_that_of_an_independent_integration():
    book = load(BOOK)
    *_, turns = by_branches(1.39, 90.0)
    (one, A), (two, B) = turns[-3], turns[-1]
    assert abs(B) == pytest.approx(abs(A), abs=1e-7)
    assert book["size"] == pytest.approx(abs(B), abs=1e-6)
    assert book["cycle"].period == pytest.approx(two - one, abs=1e-6)


def by_gear(x, t_end, k3, k4=0.7, delta=0.2, c=0.4):
    """The gear with play: the wheel stands until the mass has crossed the play."""
    t, y, r = 0.0, [x, 0.0], max(0.0, x - c) + min(0.0, x + c)
    way = 0
    while True:

        def rate(t, y, way=way, r=r):
            wheel = y[0] - way * c if way else r
            return y[1], -f(wheel) - y[0] + k3 * math.sin(k4 * t) - delta * y[1]

        if way:
            events = [lambda t, y, since=t, way=way: y[1] if t > since + 1e-6 else way]
        else:
            events = [
                lambda t, y, r=r: y[0] - r - c - 1e-13,
                lambda t, y, r=r: y[0] - r + c + 1e-13,
            ]
            events[0].direction, events[1].direction = 1, -1
        for event in events:
            event.terminal = True
        done = solve_ivp(rate, (t, t_end), y, events=events, max_step=0.02, **TIGHT)
        hits = [k for k, at in enumerate(done.t_events) if at.size]
        t, y = done.t[-1], done.y[:, -1]
        if not hits:
            return y
        if way:
            r, way = y[0] - way * c, 0
        else:
            way = (1, -1)[hits[0]]


@pytest.mark.parametrize("x, k3", [(1.0, 0.5), (-1.5, 0.0), (0.3, 0.9)])
def test_the_gear_with_play_is_an_independent_integration(x, k3):
    right = by_gear(x, 30.0, k3)
    run = simulate(load(BOOK)["with_play"], 30.0, k3=k3, delta=0.2, start={"x": x}, rtol=1e-11)
    assert [run.final["x"], run.final["v"]] == pytest.approx(right, abs=1e-6)


def test_the_locked_range_is_that_of_one_harmonic_by_a_fourier_sum():
    """A sine goes in, F is summed over a turn; locked, A and k4 give |H| A = k3."""
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)

    def needed(A, w):
        x, rising = A * np.sin(angle), np.cos(angle) > 0
        F = np.interp(x - np.where(rising, 0.4, -0.4), [-0.9, -0.4, 0.4, 0.9], [-1, 0, 0, 1])
        N = 2 * np.mean(F * (np.sin(angle) + 1j * np.cos(angle))) / A
        return (1 - w**2 + N + 0.2j * w) * A

    book = load(BOOK)
    A, w = fsolve(lambda z: [needed(*z).real, needed(*z).imag], (1.4, 1.3))
    assert book["by_hand"] == pytest.approx([A, w], rel=1e-4)
    assert [book["size"], book["own"]] == pytest.approx([A, w], rel=1e-3)
    rates = np.linspace(1.15, 1.45, 601)
    force = np.abs([needed(A, rates) for A in np.linspace(1.0, 1.8, 161)])
    for k3, width in book["width"].items():
        assert width == pytest.approx(np.ptp(rates[(force <= k3).any(axis=0)]), abs=0.004)


@pytest.mark.parametrize("k4, locked", [(1.27, True), (1.36, True), (1.23, False), (1.41, False)])
def test_a_locked_mass_has_exactly_the_beat_of_the_force(k4, locked):
    book = load(BOOK)
    run = simulate(book["clock"], 900.0, k3=0.2, k4=k4, start={"x": 1.0}, points=3)
    assert (abs(book["rate"](run) - k4) < 1e-6) == locked


@pytest.mark.parametrize("x, rests", [(-0.99, True), (0.0, True), (0.6, True), (1.02, False)])
def test_with_the_other_sign_the_mass_stands_within_the_loop(x, rests):
    """It stands where f(x − c) ≤ x ≤ f(x + c)."""
    assert (f(x - 0.4) <= x <= f(x + 0.4)) == rests
    run = simulate(load(BOOK)["system"], 40.0, k1=1.0, k3=0.0, start={"x": x})
    assert (np.ptp(run["x"]) == 0) == rests
    if rests:
        assert run["F"][-1] == pytest.approx(x)


def test_the_curve_typed_in_becomes_the_chosen_one_where_its_points_are_dragged():
    book = load(BOOK)
    moved = {"xr1": -0.5, "xr2": 0.0, "xl1": -1.3, "xl2": -0.8}
    ends = [
        simulate(book["one_sided"], 40.0, rtol=1e-11, **moved).final,
        simulate(book["system"], 40.0, rtol=1e-11).final,
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)
