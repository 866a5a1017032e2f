"""Assignment 3.9 on the notebook's own models.

Gusts as products of matrices: which springs are safe; nothing of the references is labkit's.
"""

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from labkit import monodromy, simulate

NAME = "part3/09_plate_in_gas"
TIGHT = {"rtol": 1e-11, "atol": 1e-15}


def wind(t, a=0.5, T=5.0):
    """(V, ρ) at t: nominal, up, down, up, …; the density at half the pace."""
    n = int(t / T + 1e-9)
    return tuple(
        value * (1.0 if k == 0 else 1 + a if k % 2 else 1 - a)
        for value, k in ((1.0, n), (2.0, n // 2))
    )


def stiffness(t, c0=0.5, **gusts):
    V, rho = wind(t, **gusts)
    return (c0 * 5 - 0.5 * rho * V**2 * 1 / 2) * 5 / 1


def transfer(start, end, delta=0.0, **what):
    """The matrix from start to end, cut at every multiple of T, by matrix exponentials."""
    T = what.get("T", 5.0)
    cuts = [start, *(n * T for n in range(1000) if start < n * T < end), end]
    M = np.eye(2)
    for left, right in zip(cuts, cuts[1:], strict=False):
        k = stiffness((left + right) / 2, **what)
        M = piece(k, delta, round(right - left, 12)) @ M
    return M


@cache
def piece(k, delta, tau):
    return expm(np.array([[0, 1], [-k, -delta]]) * tau)


def test_handbook_values(names):
    p = names["system"].values()
    assert (p.l, p.c0, p.ky, p.rho, p.V, p.b, p.I, p.delta) == (5, 0.5, 0.5, 2, 1, 1, 1, 0)
    assert names["system"].start == {"phi": 0.01, "w": 0.0}
    assert names["horizon"] == names["horizon_two"] == 120.0
    q = names["system_two"].values()
    assert (q.a, q.T, q.t_k, q.knock) == (0.5, 5.0, 7.0, 0.01)
    assert names["system_two"].start["phi"] == 0.0


def test_the_gusts_come_as_the_convention_says(names):
    """1, then 1.5 and 0.5 in turn every 5 s; 2, then 3 and 1 in turn every 10 s."""
    run = simulate(names["system_two"], 60.0)
    for t in np.arange(0.5, 60, 1.0):
        V, rho = wind(t)
        at = run.at(t)
        assert (at["v"], 2 * at["r"]) == (V, rho)
        assert at["k"] == pytest.approx(stiffness(t), rel=1e-13)


def test_changes_of_the_present_value_compound(names):
    run = simulate(names["system_two"], 31.0, compound=1.0)
    assert [run.at(t)["v"] for t in (1, 6, 11, 16, 21)] == [1, 1.5, 0.75, 1.125, 0.5625]
    assert [run.at(t)["r"] for t in (1, 11, 21, 30.5)] == [1, 1.5, 0.75, 1.125]


def test_a_steady_stream_is_an_oscillator_or_departs(names):
    t = np.linspace(0, 100, 57)
    run = simulate(names["system"], 120.0, **TIGHT)
    assert np.allclose(run.at(t)["phi"], 0.01 * np.cos(math.sqrt(10) * t), rtol=0, atol=1e-10)
    slow = simulate(names["system"], 120.0, delta=0.3, **TIGHT)
    q = math.sqrt(10 - 0.15**2)
    exact = 0.01 * np.exp(-0.15 * t) * (np.cos(q * t) + 0.15 / q * np.sin(q * t))
    assert np.allclose(slow.at(t)["phi"], exact, rtol=0, atol=1e-11)
    for V in (2.3, 2.5, 3.0):
        rate = math.sqrt((0.5 * V**2 - 2.5) * 5)
        away = simulate(names["system"], 120.0, V=V, **TIGHT)
        assert away.stopped == 'terminal event "accident"'
        assert away.t[-1] == pytest.approx(math.acosh(4500) / rate, abs=1e-7)


@pytest.mark.parametrize("c0", [0.3, 0.43, 0.5, 0.53, 0.7])
def test_multipliers_are_those_of_the_product(names, c0):
    M = transfer(10.0, 30.0, c0=c0)
    right = np.abs(np.linalg.eigvals(M)).max()
    p = names["system_two"].values({"c0": c0})
    assert names["half_trace"](p) == pytest.approx(np.trace(M) / 2, abs=1e-9)
    assert names["multiplier"](p) == pytest.approx(right, rel=1e-8)
    found = monodromy(names["system_two"], 20.0, t0=10.0, t_k=0.0, c0=c0)
    assert abs(found.multipliers[0]) == pytest.approx(right, rel=1e-8)


def test_the_handbooks_plate_is_safe_by_a_half_trace_of_minus_0_947(names):
    assert names["half_trace"](names["system_two"].values()) == pytest.approx(-0.947, abs=5e-4)
    run = simulate(names["system_two"], 600.0)
    assert run.ended == "finished" and np.abs(run["phi"]).max() < 0.011


@pytest.mark.parametrize(
    ("c0", "t_k", "instant"),
    [(0.3, 0.0, 38.3), (0.3, 7.0, 39.09), (0.43, 7.0, 335.3), (0.53, 7.0, 375.6)],
)
def test_accidents_against_matrix_exponentials(names, c0, t_k, instant):
    run = simulate(names["system_two"], 600.0, c0=c0, t_k=t_k, **TIGHT)
    assert run.stopped == 'terminal event "accident"'
    assert run.t[-1] == pytest.approx(instant, abs=0.06)
    x = transfer(t_k, run.t[-1], c0=c0) @ [0.01, 0.0]
    assert abs(x[0]) == pytest.approx(45.0, rel=1e-6)
    assert run["w"][-1] == pytest.approx(x[1], rel=1e-6)
    assert names["exact_accident"](run.p, 600.0) == pytest.approx(run.t[-1], abs=1e-6)


def test_the_notebooks_matrix_is_the_exponential(names):
    for k in (10.0, 0.01, 0.0, -3.0):
        for delta in (0.0, 0.4):
            right = expm(np.array([[0, 1], [-k, -delta]]) * 1.7)
            assert np.allclose(names["pieces"](k, 1.7, delta), right, rtol=1e-12, atol=1e-12)


def test_damping_that_is_just_enough(names):
    enough = names["solutions"]["damping"]
    for share, grows in ((0.999, True), (1.001, False)):
        M = transfer(10.0, 30.0, c0=0.53, delta=share * enough)
        assert (np.abs(np.linalg.eigvals(M)).max() > 1) == grows
    assert enough == pytest.approx(math.log(1.618822734) / 10, rel=0.02)


def test_beaten_in_every_fourth_interval_and_safe(names):
    run = simulate(names["system_two"], 600.0, c0=0.3, T=0.5)
    assert run.ended == "finished" and (run["k"] < 0).any()
    M = transfer(1.0, 3.0, c0=0.3, T=0.5)
    assert abs(np.trace(M)) / 2 < 0.95


def test_true_geometry_against_scipy(names):
    """φ'' = −k(t) sin φ cos φ, interval by interval; the growth ends far below 45°."""
    run = simulate(names["system_bent"], 200.0, c0=0.53, knock=1.0, **TIGHT)
    x = np.array([math.radians(1.0), 0.0])
    for start, end in zip([7.0, *np.arange(10, 200, 5.0)], np.arange(10.0, 205, 5), strict=True):
        k = stiffness((start + end) / 2, c0=0.53)
        x = solve_ivp(
            lambda t, y, k=k: (y[1], -k * math.sin(y[0]) * math.cos(y[0])),
            (start, end), x, rtol=1e-11, atol=1e-14, method="DOP853",
        ).y[:, -1]  # fmt: skip
    assert run["phi"][-1] == pytest.approx(math.degrees(x[0]), abs=1e-6)
    assert 10 < np.abs(names["hour"]["phi"]).max() < 16


def test_fixed_steps_invent_and_hide_an_accident(names):
    system, two = names["system"], names["system_two"]
    euler = simulate(system, 600.0, method="Euler", step=0.02)
    h = 0.02
    assert euler.t[-1] == pytest.approx(2 * h * math.log(4500) / math.log(1 + 10 * h * h), abs=1.5)
    assert simulate(two, 600.0, c0=0.53, method="RK4", step=0.5).ended == "finished"
    assert simulate(two, 600.0, c0=0.53, method="RK4", step=0.1).ended != "finished"


def test_told_of_the_gusts_and_not_told(names):
    assert 3.7 < names["slope"]["told"] < 4.3 and names["slope"]["not told"] < 1.5
    told, not_told = (names["errors"][key] for key in ("told", "not told"))
    assert not_told[-1] > 1e4 * told[-1]


def test_answers_of_the_other_tasks(names):
    right = names["solutions"]
    assert right["speed"] == pytest.approx(math.sqrt(2.5 * 2 / (0.5 * 2 * 1.5**3)), rel=1e-12)
    k1, k2 = ((2.5 - 0.5 * V**2) * 5 for V in (1.5, 0.5))
    a, b = (5 * math.sqrt(k) for k in (k1, k2))
    h = math.cos(a) * math.cos(b) - (math.sqrt(k1 / k2) + math.sqrt(k2 / k1)) / 2 * math.sin(
        a
    ) * math.sin(b)
    assert right["half-trace"] == pytest.approx(h, abs=1e-10)
