"""Assignment 1.i on its notebook's model: scipy at its tightest, and mpmath's integrals."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from labkit import simulate

from .helpers import load
from .test_characteristics import exact

NAME = "part2/1i_smooth_relay"
few = settings(max_examples=10, deadline=None)


@pytest.fixture(scope="module")
def book():
    return load(NAME)


@pytest.fixture(scope="module")
def the_relay(book):
    """(x, v, switches) of the relay at 40 s."""
    return exact(book["hard"], book["system"].values()._asdict(), 40.0)


def tight(p, t_end, x=1.0):
    """(x, v) from rest at x, by scipy, from the equation as the handbook prints it."""

    def f(t, y):
        F = 2 * p["K"] / math.pi * math.atan(p["alpha"] * y[0])
        outer = p["k3"] * math.sin(p["k4"] * t)
        return y[1], p["k1"] * F + p["k2"] * y[0] + outer - p["delta"] * y[1]

    return solve_ivp(f, (0, t_end), (x, 0.0), "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def test_the_handbooks_values(book):
    p, system = book["system"].values()._asdict(), book["system"]
    assert book["horizon"] == 40.0 and system.start == {"x": 1.0, "v": 0.0}
    assert p == {
        "K": 1.0,
        "alpha": 5.0,
        "k1": -1.0,
        "k2": -1.0,
        "k3": 0.5,
        "k4": 0.7,
        "delta": 0.0,
    }


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"alpha": 100.0},
        {"alpha": 2000.0},
        {"k1": 1.0, "k3": 0.9},
        {"k3": 0.0, "k2": -0.3},
        {"delta": 1.0, "alpha": 50.0},
    ],
    ids=str,
)
def test_the_run_is_that_of_scipy(book, changes):
    p = book["system"].values(changes)._asdict()
    run = simulate(book["system"], 40.0, rtol=1e-10, **changes)
    assert not run.events
    assert [run.final["x"], run.final["v"]] == pytest.approx(tight(p, 40.0), abs=1e-7)


def test_a_hundred_seconds_of_the_default_run(book):
    x, v = tight(book["system"].values()._asdict(), 100.0)
    run = simulate(book["system"], 100.0, rtol=1e-10)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)


def test_taylor_series_of_mpmath_agree(book):
    """Through the corner once, with twenty digits."""
    with mpmath.workdps(20):
        solution = mpmath.odefun(
            lambda t, y: [
                y[1],
                -2 / mpmath.pi * mpmath.atan(5 * y[0]) - y[0] + mpmath.sin(0.7 * t) / 2,
            ],
            0,
            [mpmath.mpf(1), mpmath.mpf(0)],
            tol=mpmath.mpf(10) ** -14,
        )
        x, v = (float(value) for value in solution(1.6))
    run = simulate(book["system"], 1.6, rtol=1e-13)
    assert x < -0.1 and [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-12)


def test_the_relay_beside_it_is_exact(book, the_relay):
    x, v, switches = the_relay
    run = book["relay_run"]
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-8)
    assert sum("through" in event.transition for event in run.events) == switches
    assert book["right"] == pytest.approx(x, abs=1e-8)


@few
@given(st.floats(0.05, 20), st.floats(1, 200))
def test_the_first_harmonic_in_closed_form(A, alpha):
    book = load(NAME)
    p = book["p"]._replace(alpha=alpha)
    with mpmath.workdps(20):
        wave = mpmath.quad(
            lambda a: mpmath.atan(alpha * A * mpmath.sin(a)) * mpmath.sin(a),
            [0, 1 / (1 + alpha * A), mpmath.pi / 2],
        )
    right = 4 * 2 / math.pi / (math.pi * A) * float(wave)
    assert book["N"](A, p) == pytest.approx(right, rel=1e-9)


@few
@given(st.floats(0.05, 5), st.floats(0.5, 50))
def test_the_free_swing_takes_four_quarters(A, alpha):
    """The notebook's integral and its run, against the quarter that scipy finds."""
    book = load(NAME)
    p = book["p"]._replace(alpha=alpha)

    def f(t, y):
        return y[1], -2 / math.pi * math.atan(alpha * y[0]) - y[0]

    def middle(t, y):
        return y[0]

    middle.terminal = True
    found = solve_ivp(f, (0, 9), (A, 0.0), "DOP853", events=middle, rtol=1e-13, atol=1e-15)
    time = 4 * found.t[-1]
    assert book["period"](A, p) == pytest.approx(time, rel=1e-8)
    run = simulate(book["system"], time, k3=0.0, alpha=alpha, start={"x": A}, rtol=1e-12)
    assert run.final["x"] == pytest.approx(A, rel=1e-7)


def test_the_distance_from_the_relay_to_first_order(book):
    """c of T − T₀ ≈ c/α, with x = 1 − u², and by two steep relays."""
    c = 16 / math.pi * quad(lambda u: -math.log1p(-u * u) / (u * u * (4 - u * u) ** 1.5), 0, 1)[0]
    assert book["c"] == pytest.approx(c, rel=1e-6)
    late = [
        alpha * (book["period"](1.0, book["p"]._replace(alpha=alpha)) - 4 * math.pi / 3)
        for alpha in (1000.0, 4000.0)
    ]
    assert 4 * math.pi / 3 == pytest.approx(book["period_of_the_relay"](1.0, book["p"]))
    assert abs(late[1] - book["c"]) < abs(late[0] - book["c"]) < 0.02 * book["c"]


def test_arctangent_and_tanh_go_to_the_relay_with_order_one_and_two(book, the_relay):
    x = the_relay[0]
    for model, order in ((book["system"], 1), (book["tanh"], 2)):
        gaps = [
            abs(simulate(model, 40.0, alpha=alpha, rtol=1e-12).final["x"] - x)
            for alpha in (250.0, 1000.0)
        ]
        assert np.log(gaps[0] / gaps[1]) / np.log(4) == pytest.approx(order, abs=0.1)


@few
@given(st.floats(0.05, 0.95), st.floats(5, 1000))
def test_it_gives_way_to_every_force(force, alpha):
    """Where device and spring hold a constant force: a root of the printed law."""
    x = load(NAME)["balance"](force, alpha)
    assert 2 / math.pi * math.atan(alpha * x) + x == pytest.approx(force, abs=1e-9) and x > 0


def test_the_relay_of_1a_gives_way_to_none_below_K(book):
    for force, moves in ((0.5, False), (0.99, False), (1.01, True)):
        run = simulate(book["jump"], 40.0, k3=force, start={"x": 0.0})
        assert bool(np.any(run["x"])) is moves
