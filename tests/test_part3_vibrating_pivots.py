"""Assignment 3.3 on the notebook's own models.

Thresholds against Mathieu's characteristic values and against SciPy's own monodromy matrices; the
fates of both pendulums with and without stops; areas; the held phase; true angles.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import mathieu_a

from labkit import monodromy, simulate

NAME = "part3/03_vibrating_pivots"
G, L, W = 9.81, 40.0, 5 * math.pi
SMALL = math.radians(0.1)


def piece(way, A, t0, t1, delta=0.0, omega=W):
    """The matrix of φ'' = −way (g − Aω² cos ωt)/l φ − δφ' from t0 to t1, by SciPy."""

    def flow(t, y):
        f = -way * (G - A * omega**2 * math.cos(omega * t)) / L
        return [y[2], y[3], f * y[0] - delta * y[2], f * y[1] - delta * y[3]]

    found = solve_ivp(flow, (t0, t1), [1, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-14)
    return found.y[:, -1].reshape(2, 2)


def rest(way, seconds, delta=0.0):
    return expm(np.array([[0, 1], [-way * G / L, -delta]]) * seconds)


@pytest.fixture(scope="module")
def cycles():
    """{(way, A): the matrix of a cycle from the top of the pivot's way}"""
    return {(way, A): piece(way, A, 0, 0.4) for way in (1, -1) for A in (1.5, 2.0, 2.5)}


def test_values(names):
    p = names["system"].values()
    assert (p.A, p.dA, p.l, p.delta, p.stop) == (2, 0.5, 40, 0, 1)
    assert p.omega1 == p.omega2 == W and names["horizon"] == names["horizon_two"] == 200
    run = simulate(names["system"], 3.5)
    assert run.start["phi1"] == run.start["phi2"] == pytest.approx(SMALL)
    assert run.at(2.9)["phi2"] == SMALL != run.at(3.5)["phi2"]
    assert run.at(3.5)["theta2"] == pytest.approx(3.5 * W)


@pytest.mark.parametrize(("A", "known"), [(1.5, 18.68), (2.0, 14.015), (2.5, 11.215)])
def test_thresholds_are_mathieus(names, A, known):
    def miss(omega):
        return mathieu_a(0, 2 * A / L) + 4 * G / (L * omega**2)

    exact = brentq(miss, 5, 30, xtol=1e-12)
    assert names["threshold"](A) == pytest.approx(exact, abs=1e-7)
    assert exact == pytest.approx(known, abs=2.5e-3)
    assert exact == pytest.approx(math.sqrt(2 * G * L) / A, rel=1e-3)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("A", [1.5, 2.0, 2.5])
def test_a_cycle_against_scipy(names, cycles, way, A):
    assert np.allclose(names["M"](A, way=way), cycles[way, A], rtol=0, atol=1e-9)


def test_in_turn(names, cycles):
    power = np.linalg.matrix_power
    for way, word in ((1, "hanging"), (-1, "inverted")):
        for A in (2.5, 1.5):
            exact = np.trace(power(cycles[way, A], 25) @ power(cycles[way, 2.0], 25))
            assert names["plain"][f"{word}, 2 and {A} m"] == pytest.approx(exact, abs=1e-6)
    assert abs(names["plain"]["inverted, 2 and 1.5 m"]) > 2


def test_the_last_angles_without_stops(names, cycles):
    power = np.linalg.matrix_power
    run = simulate(names["system"], 200.0, rtol=1e-11)
    both = {way: power(cycles[way, 2.5], 25) @ power(cycles[way, 2.0], 25) for way in (1, -1)}
    x1 = power(both[1], 10) @ [SMALL, 0]
    begun = power(cycles[-1, 2.5], 25) @ piece(-1, 2.0, 3.0, 10.0)
    x2 = power(both[-1], 9) @ begun @ [SMALL, 0]
    found = [run.final[name] for name in ("phi1", "u1", "phi2", "u2")]
    assert found == pytest.approx([*x1, *x2], abs=1e-6 * SMALL)


def by_clock(way, seconds, delta=0.0):
    """Stops of 1 s after 10 s, A changes every 10 s of the clock: the product of the seconds."""
    moved, product = 0, np.eye(2)
    pieces = {
        (A, half): piece(way, A, half * 0.2, half * 0.2 + 1, delta)
        for A in (2.0, 2.5)
        for half in (0, 1)
    }
    for second in range(seconds):
        if second % 11 == 10:
            product = rest(way, 1, delta) @ product
        else:
            product = pieces[(2.0, 2.5)[second // 10 % 2], moved % 2] @ product
            moved += 1
    return product


def test_pendulum_1_with_stops_by_the_clock_against_scipy(names):
    run = simulate(names["system_two"], 150.0, rtol=1e-11)
    exact = by_clock(1, 150) @ [SMALL, 0]
    assert [run.final["phi1"], run.final["u1"]] == pytest.approx(exact, abs=1e-6 * SMALL)


def test_by_the_clock_both_are_unstable(names):
    """Pendulum 2 falls; pendulum 1 triples in 220 s, too slowly to be seen in 200 s."""
    for way, size in ((1, 3.155), (-1, 17141.5)):
        exact = by_clock(way, 220)
        assert np.linalg.det(exact) == pytest.approx(1, abs=1e-3)
        assert np.abs(np.linalg.eigvals(exact)).max() == pytest.approx(size, rel=1e-3)
        assert np.trace(names["clock"](way)) == pytest.approx(np.trace(exact), rel=1e-6)
    run = simulate(names["system_two"], 2000.0, start={"phi2": 0.0}, rtol=1e-10)
    assert run.stopped == 'terminal event "falls"' and 1000 < run.t[-1] < 1400
    assert abs(run.final["phi1"]) == pytest.approx(math.radians(20), abs=1e-9)


def test_fates(names):
    fate, runs = names["fate"], names["runs"]
    assert fate(runs["no stops", 0.0]) == fate(runs["A by the motion", 0.0]) == "stays near"
    assert fate(runs["A by the clock", 0.0]) == "falls"
    assert all(fate(runs[name, 0.1]) == "shrinks" for name in names["models"])
    assert names["run_two"].t[-1] == pytest.approx(168.16, abs=0.01)
    assert fate(simulate(names["system"], 200.0, dA=-0.5)) == "falls"
    long = simulate(names["system_three"], 5000.0, points=20_001)
    assert long.ended == "finished" and np.abs(long["phi2"]).max() < 3 * SMALL


def test_stops_by_the_motion(names, cycles):
    power = np.linalg.matrix_power
    for way in (1, -1):
        both = [rest(way, 1) @ power(cycles[way, A], 25) for A in (2.0, 2.5)]
        trace = np.trace(both[1] @ both[0])
        assert names["stops"][way] == pytest.approx(trace, abs=1e-6) and abs(trace) < 2
    run = simulate(names["system_three"], 66.0, rtol=1e-11)
    exact = power(
        rest(1, 1) @ power(cycles[1, 2.5], 25) @ rest(1, 1) @ power(cycles[1, 2.0], 25), 3
    )
    assert run.final["phi1"] == pytest.approx((exact @ [SMALL, 0])[0], abs=1e-6 * SMALL)


def test_when_things_change(names):
    """Stops at 10, 21, 32 …; A at 10, 20, 30 … or with the stops; the phase waits."""
    clock = simulate(names["system_two"], 60.0)
    motion = simulate(names["system_three"], 60.0)
    assert clock.events["stop"].t == pytest.approx([10, 21, 32, 43, 54])
    assert clock.events["go"].t == pytest.approx([11, 22, 33, 44, 55])
    assert clock.events["A changes"].t == pytest.approx([10, 20, 30, 40, 50, 60])
    for t, seconds in ((10.5, 10), (21.9, 20), (25.0, 23)):
        assert clock.at(t)["theta1"] == pytest.approx(W * seconds)
        assert motion.at(t)["theta2"] == pytest.approx(W * seconds)
    assert [motion.at(t)["b"] for t in (5.0, 15.0, 25.0, 35.0)] == [0, 1, 0, 1]
    assert [clock.at(t)["b"] for t in (5.0, 19.0, 25.0, 35.0)] == [0, 1, 0, 1]


def test_damping(names):
    found = names["M"](2.0, delta=0.1)
    assert np.allclose(found, piece(-1, 2.0, 0, 0.4, 0.1), rtol=0, atol=1e-9)
    assert np.linalg.det(found) == pytest.approx(math.exp(-0.1 * 0.4), abs=1e-9)


def test_areas(names):
    """Kept by an accurate run; Euler's shrinks by 1 − h² g/l a step, in the mean."""
    areas = names["areas"]
    assert areas["DOP853, 1e-8"] == pytest.approx(1, abs=1e-5)
    shrunk = math.exp(-0.01 * G / L * 197)
    assert areas["Euler, 0.01 s"] == pytest.approx(shrunk, abs=0.02)


def test_the_chart(names):
    """The traces from the sweep against SciPy's and the border a0(q)."""
    trace, grid = names["trace"], names["grid"]
    for row, column in ((3, 30), (11, 5), (30, 20)):
        found = monodromy(names["mathieu"], math.pi, a=grid["a"][row], q=grid["q"][column])
        assert trace[row, column] == pytest.approx(np.trace(found.matrix), abs=1e-3)
    below = grid["a"][:, None] < mathieu_a(0, grid["q"]) - 0.02
    assert (np.abs(trace)[below] > 2).all()


def test_the_held_phase(names):
    values = {"omega1": 16.0, "omega2": 16.0, "delta": 0.1}
    held, jumps = (simulate(names[one], 200.0, **values) for one in ("system_two", "system_trap"))
    assert held.ended == "finished" and jumps.ended != "finished"
    assert held.at(15.0)["theta1"] == pytest.approx(16 * 14)


def test_shown_angles(names):
    run = names["run"]
    assert run["shown2"].min() >= 0 and run["shown2"].max() < 360
    wrapped = np.degrees(run["phi2"]) % 360
    assert np.abs(run["shown2"] - wrapped).max() < 1e-9


def test_answers_of_the_tasks(names):
    right = names["solutions"]

    def miss(omega):
        return mathieu_a(0, 0.1) + 4 * 1.62 / (L * omega**2)

    assert right["moon"] == pytest.approx(brentq(miss, 4, 8), abs=1e-6)
    half = np.trace(piece(-1, 2.0, 0, 0.4)) / 2
    assert right["period"] == pytest.approx(2 * math.pi * 0.4 / math.acos(half), rel=1e-6)
    sizes = [
        np.abs(np.linalg.eigvals(by_clock(-1, 220, right["damping"] * share))).max()
        for share in (0.999, 1.001)
    ]
    assert sizes[0] > 1 > sizes[1]
