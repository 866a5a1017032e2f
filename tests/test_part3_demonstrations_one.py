"""The demonstrations bouncing ball and switched circuit, on the notebooks' own models.

References are closed forms and matrix exponentials, written here from the equations.
"""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from labkit import check, simulate

from .helpers import load

# ---- the bouncing ball


@pytest.fixture(scope="module")
def ball():
    return load("part3/00_bouncing_ball")


def instants(n, e, y0=10.0, g=9.81):
    """Instants of the first n bounces, one by one: a fall, then flights of 2 v/g."""
    t, v, found = math.sqrt(2 * y0 / g), math.sqrt(2 * g * y0), []
    for _ in range(n):
        found.append(t)
        v *= e
        t += 2 * v / g
    return np.array(found)


def test_the_balls_values(ball):
    system, p = ball["system"], ball["system"].values()
    assert (p.g, p.e, system.start, ball["horizon"]) == (9.81, 0.8, {"y": 10.0, "v": 0.0}, 15.0)


@pytest.mark.parametrize(
    ("e", "y0", "g"), [(0.8, 10, 9.81), (0.5, 3, 9.81), (0.9, 1, 1.62), (0.3, 10, 20.0)]
)
def test_all_bounces_end_at_the_instant_of_theory(ball, e, y0, g):
    end = math.sqrt(2 * y0 / g) * (1 + e) / (1 - e)
    run = simulate(ball["system"], end + 1, e=e, g=g, start={"y": y0})
    hits = run.events["bounce"].t
    assert run.ended == "finished" and run.mode[-1] == "rest" and len(hits) < 400
    assert hits[-1] == pytest.approx(end, abs=1e-9)
    n = min(20, len(hits) - 1)
    assert np.allclose(hits[:n], instants(n, e, y0, g), rtol=0, atol=1e-10)
    assert run["y"].min() > -1e-12 and abs(run.final["y"]) < 1e-12


def test_the_elastic_ball_keeps_its_energy(ball):
    run = simulate(ball["system"], 100.0, e=1.0)
    hits = run.events["bounce"].t
    exact = instants(len(hits), 1.0)
    assert len(hits) == math.floor((100 / exact[0] + 1) / 2) and np.allclose(hits, exact, atol=1e-9)
    energy = run["v"] ** 2 / 2 + 9.81 * run["y"]
    assert np.abs(energy / 98.1 - 1).max() < 1e-11


def test_without_the_mode_rest_the_run_stops_and_says_so(ball):
    end = math.sqrt(20 / 9.81) * 9
    assert ball["lost"].ended == "Zeno" and ball["lost"].t[-1] == pytest.approx(end, abs=1e-7)


def test_the_whole_way_is_the_sum_of_the_heights(ball):
    way = 10 + 2 * sum(10 * 0.64**k for k in range(1, 200))
    assert ball["way"] == pytest.approx(way, abs=1e-8)


def test_a_late_or_straight_location_is_of_first_or_second_order(ball):
    """Single errors stay below those of ten locations: a step each, or g h²/8 over the speed."""
    speed, tenth = math.sqrt(2 * 9.81 * 10), ball["tenth"]
    for h in (0.1, 0.013, 0.0017):
        chord, late = tenth(h, "straight line"), tenth(h, "end of the step")
        assert chord < 19 * 1.1 * 9.81 * h**2 / 8 / (speed - 9.81 * h)
        assert chord < late < 19 * h
    assert 0.8 < ball["slopes"]["end of the step"] < 1.2
    assert 1.8 < ball["slopes"]["straight line"] < 2.2


def test_the_form_of_the_guard_decides(ball):
    tries = ball["tries"]
    first = math.sqrt(20 / 9.81)
    for name in ("y", "y³"):
        assert tries[name].events[0].t == pytest.approx(first, abs=1e-9)
    assert len(tries["y³"].events) < len(tries["y"].events)
    for name in ("y²", "y / (1 m + y)"):  # it falls freely for 15 s
        assert not tries[name].events
        assert tries[name].final["y"] == pytest.approx(10 - 9.81 / 2 * 15**2, rel=1e-9)


def test_taken_at_its_word_the_definition_leaves_the_flight_again_and_again(ball):
    gaps = np.diff(ball["word"].events["bounce"].t)
    assert np.sum(gaps == 0) > 1000 and np.all(np.diff(ball["hits"][:40]) > 0)


def test_the_balls_tasks(ball):
    right, first = ball["solutions"], math.sqrt(20 / 9.81)
    assert right["moon"] == pytest.approx(math.sqrt(20 / 1.62) * 9, abs=1e-8)
    assert first * (1 + right["e"]) / (1 - right["e"]) == pytest.approx(20, abs=1e-9)
    assert "✗" in str(check("never", ball["t_end"], rel=0.05, hint="…"))


# ---- the switched circuit


@functools.cache
def piece(R, L, C, h):
    return expm(np.array([[-R / L, -1 / L], [1 / C, 0.0]]) * h)


@pytest.fixture(scope="module")
def circuit():
    return load("part3/00_switched_circuit")


def state(t, R=(1.0, 4.0), T=1.0, E=5.0, L=0.5, C=0.2):
    """(i, u) at t from rest: matrix exponentials of the homogeneous system about (0, E)."""
    x, k = np.array([0.0, -E]), 0
    while t > 1e-12:
        h = min(t, T)
        x = piece(R[k % 2], L, C, h) @ x
        t, k = t - h, k + 1
    return x + np.array([0.0, E])


CHANGES = [
    {},
    {"R1": 4.0, "R2": 1.0},
    {"T": 0.3},
    {"L": 0.1, "C": 0.05, "E": 12.0},
    {"R1": 0.1, "R2": 9.0, "T": 2.7},
]


def of(change):
    """The arguments of `state` for parameters of the notebook."""
    p = {"R1": 1.0, "R2": 4.0} | change
    return {"R": (p.pop("R1"), p.pop("R2"))} | p


def test_the_circuits_values(circuit):
    p = circuit["system"].values()
    assert (p.L, p.C, p.E, p.R1, p.R2, p.T) == (0.5, 0.2, 5, 1, 4, 1)
    assert circuit["system_two"].values()._asdict() == p._asdict()
    assert circuit["horizon"] == circuit["horizon_two"] == 10.0


@pytest.mark.parametrize("change", CHANGES)
def test_both_ways_are_the_exact_curve(circuit, change):
    t = np.array([0.4, 1.0, 1.7, 2.0, 3.3, 5.0, 7.9, 10.0])
    exact = np.array([state(one, **of(change)) for one in t])
    for system, bound in ((circuit["system"], 1e-9), (circuit["system_two"], 1e-7)):
        at = simulate(system, 10.0, rtol=1e-11, **change).at(t)
        assert np.abs(np.array([at["i"], at["u"]]).T - exact).max() < bound


def test_the_notebooks_exact_solution(circuit):
    for change in CHANGES[:3]:
        found = circuit["exact"](np.linspace(0, 6, 13), circuit["system"].values(change))
        assert np.allclose(
            found, [state(t, **of(change)) for t in np.linspace(0, 6, 13)], atol=1e-11
        )


def test_the_resistance_is_that_of_the_clock(circuit):
    run = simulate(circuit["system"], 10.0, R1=2.0, R2=7.0)
    assert run.at(np.arange(10) + 0.5)["R"].tolist() == [2.0, 7.0] * 5
    assert run.at(1.0, side="before")["R"] == 2.0 and run.at(1.0)["R"] == 7.0


@pytest.mark.parametrize("change", [{}, {"R2": 8.0}, {"T": 0.25}, {"C": 0.1, "E": 10.0}])
def test_the_heat_does_not_depend_on_the_resistances(circuit, change):
    heat = simulate(circuit["system"], 40.0, rtol=1e-10, **change).final["Q"]
    assert heat == pytest.approx(0.5 * change.get("C", 0.2) * change.get("E", 5.0) ** 2, abs=1e-7)


def test_the_energy_is_balanced_at_every_instant(circuit):
    run = simulate(circuit["system"], 10.0, rtol=1e-11)
    stored = 0.25 * run["i"] ** 2 + 0.1 * run["u"] ** 2
    assert np.abs(stored + run["Q"] - run["u"]).max() < 1e-9  # E C u


@pytest.mark.parametrize("off", [0.0, 0.37])
def test_the_second_way_takes_three_orders_from_rk4(circuit, off):
    """Against the exact state at 2.5 s: order 4 and 1."""
    exact = state(2.5)
    for name, order in (("system", 4), ("system_two", 1)):
        errors = []
        for n in (20, 80):
            run = simulate(circuit[name], 10.0, method="RK4", step=1 / (n + off))
            at = run.at(np.linspace(1, 4, 25))
            truth = np.array([state(t) for t in np.linspace(1, 4, 25)])
            errors.append(np.abs(np.array([at["i"], at["u"]]).T - truth).max())
        assert math.log(errors[0] / errors[1], 4) == pytest.approx(order, abs=0.25)
    assert np.abs(exact - [run.at(2.5)["i"], run.at(2.5)["u"]]).max() > 1e-5


def test_the_second_way_costs_evaluations_and_labkit_says_so(circuit):
    for method in ("DOP853", "RK45"):
        held, two = (
            simulate(circuit[name], 10.0, method=method, rtol=1e-9)
            for name in ("system", "system_two")
        )
        assert two.work.evaluations > 1.5 * held.work.evaluations
        assert two.work.rejected > 5 * held.work.rejected
        assert not held.notes and "seems to jump" in two.notes[0]


def test_the_saw_is_another_circuit_with_the_same_heat(circuit):
    wrong = circuit["wrong"]

    def flow(t, x):
        R = 1 + 3 * (t % 2)
        return [(5 - R * x[0] - x[1]) / 0.5, x[0] / 0.2]

    x = [0.0, 0.0]
    for k in range(2):
        x = solve_ivp(flow, (2 * k, 2 * k + 2 - 1e-13), x, rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.allclose([wrong.at(4.0)["i"], wrong.at(4.0)["u"]], x, atol=1e-6)
    assert wrong.final["Q"] == pytest.approx(2.5, abs=1e-3)


def test_the_circuits_tasks(circuit):
    right = circuit["solutions"]
    highest = max(state(t, R=(4.0, 1.0))[1] for t in np.linspace(1.5, 2.7, 121))
    assert right["swapped"] == pytest.approx(highest, abs=1e-3)
    fast = [state(t, T=0.01) - state(t, R=(2.5, 2.5)) for t in (0.5, 1.0, 2.0)]
    assert right["mean"] == 2.5 and np.abs(fast).max() < 0.02
