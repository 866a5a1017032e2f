"""Assignment 1.g on its notebook's model: arcs of sines, places of rest, the shaken pole."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from labkit import ModelError, simulate

from .helpers import load
from .test_characteristics import exact

BOOK = "part2/1g_dead_zone_saturation"
few = settings(max_examples=15, deadline=None)
sizes = st.floats(0.2, 2.0)


def force(x, K=1.0, a=0.4, b=0.5):
    return np.interp(x, [-a - b, -a, a, a + b], [-K, 0, 0, K])


def period_by_arcs(A, K, a, b, spring):
    """Each piece is an arc of a sine about its own centre: (from, to, ω², centre)."""
    w2 = spring + K / b
    arcs = [(0, a, spring, 0.0), (a, a + b, w2, K * a / b / w2), (a + b, 1e9, spring, -K / spring)]
    height, quarter = 0.0, 0.0
    for low, high, w2, c in arcs:  # the energy of the way from 0 to A
        top = min(A, high)
        if top > low:
            height += w2 * ((top - c) ** 2 - (low - c) ** 2) / 2
    for low, high, w2, c in arcs:
        top = min(A, high)
        if top > low:
            R = math.sqrt((low - c) ** 2 + 2 * max(height, 0.0) / w2)
            quarter += (math.asin(min(1, (top - c) / R)) - math.asin((low - c) / R)) / math.sqrt(w2)
            height -= w2 * ((top - c) ** 2 - (low - c) ** 2) / 2
    return 4 * quarter


@few
@given(st.floats(0.05, 6.0), sizes, st.floats(0.1, 0.8), sizes, st.floats(0.3, 3.0))
def test_the_period_of_a_free_swing_is_the_sum_of_its_arcs(A, K, a, b, spring):
    book = load(BOOK)
    p = book["system"].values({"K": K, "a": a, "b": b, "k2": -spring})
    right = period_by_arcs(A, K, a, b, spring)
    assert book["period"](A, p) == pytest.approx(right, rel=1e-7)
    run = simulate(
        book["system"], right, K=K, a=a, b=b, k2=-spring, k3=0.0, start={"x": A}, rtol=1e-11
    )
    assert [run.final["x"], run.final["v"]] == pytest.approx([A, 0.0], abs=1e-7)


def test_a_hundred_seconds_are_exact():
    book = load(BOOK)
    p = book["system"].values()._asdict()
    x, v, kinks = exact(book["zone"], p, 100.0)
    run = simulate(book["system"], 100.0, rtol=1e-10)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert len(run.events) == kinks > 0


@pytest.mark.parametrize("k2", [0.05, 0.5, 1.0])
def test_the_pole_rests_where_force_and_gravity_balance(k2):
    pole = load(BOOK)["pole"]

    def push(x):
        return k2 * x - force(x)

    inner, outer = brentq(push, 0.4, 0.9), brentq(push, 0.9, 30.0)
    assert load(BOOK)["places"](pole.values({"k2": k2})) == pytest.approx(
        [-outer, -inner, 0.0, inner, outer]
    )
    run = simulate(pole, 600.0, k2=k2, delta=0.3, start={"x": inner + 0.05})
    assert run.final["x"] == pytest.approx(inner, abs=1e-5)
    for side in (1, -1):
        run = simulate(pole, 600.0, k2=k2, delta=1.0, start={"x": side * 1e-3})
        assert run.final["x"] == pytest.approx(side * inner, abs=1e-5)


def test_a_pole_that_is_too_heavy_falls():
    book = load(BOOK)
    assert book["places"](book["pole"].values({"k2": 1.2})) == [0.0]
    run = simulate(book["pole"], 100.0, k2=1.2, start={"x": 0.01})
    assert run.final["x"] == pytest.approx(3.0) and "ground" in str(run.stopped)


@pytest.mark.parametrize("x", [0.3, 0.5, 0.7])
def test_the_shaken_pole_is_an_independent_solution_as_far_as_it_can_be_foretold(x):
    def rate(t, y):
        return y[1], 0.5 * y[0] - force(y[0]) + 0.2 * math.sin(t) - 0.15 * y[1]

    right = solve_ivp(
        rate, (0, 30), (x, 0.0), rtol=1e-12, atol=1e-13, method="DOP853", max_step=0.01
    )
    run = simulate(load(BOOK)["shaken"], 30.0, start={"x": x}, rtol=1e-12)
    assert [run.final["x"], run.final["v"]] == pytest.approx(right.y[:, -1], abs=1e-6)


def test_chaos_has_a_positive_exponent_and_the_tamed_pole_a_negative_one():
    """Two neighbours, pulled together again after each period of the force (Benettin)."""

    def exponent(k3, k4=1.0, count=300):
        shaken, T = load(BOOK)["shaken"], 2 * math.pi / k4
        one, total, far = {"x": 0.5, "v": 0.0}, 0.0, 1e-7
        way = np.array([far, 0.0])
        for k in range(count):
            two = {"x": one["x"] + way[0], "v": one["v"] + way[1]}
            ends = [
                simulate(
                    shaken, (k + 1) * T, t0=k * T, start=start, k3=k3, k4=k4, rtol=1e-11, points=2
                ).final
                for start in (one, two)
            ]
            one = {name: ends[0][name] for name in "xv"}
            way = np.array([ends[1][name] - ends[0][name] for name in "xv"])
            total += math.log(np.linalg.norm(way) / far) if k >= 50 else 0.0
            way *= far / np.linalg.norm(way)
        return total / ((count - 50) * T)

    chaos, calm = exponent(0.2), exponent(0.05)
    assert chaos > 0.05 and calm < -0.01
    # a digit of the tolerance gives ln 10/λ seconds more, to the accuracy of eight starts
    slope = load(BOOK)["slope"]
    assert slope == pytest.approx(math.log(10) / chaos, rel=0.4)


def test_the_curve_typed_in_is_the_exact_solution_and_dragged_back_it_is_the_chosen_one():
    book = load(BOOK)
    ends = [
        simulate(book["own"], 40.0, rtol=1e-10, x3=0.4, x4=0.9).final,
        simulate(book["system"], 40.0, rtol=1e-10).final,
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)
    worn = simulate(book["own"], 40.0, rtol=1e-10)
    x, v, _ = exact(
        Through([(-0.9, -1.0), (-0.4, 0.0), (0.7, 0.0), (0.8, 1.0)]),
        book["system"].values()._asdict(),
        40.0,
    )
    assert [worn.final["x"], worn.final["v"]] == pytest.approx([x, v], abs=1e-7)
    with pytest.raises(ModelError, match="must rise, but x2 = 0.8 lies right of x3 = 0.7"):
        simulate(book["own"], 1.0, x2=0.8)


class Through:
    """A curve through points for `exact`, without labkit."""

    def __init__(self, points):
        self.x, self.F = np.transpose(points)

    def edges(self, p, way):
        return self.x

    def __call__(self, x, p, way):
        return float(np.interp(x, self.x, self.F))
