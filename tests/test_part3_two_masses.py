"""Assignment 3.10 on the notebook's own models.

Modal frequencies, passings and stops against matrix exponentials; the phase; the golden clock.
"""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import simulate

NAME = "part3/10_two_masses"
TIGHT = {"rtol": 1e-12, "atol": 1e-14}
PHI = (1 + math.sqrt(5)) / 2
# (x1, v1, x2, v2, sin θ, cos θ): the force is part of the state, so all is one linear system
START = np.array([0.1, 0.0, -0.1, 0.0, 0.0, 1.0])


def matrix(omega, cosine):
    A = np.zeros((6, 6))
    A[0, 1] = A[2, 3] = 1
    A[1, 0], A[1, 2], A[3, 0], A[3, 2] = -2, 1, 1, -1
    A[1, 5 if cosine else 4] = 1.5 if cosine else 1.0
    A[4, 5], A[5, 4] = omega, -omega
    return A


def pieces(end, T=20.0, t1=None, share=0.0):
    """[(begin, end, matrix)]: the exchange every T, the frequency another from t1 to t1 + 10."""
    changes = [] if t1 is None else [t1, t1 + 10]
    cuts = sorted({0.0, *np.arange(T, end, T), *changes, end})
    for a, b in zip(cuts[:-1], cuts[1:], strict=True):
        if a < end:
            omega = 2.0 * (1 + share) if changes and t1 <= a < t1 + 10 else 2.0
            yield a, min(b, end), matrix(omega, int(a / T + 1e-9) % 2)


def stop(L=3.0, low=None, high=5.0, **how):
    """First instant at which L + x2 − x1 passes a limit; None."""
    y, low = START, 0.1 * L if low is None else low
    for a, b, A in pieces(100.0, **how):
        step = 0.01
        E, t = expm(A * step), a
        while t < b - 1e-9:
            h = min(step, b - t)
            new = (E if h == step else expm(A * h)) @ y
            for limit in (low, high):
                before, after = (L + z[2] - z[0] - limit for z in (y, new))
                if (before < 0) != (after < 0):
                    return t + brentq(
                        lambda s, y=y, A=A, limit=limit: (
                            L + np.dot([-1, 0, 1, 0, 0, 0], expm(A * s) @ y) - limit
                        ),
                        0,
                        h,
                        xtol=1e-12,
                    )
            y, t = new, t + h
    return None


def test_handbook_values(names):
    p = names["system"].values()
    assert (p.m1, p.m2, p.c1, p.c2, p.H1, p.H2, p.omega, p.T) == (1, 1, 1, 1, 1, 1.5, 2, 20)
    assert (p.L, p.far) == (3, 5) and (names["horizon"], names["horizon_two"]) == (100.0, 100.0)
    assert names["system"].start == {"x1": 0.1, "v1": 0.0, "x2": -0.1, "v2": 0.0}
    assert names["system_two"].values().t1 == 5 and names["system_two"].values().a == 0.25


def test_natural_frequencies_are_golden(names):
    assert np.sqrt(names["squares"]) == pytest.approx([0.618034, 1.618034], abs=1e-6)
    run = simulate(
        names["system"], 2 * math.pi / PHI, H1=0.0, start={"x1": PHI / 10, "x2": -0.1}, **TIGHT
    )
    assert run["x1"][-1] == pytest.approx(PHI / 10, abs=1e-11)  # mode 2 alone comes back
    assert run["x2"][-1] == pytest.approx(-0.1, abs=1e-11)


def test_task_one_against_matrix_exponentials(names):
    run, y = simulate(names["system"], 100.0, **TIGHT), START
    for a, b, A in pieces(100.0):
        for t in np.linspace(a, b, 10)[1:-1]:
            exact = expm(A * (t - a)) @ y
            assert run.at(t)["x1"] == pytest.approx(exact[0], abs=1e-9)
            assert run.at(t)["x2"] == pytest.approx(exact[2], abs=1e-9)
        y = expm(A * (b - a)) @ y


def test_the_notebooks_modal_solution(names):
    t = np.linspace(0, 60, 200)
    found = names["exact"](t, names["system"].values(), (5.0, 15.0, -0.25))
    y = START
    for a, b, A in pieces(60.0, t1=5.0, share=-0.25):
        for k in np.flatnonzero((t > a) & (t < b)):
            exact = expm(A * (t[k] - a)) @ y
            assert found[:, k] == pytest.approx(exact[[0, 2, 1, 3]], abs=1e-10)
        y = expm(A * (b - a)) @ y


def test_passings_without_the_stop_rule(names):
    run = simulate(names["system"], 100.0, **TIGHT)
    assert run.ended == "finished"
    far, near = run.events["too far"].t, run.events["too near"].t
    assert len(far) == 7 and len(near) == 2
    assert far[0] == pytest.approx(stop(), abs=1e-8)
    assert near[0] == pytest.approx(stop(high=1e9), abs=1e-8)
    assert run["d"].min() < 0


@pytest.mark.parametrize("share", [0.25, -0.25])
@pytest.mark.parametrize("t1", [5.0, 10.0, 20.0, 27.3, 30.0])
def test_the_stop_rule(names, share, t1):
    """Also where the change and the exchange are due at one instant (20 s, and 30 + 10 s)."""
    exact = stop(t1=t1, share=share)
    run = simulate(names["system_two"], 100.0, t1=t1, a=share, **TIGHT)
    assert run.ended == "terminal event" and run.t[-1] == pytest.approx(exact, abs=1e-8)


def test_what_the_specification_says(names):
    ends = {name: run.t[-1] for name, run in names["stops"].items()}
    assert ends["unchanged"] == pytest.approx(44.24, abs=0.005)
    assert ends["25 % lower"] == pytest.approx(8.60, abs=0.005)


@pytest.mark.parametrize(("L", "share"), [(3.0, 0.0), (3.0, 0.25), (5.0, 0.25), (5.0, -0.25)])
def test_only_the_lower_limit(names, L, share):
    exact = stop(L=L, high=1e9, t1=5.0, share=share)
    run = simulate(names["system_two"], 100.0, L=L, far=1000.0, a=share, **TIGHT)
    if exact is None:
        assert run.ended == "finished"
    else:
        assert run.t[-1] == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("share", [0.25, -0.25])
def test_the_ramp(names, share):
    """θ = ω ∫(1 + q), q a triangle of 10 s; RK4 of one's own, 1 ms."""

    def theta(t):
        u = min(max(t - 5, 0), 10)
        area = u * u / 10 if u < 5 else 5 - (10 - u) ** 2 / 10
        return 2 * (t + share * area)

    def flow(t, y):
        return np.array([y[1], math.sin(theta(t)) - 2 * y[0] + y[2], y[3], y[0] - y[2]])

    y, t, h = START[:4], 0.0, 1e-3
    run = simulate(names["system_two"], 20.0, a=share, ramp=1.0, **TIGHT)
    end = run.t[-1]
    while t < end - 1e-12:
        step = min(h, end - t)
        a = flow(t, y)
        b = flow(t + step / 2, y + step / 2 * a)
        c = flow(t + step / 2, y + step / 2 * b)
        d = flow(t + step, y + step * c)
        y, t = y + step / 6 * (a + 2 * b + 2 * c + d), t + step
    assert min(abs(3 + y[2] - y[0] - limit) for limit in (0.3, 5.0)) < 1e-7
    assert run.final["q"] == pytest.approx(0 if end > 15 else share * (1 - abs(end - 10) / 5))


def test_the_golden_clock_grows_with_time(names):
    for T, grows in ((math.pi * PHI**2, True), (3 * math.pi * PHI**2, True), (20.0, False)):
        sizes = []
        y = START
        for a, b, A in pieces(800.0, T=T):
            y = expm(A * (b - a)) @ y
            sizes.append(math.hypot(y[2] - y[0], y[3] - y[1]))
        half = len(sizes) // 2
        assert (max(sizes[half:]) > 1.7 * max(sizes[:half])) == grows
    assert names["best"] == pytest.approx(math.pi * PHI**2, abs=0.15)


def test_a_rule_that_looks_now_and_then(names):
    model = names["system_two"]
    exact = stop(high=4.779)
    told = simulate(model, 100.0, a=0.0, far=4.779)
    assert told.t[-1] == pytest.approx(exact, abs=1e-5) and exact < 11
    for how in ({}, {"method": "RK4", "step": 0.15}):
        assert simulate(model, 100.0, a=0.0, far=4.779, locate=False, **how).t[-1] > 40


def test_answers_of_the_tasks(names):
    right = names["solutions"]
    assert right["still"] == 1
    assert right["third"] == pytest.approx(stop(t1=10.0, share=0.25), abs=1e-7)
    assert right["slow"] == pytest.approx(math.pi / (2 - 0.6180339887498949), rel=1e-12)
