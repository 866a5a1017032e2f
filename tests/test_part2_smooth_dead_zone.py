"""Assignment 1.j on its notebook's model: SciPy, integrals and the exact relay it tends to."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import fsolve

from labkit import characteristic, simulate

from .helpers import load
from .test_characteristics import exact

NAME = "part2/1j_smooth_relay_dead_zone"
few = settings(max_examples=15, deadline=None)


def force(x, alpha, K=1.0, a=0.4):
    """As the handbook prints it."""
    return K / math.pi * (math.atan(alpha * (x + a)) + math.atan(alpha * (x - a)))


def by_scipy(alpha, t_end, start, k2=-1.0, k3=0.5, delta=0.0, method="DOP853"):
    def flow(t, y):
        push = -force(y[0], alpha) + k2 * y[0] + k3 * math.sin(0.7 * t) - delta * y[1]
        return [y[1], push]

    return solve_ivp(flow, (0, t_end), start, method=method, rtol=1e-12, atol=1e-14)


def quarter(alpha, A):
    """Time from rest at A to the middle, by SciPy's events."""

    def middle(t, y):
        return y[0]

    middle.terminal = True

    def flow(t, y):
        return [y[1], -force(y[0], alpha) - y[0]]

    done = solve_ivp(flow, (0, 5), [A, 0.0], method="DOP853", rtol=1e-12, atol=1e-14,
                     events=middle, max_step=0.01)  # fmt: skip
    return done.t_events[0][0]


@pytest.mark.parametrize("t_end", [40.0, 100.0])
def test_the_default_run_is_scipys(t_end):
    system = load(NAME)["system"]
    assert system.start == {"x": 1.0, "v": 0.0} and load(NAME)["horizon"] == 40.0
    p = system.values()
    assert (p.K, p.a, p.alpha, p.k1, p.k2, p.k3, p.k4) == (1, 0.4, 5, -1, -1, 0.5, 0.7)
    run = simulate(system, t_end, rtol=1e-11)
    right = by_scipy(5.0, t_end, [1.0, 0.0]).y[:, -1]
    assert [run.final["x"], run.final["v"]] == pytest.approx(right, abs=1e-7)
    assert run["F"][-1] == pytest.approx(force(run.final["x"], 5.0))


@few
@given(st.floats(0.05, 5.0), st.floats(0.5, 200.0))
def test_the_describing_function_is_the_fourier_integral(A, alpha):
    book = load(NAME)
    p = book["system"].values({"alpha": alpha})

    def wave(angle):
        return force(A * math.sin(angle), alpha) * math.sin(angle)

    edge = [math.asin(0.4 / A)] if A > 0.4 else []
    right = 4 * quad(wave, 0, math.pi / 2, points=edge, limit=400)[0] / (math.pi * A)
    assert book["soft"].describing(A, p) == pytest.approx(right, rel=1e-7)


@few
@given(st.floats(0.5, 1000.0), st.floats(0.1, 1.0))
def test_the_middle_is_a_spring(alpha, a):
    p = load(NAME)["system"].values({"alpha": alpha, "a": a})._asdict()
    h = 1e-4 / alpha
    slope = (force(h, alpha, a=a) - force(-h, alpha, a=a)) / (2 * h)
    assert 2 / math.pi * alpha / (1 + (alpha * a) ** 2) == pytest.approx(slope, rel=1e-5)
    assert load(NAME)["soft"](h, p) == pytest.approx(force(h, alpha, a=a), rel=1e-6)


@pytest.mark.parametrize("A, alpha", [(0.2, 5.0), (0.4, 100.0), (0.43, 100.0), (1.0, 1000.0)])
def test_the_period_is_scipys(A, alpha):
    assert load(NAME)["period"](A, alpha) == pytest.approx(4 * quarter(alpha, A), abs=1e-8)


@few
@given(st.floats(0.05, 5.0))
def test_the_relays_period_is_a_period_of_its_run(A):
    book = load(NAME)
    T = book["period_of_the_relay"](A, book["p"])
    run = simulate(book["jump"], T, k3=0.0, start={"x": A}, rtol=1e-11)
    assert run.final["x"] == pytest.approx(A, abs=1e-7)


@pytest.mark.parametrize("A", [0.2, 0.42, 0.6, 2.0])
def test_the_first_order_is_the_limit_of_the_error(A):
    """By SciPy's quarters at two steepnesses, extrapolated."""
    book = load(NAME)
    T0 = book["period_of_the_relay"](A, book["p"])
    one, two = (alpha * (4 * quarter(alpha, A) - T0) for alpha in (2000.0, 4000.0))
    assert book["first_order"](A, book["p"]) == pytest.approx(2 * two - one, rel=1e-3)


def test_three_swings_have_three_orders():
    book = load(NAME)
    assert list(book["order"].values()) == pytest.approx([1.0, 0.5, 2.0], abs=0.15)
    late = [4 * quarter(alpha, 0.4) - 2 * math.pi for alpha in (1e4, 1e6)]
    assert late[0] / late[1] == pytest.approx(10, rel=0.03)
    assert abs(book["first_order"](book["best"], book["p"])) < 1e-6


def test_it_tends_to_the_exact_relay():
    book = load(NAME)
    hard = characteristic("relay with dead zone")
    x, v, _ = exact(hard, {"K": 1.0, "a": 0.4}, 40.0)
    assert book["right"] == pytest.approx(x, abs=1e-8)
    off = [
        abs(simulate(book["system"], 40.0, alpha=alpha, rtol=1e-11).final["x"] - x)
        for alpha in (1e4, 1e5)
    ]
    assert off[0] / off[1] == pytest.approx(10, rel=0.01) and off[1] < 2e-4


def test_the_satellite_creeps_to_the_middle():
    book = load(NAME)
    for t in (150.0, 600.0):
        right = by_scipy(1e4, t, [0.0, 1.0], 0.0, 0.0, 0.2, "LSODA").y[0, -1]
        assert book["creeping"][10_000.0].at(t)["x"] == pytest.approx(right, abs=1e-5)
    assert abs(book["creeping"][10_000.0].final["x"]) < 1e-8
    assert book["still"].final["x"] < -0.05


def test_two_pairs_of_places_of_rest_appear_where_the_curve_touches_the_line():
    book = load(NAME)

    def touches(q):
        x, alpha = q
        slope = alpha / math.pi * sum(1 / (1 + (alpha * (x + s)) ** 2) for s in (0.4, -0.4))
        return [force(x, alpha) - x, slope - 1]

    _, alpha = fsolve(touches, [0.55, 3.3])
    assert book["solutions"]["pairs"] == pytest.approx(alpha, rel=1e-3)
    assert len(book["rests"](0.98 * alpha)) == 0 and len(book["rests"](1.02 * alpha)) == 2


def test_no_tolerance_goes_below_the_error_of_the_model():
    prices = load(NAME)["prices"]
    for name, alpha in (("α = 10", 10), ("α = 1000", 1e3), ("α = 100000", 1e5)):
        assert prices[name][1].min() > 1 / alpha
    assert prices["relay, told"][1].min() < 1e-9
