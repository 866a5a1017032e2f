"""Assignment 3.15 on the notebook's own models.

Two rotations in turn, as printed; the gas as it is. References: SciPy's matrix exponential and
integrator, and closed forms, written once more.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from labkit import monodromy, simulate

NAME = "part3/15_piston_and_gas"
TIGHT = {"rtol": 1e-12, "atol": 1e-13}
G, P0, L0 = 9.81, 101325.0, 1000.0


def printed(t, S=0.01, m=10.0, r=0.8, T=10.0, p0=P0):
    """x and v at t by matrix exponentials."""
    state, now, k = np.array([1.0, 0.0]), 0.0, 0
    while now < t:
        square = (m * G + (r if k % 2 else 1) * p0 * S) / (m * L0)
        end = min(t, (k + 1) * T)
        state = expm(np.array([[0, 1], [-square, 0]]) * (end - now)) @ state
        now, k = end, k + 1
    return state


def test_handbook_values(names):
    p = names["system"].values()
    assert (p.m, p.l0, p.p0, p.r, p.T, p.S) == (10, 1000, 101325, 0.8, 10, 0.01)
    q = names["system_two"].values()
    assert (q.m, q.S) == (20, 0.005) and q[2:] == p[2:]
    assert names["system"].start == {"x": 1.0, "v": 0.0}
    assert names["horizon"] == names["horizon_two"] == 400.0


@pytest.mark.parametrize(
    ("change", "t"),
    [({}, 400.0), ({"S": 0.0098}, 1600.0), ({"S": 0.0233}, 395.0), ({"m": 20, "S": 0.005}, 400.0),
     ({"p0": 0.0}, 400.0), ({"T": 5.0}, 123.4), ({"r": 0.5, "T": 7.0}, 300.0)],
)  # fmt: skip
def test_runs_against_matrix_exponentials(names, change, t):
    run, right = simulate(names["system"], t, **TIGHT, **change), printed(t, **change)
    assert run.ended == "finished"
    assert run["x"][-1] == pytest.approx(right[0], abs=1e-8 * max(1, abs(right[0])))
    assert run["v"][-1] == pytest.approx(right[1], abs=1e-8 * max(1, abs(right[0])))


@pytest.mark.parametrize(
    ("S", "percent"), [(0.0098, 1.4036646), (0.0233, 10.8400749), (0.01, 0.0), (0.005, 0.0)]
)
def test_growth_in_twenty_seconds(names, S, percent):
    squares = [(10 * G + share * P0 * S) / (10 * L0) for share in (1, 0.8)]
    M = expm(np.array([[0, 1], [-squares[1], 0]]) * 10) @ expm(
        np.array([[0, 1], [-squares[0], 0]]) * 10
    )
    mu = np.abs(np.linalg.eigvals(M)).max()
    assert 100 * (mu - 1) == pytest.approx(percent, abs=1e-4)
    p = names["system"].values({"S": S})
    assert names["half_trace"](p) == pytest.approx(np.trace(M) / 2, abs=1e-12)
    assert names["growth"](p) == pytest.approx(mu, abs=1e-7)
    found = monodromy(names["system_free"], 20.0, S=S)
    assert np.allclose(found.matrix, M, rtol=0, atol=1e-10)
    assert found.stable == (percent == 0)


def test_without_pressure_it_is_a_pendulum_of_a_kilometre(names):
    for m, S in ((10, 0.01), (50, 0.05), (1, 0.001)):
        run = simulate(names["system"], 400.0, p0=0.0, m=m, S=S, **TIGHT)
        exact = np.cos(math.sqrt(G / L0) * run.t)
        assert np.allclose(run["x"], exact, rtol=0, atol=1e-10)


def test_growth_that_400_seconds_do_not_show(names):
    grows, bounded = (
        np.abs(simulate(names["system"], 400.0, S=S, points=4001)["x"]).max()
        for S in (0.0098, 0.01)
    )
    assert grows < bounded < 1.35
    far = []
    for S in (0.0098, 0.01):  # after 10 000 s, as powers of the matrix of one period
        rates = [(10 * G + share * P0 * S) / (10 * L0) for share in (1, 0.8)]
        full, low = (expm(np.array([[0, 1], [-rate, 0]]) * 10) for rate in rates)
        M = np.linalg.matrix_power(low @ full, 500)
        far.append(abs(M[0, 0]))
    assert far[0] > 100 and far[1] < 1.4


def test_the_rest_position_moves_by_223_m(names):
    rest = names["rest"]
    assert L0 + rest == pytest.approx(1223, abs=0.05)
    run = simulate(names["system_gas"], 9.0, mode="low", start={"x": rest})
    assert np.abs(run["x"] - rest).max() < 1e-9 and set(run.mode) == {"low"}
    assert simulate(names["system_gas"], 9.0, start={"x": 0.0})["x"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("n", [1.0, 1.4])
@pytest.mark.parametrize("S", [0.01, 0.0233])
def test_the_real_gas_against_scipy(names, n, S):
    run = simulate(names["system_gas"], 200.0, n=n, S=S, **TIGHT)
    y, A = [L0 + 1.0, 0.0], 10 * G + P0 * S
    for k in range(20):
        p = P0 * (0.8 if k % 2 else 1)
        y = solve_ivp(
            lambda t, y, p=p: (y[1], (A * (L0 / y[0]) ** n - 10 * G - p * S) / 10),
            (0, 10), y, method="DOP853", rtol=1e-12, atol=1e-10,
        ).y[:, -1]  # fmt: skip
    assert run["x"][-1] == pytest.approx(y[0] - L0, abs=2e-6)
    assert run["v"][-1] == pytest.approx(y[1], abs=2e-6)


def test_energy_of_the_real_gas_between_switches(names):
    run = simulate(names["system_gas"], 400.0, **TIGHT)
    A, bad = 10 * G + P0 * 0.01, 0.0
    for k in range(40):
        here = (run.t > 10 * k + 1e-9) & (run.t < 10 * k + 10 - 1e-9)
        p, y = P0 * (0.8 if k % 2 else 1), L0 + run["x"][here]
        E = 5 * run["v"][here] ** 2 + (10 * G + p * 0.01) * y - A * L0 * np.log(y / L0)
        bad = max(bad, np.ptp(E) / np.abs(E).max())
    assert bad < 1e-10


def test_the_linear_equation_with_a_force_ends_at_the_bottom(names):
    """x'' + ω² x = f or 0, exactly; x = −l0 at 67.18 s."""
    square, f = (10 * G + P0 * 0.01) / (10 * L0), 0.2 * P0 * 0.01 / 10
    w = math.sqrt(square)

    def at(t):
        x, v, now, k = 1.0, 0.0, 0.0, 0
        while now < t:
            tau, rest = min(10.0, t - now), f / square if k % 2 else 0.0
            c, s = math.cos(w * tau), math.sin(w * tau)
            x, v = rest + (x - rest) * c + v / w * s, -w * (x - rest) * s + v * c
            now, k = now + tau, k + 1
        return x

    run = simulate(names["system_force"], 400.0, **TIGHT)
    assert run.stopped == 'terminal event "bottom"' and run.t[-1] == pytest.approx(67.18, abs=0.01)
    assert at(run.t[-1]) == pytest.approx(-L0, abs=1e-6)
    gentle = simulate(names["system_force"], 400.0, r=0.999, **TIGHT)
    f /= 200
    assert gentle["x"][-1] == pytest.approx(at(400.0), abs=1e-9)


def test_the_real_piston_flies(names):
    gas = names["gas"]
    assert 174 < L0 + gas["x"].min() < 180 and 3620 < L0 + gas["x"].max() < 3630
    assert names["largest"] == pytest.approx(2625, abs=3)
    assert names["gas_mass"] == pytest.approx(13.2, abs=0.1)


def test_what_methods_believe(names):
    """|R|-theory for Euler with constant steps, and the trap at a coarse tolerance."""
    step = 0.1
    for S in (0.0098, 0.01):
        M = np.eye(2)
        for share in (1, 0.8):
            square = (10 * G + share * P0 * S) / (10 * L0)
            M = np.linalg.matrix_power(np.array([[1, step], [-step * square, 1]]), 100) @ M
        right = np.abs(np.linalg.eigvals(M)).max()
        assert names["believed"]({"S": S}, method="Euler", step=step) == pytest.approx(
            right, rel=1e-9
        )
    assert right > 1.1
    coarse = [names["believed"]({"S": S}, method="RK45", rtol=1e-2) for S in (0.0098, 0.01)]
    assert coarse[1] > 1.005


def test_answers_of_the_tasks(names):
    right, system = names["solutions"], names["system"]
    areas = np.linspace(0.0097, 0.0099, 20001)
    mu = names["growth"](system.values()._replace(S=areas))
    assert right["area"] == pytest.approx(areas[np.argmax(mu)], abs=2e-8)
    times = np.linspace(4, 6, 20001)
    mu = names["growth"](system.values()._replace(T=times))
    assert right["T"] == pytest.approx(times[np.argmax(mu)], abs=2e-4)
    p = P0 - right["dip"]
    assert (10 * G + P0 * 0.01) * 1000 / (10 * G + p * 0.01) == pytest.approx(1001, abs=1e-9)
