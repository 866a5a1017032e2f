"""Assignment 2.f on its notebook's model: closed forms, and exact pieces with friction."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import ModelError, section, simulate

from .helpers import load
from .test_characteristics import exact

NAME = "part2/2f_clearance_springs"
few = settings(max_examples=15, deadline=None)


@pytest.fixture(scope="module")
def book():
    return load(NAME)


def pieces_with_friction(p, t_end, x):
    """(x, v, edges passed) from rest at x, by matrix exponentials from edge to edge.

    The motion crosses the edges; steps of 10 ms look for them.
    """
    laws = {}
    for place, (k, c) in {-1: (p.p, p.c2), 0: (0.0, 0.0), 1: (p.p, p.c1)}.items():
        A = np.zeros((5, 5))  # x, v, 1, sin ωt, cos ωt
        A[0, 1], A[3, 4], A[4, 3] = 1.0, p.omega, -p.omega
        A[1] = np.array([-k, -p.delta, -c, p.h, 0.0]) / p.mu
        laws[place] = A, expm(0.01 * A)
    t, y, passed, place = 0.0, np.array([x, 0.0, 1.0, 0.0, 1.0]), 0, int(x > p.L) - int(x < -p.L)
    while True:
        A, step = laws[place]
        after, tau = step @ y, 0.01
        while t + tau < t_end and (-p.L < after[0] < p.L if place == 0 else place * after[0] > p.L):
            after, tau = step @ after, tau + 0.01
        if t + tau >= t_end:
            return *(expm((t_end - t) * A) @ y)[:2], passed
        edge = math.copysign(p.L, after[0]) if place == 0 else place * p.L
        tau = brentq(
            lambda q, A=A, y=y, edge=edge: (expm(q * A) @ y)[0] - edge, tau - 0.01, tau, xtol=1e-15
        )
        t, y, passed = t + tau, expm(tau * A) @ y, passed + 1
        y[0] = edge
        place = 0 if place else int(math.copysign(1, edge))


def test_the_rattle_is_the_exact_solution_as_long_as_it_can_be_told(book):
    """150 s: what rounding leaves has grown a hundred thousand times by then."""
    system, rattle = book["system"], book["rattle"]
    for t_end, close in ((59.0, 1e-9), (100.0, 1e-8), (150.0, 1e-6)):
        x, v, passed = pieces_with_friction(system.values(rattle), t_end, 1.0)
        run = simulate(system, t_end, rtol=1e-13, atol=1e-14, **rattle)
        assert len(run.events) == passed > 10
        assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=close)


def test_a_distance_grows_as_the_notebook_says(book):
    """In the exact pieces, without any tolerance: from 1 µm to a centimetre in 100 … 200 s."""
    p = book["system"].values(book["rattle"])
    one, two = (
        np.array([pieces_with_friction(p, t, x)[0] for t in (20.0, 190.0)]) for x in (1.0, 1 + 1e-6)
    )
    early, late = np.abs(one - two)
    assert early < 1e-5 and late > 1e-3
    assert book["rate"] == pytest.approx(0.086, abs=0.02)


def test_a_larger_force_makes_it_regular_again(book):
    """With 0.6 N it repeats after five periods, from the first start and not before."""
    options = book["rattle"] | {"h": 0.6}
    period = 2 * math.pi / 0.3
    run = simulate(book["system"], 150 * period, rtol=1e-10, points=2, **options)
    x = section(run, period, since=100 * period)["x"]
    assert np.abs(x[5:] - x[:-5]).max() < 1e-3
    assert all(np.abs(x[k:] - x[:-k]).max() > 0.1 for k in (1, 2, 3, 4))


@pytest.mark.parametrize("c1, c2", [(1.0, -0.2), (-0.2, -0.5)])
def test_unlike_springs_are_exact_too(book, c1, c2):
    p = book["p"]._replace(c1=c1, c2=c2)._asdict()
    k = (-1 / p["mu"], 0.0, p["h"] / p["mu"], p["omega"])
    x, v, switches = exact(book["springs"], p, 20.0, (1.0, 0.0), k)
    run = simulate(book["system"], 20.0, c1=c1, c2=c2, rtol=1e-11)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert sum("through" in event.transition for event in run.events) == switches


@few
@given(st.floats(0.01, 5), st.floats(-0.2, 1.5), st.floats(0.2, 3), st.floats(0.4, 2))
def test_the_period_of_a_swing_through_the_clearance(beyond, c1, p_, L):
    book = load(NAME)
    if p_ * L + c1 < 0.02:
        return
    values = {"c1": c1, "c2": -c1, "p": p_, "L": L}
    right = book["period"](L + beyond, book["system"].values(values))
    start = {"x": L + beyond}
    run = simulate(book["absent"], 1.01 * right, start=start, rtol=1e-12, **values)
    assert run.at(right)["x"] == pytest.approx(L + beyond, rel=1e-7)
    assert run.at(right / 2)["x"] == pytest.approx(-L - beyond, rel=1e-7)
    assert run.at(right / 4)["x"] == pytest.approx(0.0, abs=1e-6)


def test_wide_swings_are_quicker_than_the_springs_by_the_preload(book):
    p, w0 = book["p"], book["w0"]
    for A in (50.0, 500.0):
        gained = 2 * math.pi / w0 - book["period"](A, p)
        assert gained == pytest.approx(4 * p.c1 / (p.p * book["speed"](A, p)), rel=0.05)


@few
@given(st.floats(0.05, 2.0), st.floats(0.2, 2.0))
def test_a_mass_on_the_edge_stands_until_force_or_jump_lets_it_go(h, omega):
    book = load(NAME)
    if abs(h - 0.44) < 1e-3:
        return
    run = simulate(
        book["system"], 1.2 * math.pi / omega, h=h, omega=omega, start={"x": 0.4}, rtol=1e-11
    )
    first = run.events[0]
    assert run.mode[0] == "rest at L" and np.ptp(run["x"][run.t <= first.t]) == 0
    right = math.pi if h < 0.44 else math.asin(0.44 / h)
    assert first.t == pytest.approx(right / omega, rel=1e-9)
    assert first.transition == f"leaves L to the {'left' if h < 0.44 else 'right'}"


@pytest.mark.parametrize("values", [{"L": 0.1, "c1": -0.1}, {"p": 0.2, "c2": 0.1}])
def test_springs_that_pull_outwards_are_refused_in_words(book, values):
    with pytest.raises(ModelError, match="must push inwards"):
        simulate(book["system"], 1.0, **values)


def test_the_lines_of_the_resonance_solve_its_equation(book):
    p, A, h, delta = book["p"], 0.9, 0.15, 0.2
    s = p.L / A  # the describing function in closed form
    N = (2 / math.pi) * (
        p.p * (math.acos(s) + s * math.sqrt(1 - s * s)) + 2 * p.c1 / A * math.sqrt(1 - s * s)
    )
    assert book["springs"].describing(A, p) == pytest.approx(N, rel=1e-10)
    for omega in book["resonance"](A, h, delta, p):
        assert A * math.hypot(N - p.mu * omega**2, delta * omega) == pytest.approx(h, rel=1e-9)
