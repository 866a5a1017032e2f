"""Assignments 1.b, 1.c and 1.d on their notebooks' models: closed forms, and relays with memory."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from labkit import ModelError, simulate

from .helpers import load

LATE = "part2/1b_relay_hysteresis"
ZONE = "part2/1c_relay_dead_zone"
CLOCK = "part2/1d_relay_dead_zone_hysteresis"
TIGHT = {"k3": 0.0, "rtol": 1e-11}
few = settings(max_examples=15, deadline=None)
sizes = st.floats(0.3, 2.0)


def with_memory(edges, p, x, t_end):
    """(x, v, switches) of a relay with memory from rest at x, from the closed form of each piece.

    edges: output -> [(place, way, next output)].
    """
    k1, k4, k3 = p["k1"], p["k4"], p["k3"]
    t, v, F, switches = 0.0, 0.0, p["F"], 0
    bounce = k3 / (1 - k4**2)  # k2 = -1

    while True:

        def place(tau, t=t, x=x, v=v, F=F):
            c = x - k1 * F - bounce * math.sin(k4 * t)
            d = v - bounce * k4 * math.cos(k4 * t)
            return (
                k1 * F + bounce * math.sin(k4 * (t + tau)) + c * math.cos(tau) + d * math.sin(tau)
            )

        def speed(tau, t=t, x=x, v=v, F=F):
            c = x - k1 * F - bounce * math.sin(k4 * t)
            d = v - bounce * k4 * math.cos(k4 * t)
            return bounce * k4 * math.cos(k4 * (t + tau)) - c * math.sin(tau) + d * math.cos(tau)

        first = None
        for tau in np.arange(1e-6, t_end - t, 0.002):
            for edge, way, after in edges[F]:
                if way * (place(tau) - edge) < 0 <= way * (place(tau + 0.002) - edge):
                    root = brentq(lambda q, e=edge: place(q) - e, tau, tau + 0.002, xtol=1e-14)
                    first = min(first or (math.inf,), (root, edge, after))
            if first:
                break
        if first is None or t + first[0] > t_end:
            return place(t_end - t), speed(t_end - t), switches
        x, v, t, F, switches = first[1], speed(first[0]), t + first[0], first[2], switches + 1


@pytest.mark.parametrize("k1, k3", [(-1.0, 0.5), (1.0, 0.5), (1.0, 1.3)])
def test_a_late_relay_with_memory_is_the_exact_solution(k1, k3):
    book = load(LATE)
    edges = {1.0: [(-0.4, -1, -1.0)], -1.0: [(0.4, 1, 1.0)]}
    x, v, switches = with_memory(edges, {"k1": k1, "k3": k3, "k4": 0.7, "F": 1.0}, 1.0, 40.0)
    run = simulate(book["with_memory"], 40.0, k1=k1, k3=k3, rtol=1e-11)
    assert len(run.events) == switches > 0
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)


@pytest.mark.parametrize("k1, k3, x", [(-1.0, 0.5, 1.0), (-1.0, 0.5, 0.3), (1.0, 0.9, 0.3)])
def test_a_clock_with_memory_is_the_exact_solution(k1, k3, x):
    book = load(CLOCK)
    edges = {
        1.0: [(0.2, -1, 0.0)],
        0.0: [(0.4, 1, 1.0), (-0.4, -1, -1.0)],
        -1.0: [(-0.2, 1, 0.0)],
    }
    p = {"k1": k1, "k3": k3, "k4": 0.7, "F": float(x > 0.4)}
    right, v, switches = with_memory(edges, p, x, 40.0)
    run = simulate(book["with_memory"], 40.0, k1=k1, k3=k3, start={"x": x}, rtol=1e-11)
    assert len(run.events) == switches > 0
    assert [run.final["x"], run.final["v"]] == pytest.approx([right, v], abs=1e-7)


@few
@given(sizes, sizes, st.floats(0.1, 0.8), st.floats(0.3, 3.0))
def test_the_late_relay_turns_where_theory_says(A, K, a, spring):
    book = load(LATE)
    system = book["system"]
    p = system.values({"K": K, "a": a, "k2": -spring})
    if a >= A or K / spring <= a:  # else it may turn inside the loop
        return
    t, sizes = book["turns_by_theory"](A, 6, p)
    run = simulate(system, t[-1] + 0.1, K=K, a=a, k2=-spring, start={"x": A}, **TIGHT)
    turns = run.events["stop"]
    assert turns.t == pytest.approx(t, abs=1e-7)
    assert np.abs(turns.before["x"]) == pytest.approx(sizes, abs=1e-7)


@few
@given(st.floats(0.05, 4.0))
def test_with_the_other_sign_the_formula_stands_and_the_relay_with_memory_swings(x):
    """Let go right of the middle, to the side of which relay and spring balance at 1 m."""
    book = load(LATE)
    ring, side = abs(x - 1.0) if x > 0.4 else 0.0, 1
    while ring > 1.4:  # it passes the whole loop, to the other side
        ring, side = math.sqrt(ring**2 - 1.6), -side
    for name in ("system", "with_memory"):
        run = simulate(book[name], 80.0, k1=1.0, start={"x": x}, **TIGHT)
        late = run["x"][run.t > 50.0]
        if min(abs(ring - 0.6), abs(ring - 1.4), abs(x - 0.4)) < 1e-3 or (ring == 0 and x < 0.4):
            continue
        if name == "system" and 0.6 < ring < 1.4:
            assert run.mode[-1] == "at rest"
            assert run.final["x"] == pytest.approx(side * (1 - ring), abs=1e-7)
        else:
            assert np.ptp(late) == pytest.approx(2 * ring, rel=1e-2, abs=1e-9)


def test_inside_the_loop_every_place_is_one_of_rest():
    for x in (-0.3, 0.1, 0.39):
        run = simulate(load(LATE)["system"], 20.0, k1=1.0, start={"x": x}, **TIGHT)
        assert run.mode[-1] == "at rest" and np.ptp(run["x"]) == 0
        assert run["F"][-1] == pytest.approx(x)


@few
@given(st.floats(0.05, 5.0), sizes, st.floats(0.1, 0.8))
def test_the_period_of_a_swing_through_the_dead_zone(A, K, a):
    book = load(ZONE)
    system = book["system"]
    right = book["period"](A, system.values({"K": K, "a": a}))
    run = simulate(system, 2.2 * right, K=K, a=a, start={"x": 0.0, "v": 0.0} | {"x": A}, **TIGHT)
    assert run.at(right)["x"] == pytest.approx(A, abs=1e-7)
    assert run.at(right / 4)["x"] == pytest.approx(0.0, abs=1e-7)


@few
@given(st.floats(0.05, 3.0), st.floats(0.1, 0.5))
def test_the_satellite_rests_where_its_last_speed_takes_it(v, delta):
    run = simulate(load(ZONE)["satellite"], 300.0, delta=delta, start={"x": 0.0, "v": v})
    last = run.events[-1].before if len(run.events) else {"x": 0.0, "v": v}
    assert abs(last["v"]) <= 2 * 0.4 * delta + 1e-6
    assert run.final["x"] == pytest.approx(last["x"] + last["v"] / delta, abs=1e-5)


def test_three_steady_swings_have_a_theory():
    book = load(ZONE)
    assert len(book["roots"]) == 4
    one = book["steady"](book["swings"]["large"])
    assert one == pytest.approx(book["roots"][-1], rel=0.02)
    turn = 2 * math.pi / 1.3
    t = 300.0 + np.linspace(0, turn, 50)
    for swing in book["swings"].values():  # each repeats with the force, and is its own mirror
        x = swing.at(t)["x"]
        assert swing.at(t + turn)["x"] == pytest.approx(x, abs=2e-3)
        assert swing.at(t + turn / 2)["x"] == pytest.approx(-x, abs=2e-3)


def test_two_hundred_starts_lead_to_three_swings():
    """The state after a whole number of periods: three points, whatever the start."""
    system, turn, seen = load(ZONE)["shaken"], 2 * math.pi / 1.3, set()
    for x in np.linspace(-4, 4, 15):
        for v in np.linspace(-4, 4, 15):
            run = simulate(system, 90 * turn, start={"x": x, "v": v}, points=2)
            seen.add((round(run.final["x"], 1), round(run.final["v"], 1)))
    assert len(seen) == 3


@few
@given(st.floats(0.02, 1.5), sizes, st.floats(0.1, 0.8), st.floats(0.05, 0.95))
def test_the_clock_without_friction_turns_where_theory_says(A, K, a, b):
    book = load(CLOCK)
    system = book["system"]
    p, right = system.values({"K": K, "a": a, "b": b}), [A]
    if abs(A - b * a) < 1e-3 or abs(A - a) < 1e-3:
        return
    for _ in range(5):
        right.append(book["next_turn"](right[-1], p))
    run = simulate(system, 20.0, K=K, a=a, b=b, start={"x": A}, **TIGHT)
    assert np.abs(run.events["stop"].before["x"])[:5] == pytest.approx(right[1:], abs=1e-7)


@few
@given(st.floats(0.01, 0.39))
def test_with_memory_all_swings_below_a_are_neutral(x):
    run = simulate(load(CLOCK)["with_memory"], 60.0, start={"x": x}, **TIGHT)
    assert not run.events and run.at(20 * math.pi / 2)["x"] == pytest.approx(x, abs=1e-8)


@pytest.mark.parametrize("b", [1.0, 1.5, -0.1])
def test_a_clock_that_switches_off_before_it_switches_on_is_refused(b):
    with pytest.raises(ModelError, match=r"'b' = .* is outside its range \[0, 0.99\]"):
        simulate(load(CLOCK)["system"], 1.0, b=b)
