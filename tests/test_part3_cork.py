"""Assignment 3.13 on the notebook's own models.

The printed equation against matrices, the true law against SciPy, and the energy that an exchange
of the liquids brings.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labkit import simulate

NAME = "part3/13_cork_in_water"
TIGHT = {"rtol": 1e-12, "atol": 1e-14}
G, WATER, CORK, H = 9.81, 1000.0, 200.0, 0.5
OTHER = {"first": (13600.0, 20.0, 0.0, (0.05, 0.0)), "second": (790.0, 25.0, 0.01, (0.0, 1.0))}


def turned(rho, damping, time):
    """The printed equation in one liquid: a matrix on (x, v)."""
    d = damping / 2
    n = math.sqrt(rho * G / (CORK * H) - d * d)
    c, s = math.cos(n * time), math.sin(n * time) / n
    return math.exp(-d * time) * np.array([[c + d * s, s], [-(n * n + d * d) * s, c - d * s]])


def test_handbook_values(names):
    p, second = names["system"].values(), names["second"].values()
    assert (p.g, p.rho_w, p.rho_c, p.H, p.S, p.r, second.r) == (9.81, 1000, 200, 0.5, 1, 0, 1)
    assert names["system"].start == {"x": 0.05, "v": 0.0}
    assert names["second"].start == {"x": 0.0, "v": 1.0}
    assert (names["horizon"], names["horizon_two"]) == (20.0, 400.0)
    two, other = names["system_two"].values(), names["second_two"].values()
    assert (two.rho_2, two.T, two.r, other.rho_2, other.T, other.r) == (13600, 20, 0, 790, 25, 1)


@pytest.mark.parametrize("name", ["first", "second"])
def test_water_alone(names, name):
    _, _, damping, start = OTHER[name]
    run = simulate(names["system" if name == "first" else "second"], 20.0, **TIGHT)
    exact = np.array([turned(WATER, damping, t) @ start for t in run.t])
    assert np.abs(run["x"] - exact[:, 0]).max() < 1e-10
    assert np.abs(run["v"] - exact[:, 1]).max() < 1e-9


def test_the_second_cork_comes_out_three_times_by_less_than_a_millimetre(names):
    """x = e^(−δt) sin(νt)/ν < −D: the instants where that begins, by bisection."""
    run = simulate(names["second"], 20.0, **TIGHT)
    found = run.events["bottom comes out"].t
    assert len(found) == 3 and len(run.events) == 3
    assert np.abs([(turned(WATER, 0.01, t) @ (0.0, 1.0))[0] + 0.1 for t in found]).max() < 1e-11
    nu = math.sqrt(98.1 - 2.5e-5)
    tops = [
        math.exp(-0.005 * t) * -math.sin(nu * t) / nu - 0.1
        for t in (math.pi + math.atan2(nu, 0.005) + 2 * math.pi * np.arange(5)) / nu
    ]
    assert sum(top > 0 for top in tops) == 3 and 0.0007 < tops[0] < 0.00075
    assert names["highest"]["second"] == pytest.approx(tops[0], abs=1e-7)
    assert names["highest"]["first"] == pytest.approx(-0.05, abs=1e-8)


@pytest.mark.parametrize("rho", [13600.0, 1360.0])
@pytest.mark.parametrize("name", ["first", "second"])
def test_liquids_in_turn_by_the_printed_equation(names, name, rho):
    """20 or 16 pieces, x and v kept at each exchange."""
    other, T, damping, state = OTHER[name]
    other = rho if name == "first" else other
    model = names["system_two" if name == "first" else "second_two"]
    run = simulate(model, 400.0, rho_2=other, **TIGHT)
    for k in range(round(400 / T)):
        state = turned(WATER if k % 2 == 0 else other, damping, T) @ state
        at = run.at(T * (k + 1), side="before")
        assert at["x"] == pytest.approx(state[0], abs=2e-9)
        assert at["v"] == pytest.approx(state[1], abs=2e-8)
    assert np.abs(run["x"]).max() < 0.21


def reference(name, rho, end, kept=True):
    """z and v of the true law at the exchanges, by SciPy; written from the handbook's forces."""
    other, T, damping, (x, v) = OTHER[name]
    other = rho or other
    z, out, k = CORK * H / WATER + x, [], 0
    while k * T < end - 1e-9:
        density = WATER if k % 2 == 0 else other

        def flow(t, y, density=density):
            wet = min(max(y[0], 0.0), H)
            drag = damping * y[1] if y[0] > 0 else 0.0
            return [y[1], G * (1 - density * wet / (CORK * H)) - drag]

        found = solve_ivp(
            flow, (0, T), [z, v], method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.01
        )
        z, v = found.y[:, -1]
        out.append((z, v))
        k += 1
    return np.array(out)


@pytest.mark.parametrize(
    ("name", "rho", "end"), [("first", 13600.0, 60.0), ("first", 1360.0, 60.0), ("second", 0, 75.0)]
)
def test_true_law_against_scipy(names, name, rho, end):
    other, T, _, _ = OTHER[name]
    run = simulate(
        names["system_true" if name == "first" else "second_true"], end, rho_2=rho or other, **TIGHT
    )
    exact = reference(name, rho, end)
    found = [run.at(T * (k + 1), side="before") for k in range(len(exact))]
    assert np.abs([-at["h"] for at in found] - exact[:, 0]).max() < 1e-6
    assert np.abs([at["v"] for at in found] - exact[:, 1]).max() < 1e-5


def test_energy_changes_only_at_exchanges_and_by_the_formula(names):
    run = simulate(names["system_true"], 320.0, **TIGHT, points=3000)
    gains = []
    for k in range(1, 16):
        before, after = (run.at(20.0 * k, side=side) for side in ("before", "after"))
        z, sign = -before["h"], 1 - 2 * before["liquid"]
        full = 0.0 if z < 0 else z**2 / 2 if z < H else H * (z - H / 2)
        gains.append(sign * (13600 - WATER) * G / (CORK * H) * full)
        assert after["e"] - before["e"] == pytest.approx(gains[-1], abs=1e-6)
        assert after["h"] == pytest.approx(before["h"], abs=1e-12)
    assert gains[0] > 1 and gains[2] > 40 and not any(gains[3:])
    late = (run.t > 60) & (run.t < 320)
    assert np.ptp(run["e"][late]) < 1e-6
    assert names["at_80"][2] == pytest.approx(run["e"][late][-1] / G, abs=1e-5)


def test_a_step_for_water_is_no_step_for_mercury(names):
    printed = names["printed"]
    for step, density, liquid in ((0.05, WATER, 0), (0.05, 13600.0, 1), (0.1, 13600.0, 1)):
        w = math.sqrt(density * G / (CORK * H))
        growth = abs(sum((1j * w * step) ** k / math.factorial(k) for k in range(5)))
        run = simulate(
            printed, 20.0, method="RK4", step=step, T=60.0, start={"liquid": float(liquid)}
        )
        size = math.hypot(run["x"][-1], run["v"][-1] / w) / 0.05
        assert size == pytest.approx(growth ** round(20 / step), rel=1e-6)
        assert (growth > 1) == (w * step > 2 * math.sqrt(2))


def test_told_and_not_told(names):
    told = simulate(names["system_true"], 60.0, points=3000)
    not_told = simulate(names["system_true"], 60.0, points=3000, locate=False)
    assert names["drift"](told) < 1e-6 and names["drift"](not_told) > 1e3
    assert names["top"](not_told) > 1e3 > 1 > names["top"](told)


@pytest.mark.parametrize(("rho", "grows"), [(13534.0, True), (13595.0, False), (13600.0, False)])
def test_the_temperature_decides_whether_it_grows(names, rho, grows):
    a, b = math.sqrt(WATER * G / 100), math.sqrt(rho * G / 100)
    half = math.cos(20 * a) * math.cos(20 * b) - (a / b + b / a) / 2 * math.sin(20 * a) * math.sin(
        20 * b
    )
    assert (abs(half) > 1) == grows
    size = abs(half) + math.sqrt(half**2 - 1) if grows else 1.0
    assert names["largest"](rho) == pytest.approx(size, abs=1e-9)


def test_answers_of_the_tasks(names):
    right = names["solutions"]
    nu = math.sqrt(98.1 - 2.5e-5)
    t = (math.pi + math.atan2(nu, 0.005)) / nu
    assert right["velocity"] == pytest.approx(
        0.1 * nu * math.exp(0.005 * t) / -math.sin(nu * t), rel=1e-9
    )
    assert right["rest"] == pytest.approx(0.58, abs=1e-6)
    z, v = turned(WATER, 0.0, 20.0) @ (0.05, 0.0) + (0.1, 0.0)
    lightest = 2 * CORK * H / z**2 * (z - v**2 / (2 * G))  # v²/2 − gz + ρ g z²/(2 ρc H) = 0
    assert right["lightest"] == pytest.approx(lightest, rel=1e-6)
