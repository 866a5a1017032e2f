"""Assignment 2.e on its notebook's model: integrals and exact pieces beside it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from labkit import ModelError, simulate

from .helpers import load
from .test_characteristics import exact

NAME = "part2/2e_two_slopes"
few = settings(max_examples=15, deadline=None)
slopes = st.floats(0.3, 6.0)


@pytest.fixture(scope="module")
def book():
    return load(NAME)


def force(x, p):
    return np.where(x < p.L, p.p1 * x + p.c1, p.p2 * x + p.c2)


def test_the_handbooks_values_are_continuous(book):
    p = book["p"]
    assert (p.p1, p.c1, p.p2, p.c2, p.L) == (2.0, 0.5, 1.0, 1.0, 0.5)
    assert p.p1 * p.L + p.c1 == p.p2 * p.L + p.c2


@pytest.mark.parametrize("c2", [0.3, 1.8])
def test_with_a_jump_the_run_is_the_exact_solution(book, c2):
    p = book["p"]._replace(c2=c2)._asdict()
    k = (-1 / p["mu"], 0.0, p["h"] / p["mu"], p["omega"])
    x, v, switches = exact(book["spring"], p, 20.0, (1.0, 0.0), k)
    run = simulate(book["system"], 20.0, c2=c2, rtol=1e-11)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert sum("through" in event.transition for event in run.events) == switches


@few
@given(slopes, slopes, st.floats(0.05, 2), st.floats(0.05, 2), st.floats(0.1, 1), st.floats(0.1, 9))
def test_the_free_swing_is_the_integral_of_the_energy(p1, p2, c1, c2, L, beyond):
    """T = 2∫dx/v, with the speed that the energy leaves, also where F jumps."""
    book = load(NAME)
    p = book["p"]._replace(p1=p1, p2=p2, c1=c1, c2=c2, L=L)
    right = L + beyond
    left, time = book["free_swing"](right, p)

    def work(x):  # ∫ F from L to x
        k, c = (p1, c1) if x < L else (p2, c2)
        return k * (x * x - L * L) / 2 + c * (x - L)

    assert work(left) == pytest.approx(work(right), rel=1e-9)

    def slow(turn, other):  # x = turn + (other − turn) u²: no pole at the turn
        return quad(
            lambda u: (
                abs(other - turn)
                * 2
                * u
                / math.sqrt(2 / p.mu * (work(turn) - work(turn + (other - turn) * u * u)))
            ),
            1e-9,
            1,
            epsabs=1e-11,
        )[0]

    assert time == pytest.approx(2 * (slow(left, L) + slow(right, L)), rel=1e-6)


@few
@given(st.floats(0.1, 8.0), st.floats(0.1, 2.0))
def test_one_harmonic_about_the_middle_that_has_no_mean_force(A, c2):
    book = load(NAME)
    p = book["p"]._replace(c2=c2)
    B, stiffness = book["harmonic"](A, p)
    cut = np.arcsin(np.clip((p.L - B) / A, -1, 1))

    def mean(part):
        pieces = ((-np.pi / 2, cut), (cut, np.pi / 2))
        return sum(
            quad(lambda a: float(force(B + A * np.sin(a), p)) * part(a), low, high)[0]
            for low, high in pieces
        )

    assert mean(lambda a: 1.0) == pytest.approx(0.0, abs=1e-7)
    assert stiffness == pytest.approx(2 / (np.pi * A) * mean(np.sin), abs=1e-7)


def test_a_steady_motion_has_no_mean_force_but_a_mean(book):
    run = simulate(book["system"], 400.0, h=3.0, start={"x": -0.25}, rtol=1e-11, **book["shaken"])
    T = 2 * math.pi / 0.8
    t = np.linspace(run.t[-1] - 10 * T, run.t[-1], 4001)[:-1]
    x = run.at(t)["x"]
    assert abs(force(x, run.p).mean()) < 1e-3 and x.mean() == pytest.approx(0.28, abs=0.01)


def test_the_deep_tone_closes_after_two_periods_and_not_after_one(book):
    """Scipy goes round, over the kink in short steps; the motion is back after 2T only."""
    cycle, p = book["octave"], book["system"].values(book["fast"])
    T = 2 * math.pi / p.omega

    def f(t, y):
        outer = p.h * math.sin(p.omega * t) - p.delta * y[1]
        return y[1], (outer - float(force(y[0], p))) / p.mu

    begin = np.array([cycle.run["x"][0], cycle.run["v"][0]])
    t0 = cycle.run.t[0]
    found = solve_ivp(
        f, (t0, t0 + 2 * T), begin, "DOP853", [t0 + T, t0 + 2 * T], rtol=1e-11, max_step=0.01
    )
    once, twice = found.y.T
    assert abs(once[0] - begin[0]) > 1 and twice == pytest.approx(begin, abs=1e-6)


def test_small_swings_know_one_slope_only(book):
    """Up to L the answer is linear: superposition holds; beyond it fails."""
    system = book["system"]
    small, double = (simulate(system, 60.0, h=h, omega=2.4, start={"x": -0.25}) for h in (0.2, 0.4))
    t = np.linspace(0, 60, 601)
    assert double.at(t)["x"] + 0.25 == pytest.approx(2 * (small.at(t)["x"] + 0.25), abs=1e-6)
    assert not small.events and not double.events
    assert simulate(system, 60.0, h=3.0, start={"x": -0.25}).events


@pytest.mark.parametrize("name, value", [("L", 0.0), ("p1", 0.0), ("c2", -0.5), ("p2", -1.0)])
def test_constants_that_are_not_positive_are_refused(book, name, value):
    with pytest.raises(ModelError, match="outside its range"):
        simulate(book["system"], 1.0, **{name: value})
