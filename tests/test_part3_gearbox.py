"""Part 3, item 5 on the notebook's own model: one linear equation through all gears.

The references are matrix exponentials and closed forms, written from the equations.
"""

from math import log, pi, sin, sqrt

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import simulate

from .helpers import load

NAME = "part3/05_automatic_gearbox"
M, K, TR, G = 1500.0, 187.5, 40.0, 9.81
RATIOS = (50.0, 32.0, 20.0, 14.0)


@pytest.fixture(scope="module")
def system():
    return load(NAME)["system"]


def matrix(vref, d=0.0, TR=TR):
    """Of (v, F, 1), F the force of the integrator."""
    return np.array(
        [[-K / M, 1 / M, K * vref / M - G * sin(d)], [-K / TR, 0, K * vref / TR], [0, 0, 0]]
    )


def reference(hill=0.0, kept=True, t_end=160.0):
    """Shifts, and (t, v, F) at the end or at standstill, gear by gear with matrix exponentials."""
    clock = [(60.0, "v", 10.0), (80.0, "d", hill), (95.0, "d", 0.0), (100.0, "v", 25.0)]
    clock.append((t_end, "", 0.0))
    t, x, now, q, found = 0.0, np.array([0.0, 0.0, 1.0]), {"v": 30.0, "d": 0.0}, 0, []
    for until, what, value in clock:
        while t < until:
            A = matrix(now["v"], now["d"])
            limits = [(+1, 500.0 / RATIOS[q]), (-1, 230.0 / RATIOS[q]), (0, 0.0)]
            first = (until, None)
            fine = np.linspace(0, until - t, 400)
            step_on, walk = expm(A * fine[1]), [x]
            for _ in fine[1:]:
                walk.append(step_on @ walk[-1])
            v = np.array(walk)[:, 0]
            for step, level in limits:
                if not 0 <= q + step < 4:
                    continue
                sign = step or -1
                k = np.flatnonzero(
                    (sign * (v[:-1] - level) < -1e-12) & (sign * (v[1:] - level) >= 0)
                )
                if len(k):
                    s = brentq(
                        lambda s, level=level, A=A, x=x: (expm(A * s) @ x)[0] - level,
                        fine[k[0]],
                        fine[k[0] + 1],
                        xtol=1e-14,
                        rtol=1e-15,
                    )
                    first = min(first, (t + s, step), key=lambda pair: pair[0])
            x, t = expm(A * (first[0] - t)) @ x, first[0]
            if first[1] == 0:
                return found, (t, *x[:2])
            if first[1] is not None:
                x[1] *= 1.0 if kept else RATIOS[q + first[1]] / RATIOS[q]
                q += first[1]
                found.append((t, q + 1))
        if what:
            now[what] = value
            x[1] *= what != "v"
    return found, (t, *x[:2])


def shifts(run):
    return [(e.t, int(e.target[-1])) for e in run.events if e.transition in ("up", "down")]


def test_handbook_values(system):
    names, p = load(NAME), system.values()
    assert names["horizon"] == names["horizon_two"] == 160.0
    assert (p.p1, p.p2, p.p3, p.p4) == RATIOS
    assert [p.k1, p.k2, p.k3, p.k4] == pytest.approx([3.75, 5.86, 9.375, 13.39], abs=0.003)
    assert (p.m, p.c, p.TR, p.w_high, p.w_low, p.g) == (1500, 0.7, 40, 500, 230, 9.81)
    assert (p.v0, p.v1, p.v2, p.t1, p.t2, p.t3, p.t4) == (30, 10, 25, 60, 100, 80, 95)
    assert p.hill == 0 and names["system_two"].values().hill == 0.05
    assert system.start["v"] == system.start["TI"] == 0 and system.mode == "gear 1"


def test_the_law_of_the_handbook(system):
    p, s = system.values(), system.S["gear 3"](22.0, 35.0, 30.0, 0.05, 20.0, 9.375)
    u = 9.375 * 8 + 35 + 0.7 / 20 * 22**2
    assert system.modes["gear 3"].flow(0.0, s, p) == pytest.approx(
        [20 * u / M - 0.7 / M * 22**2 - G * sin(0.05), 9.375 / 40 * 8], rel=1e-13
    )


def test_up_shifts_of_the_reading(system):
    run = simulate(system, 60.0)
    assert [t for t, _ in shifts(run)] == pytest.approx([3.105, 5.411, 11.229], abs=5e-4)
    assert [q for _, q in shifts(run)] == [2, 3, 4]


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize("hill", [0.0, 0.05, 0.07])
def test_every_shift_and_the_end_against_matrix_exponentials(system, hill, kept):
    run = simulate(system, 160.0, hill=hill, bumpless=float(kept))
    found, (t, v, F) = reference(hill, kept)
    assert [q for _, q in shifts(run)] == [q for _, q in found]
    assert [t for t, _ in shifts(run)] == pytest.approx([t for t, _ in found], abs=1e-6)
    assert run.t[-1] == pytest.approx(t, abs=1e-6)
    assert run.final["v"] == pytest.approx(v, abs=1e-6)
    assert run.final["TI"] * run.final["pr"] == pytest.approx(F, abs=1e-4)
    if hill == 0.05:
        assert run.ended == ("finished" if kept else "terminal event")


def test_the_torque_jumps_and_the_force_does_not(system):
    run = simulate(system, 160.0)
    for e in run.events:
        if e.transition in ("up", "down"):
            here, there = run.at(e.t, side="before"), run.at(e.t, side="after")
            assert there["TI"] * there["pr"] == pytest.approx(here["TI"] * here["pr"], rel=1e-12)
            assert abs(there["a"] - here["a"]) < 1e-9 < abs(there["TI"] - here["TI"])


def test_a_kept_torque_jumps_the_acceleration_by_the_change_of_ratio(system):
    run = simulate(system, 60.0, bumpless=0.0)
    for e in (e for e in run.events if e.transition == "up"):
        jump = run.at(e.t, side="after")["a"] - run.at(e.t, side="before")["a"]
        change = e.after["pr"] - e.before["pr"]
        assert jump == pytest.approx(change * e.before["TI"] / M, rel=1e-9) and jump < 0


def test_overshoot_in_closed_form(system):
    """Roots −(5 ∓ √5)/80, whose quotient is φ²; the peak where the two slopes cancel."""
    s1, s2 = -(5 - sqrt(5)) / 80, -(5 + sqrt(5)) / 80
    b = (30 / 8 + s1 * 30) / (s1 - s2)  # e = a exp(s1 t) + b exp(s2 t), e' = −30/8 at first
    a = 30 - b
    t = log(-s2 * b / (s1 * a)) / (s1 - s2)
    peak = 30 - a * np.exp(s1 * t) - b * np.exp(s2 * t)
    run = simulate(system, 60.0, points=np.linspace(30, 40, 10_001))
    assert run["v"].max() == pytest.approx(peak, abs=1e-6)
    assert load(NAME)["overshoot"] == pytest.approx(peak - 30, rel=1e-12)
    assert load(NAME)["top"] == pytest.approx(t, rel=1e-12)


@pytest.mark.parametrize("TR", [8.0, 40.0, 120.0])
def test_the_area_between_speed_and_set_point_vanishes(system, TR):
    run = simulate(system, 3000.0, TR=TR, t1=499.0, t2=500.0, v1=30.0, v2=30.0, keep=1.0,
                   points=300_001)  # fmt: skip
    area = np.trapezoid(30 - run["v"], run.t)
    assert abs(area) < 0.02 < run["v"].max() - 30


def test_hunting_begins_where_the_gap_of_the_limits_is_that_of_the_gears(system):
    assert load(NAME)["low_limit"] == 312.5
    calm = simulate(system, 60.0, w_low=312.4, max_events=200)
    mad = simulate(system, 60.0, w_low=312.6, max_events=200)
    assert calm.ended == "finished" and mad.ended != "finished" and mad.t[-1] < 6


def test_late_shifts_touch_the_speed_only_without_bumpless_transfer(system):
    end = (expm(matrix(30.0) * 50.0) @ [0, 0, 1])[0]
    late = simulate(system, 50.0, method="RK4", step=1.0, locate=False)
    assert late.final["v"] == pytest.approx(end, abs=1e-5) and late["omega"].max() > 510
    kept = {"method": "RK4", "step": 1.0, "bumpless": 0.0}
    told, not_told = (simulate(system, 50.0, locate=x, **kept).final["v"] for x in (True, False))
    assert abs(told - not_told) > 0.01


def test_a_long_hill_is_held_and_forgotten_by_a_reset(system):
    """In the end the force is m g sin d; T_I = 0 brings the same sag back."""
    where = {"v0": 10.0, "v1": 10.0, "t1": 400.0, "t3": 100.0, "t4": 500.0, "t2": 500.0}
    run = simulate(system, 499.0, hill=0.05, points=4991, **where)
    held = run.at(400.0, side="before")
    assert held["v"] == pytest.approx(10.0, abs=1e-3)
    assert held["TI"] * held["pr"] == pytest.approx(M * G * sin(0.05), rel=1e-3)
    sag = 10 - run["v"][run.t > 400].min()
    s1, s2 = (
        -(5 - sqrt(5)) / 80,
        -(5 + sqrt(5)) / 80,
    )  # their peak: g sin d (e^s1t − e^s2t)/(s1 − s2)
    t = log(s2 / s1) / (s1 - s2)
    depth = G * sin(0.05) * (np.exp(s1 * t) - np.exp(s2 * t)) / (s1 - s2)
    assert sag == pytest.approx(depth, abs=0.003)


def test_tasks():
    found = load(NAME)["solutions"]
    assert found["swing"] == 32.0 and found["hunting"] == 320.0
    s = np.roots([1, 1 / 8, 1 / 800])  # T_R = 100
    s1, s2 = max(s.real), min(s.real)
    b = 30 * (1 / 8 + s1) / (s1 - s2)
    t = log(-s2 * b / (s1 * (30 - b))) / (s1 - s2)
    assert found["calmer"] == pytest.approx(
        -(30 - b) * np.exp(s1 * t) - b * np.exp(s2 * t), abs=1e-4
    )
    assert 0.05 < found["steep"] < pi / 8 and reference(found["steep"] + 1e-4)[1][0] < 100


def test_printed_gains_break_the_rule_a_little(system):
    run = simulate(system, 60.0, k2=5.86, k4=13.39)
    jumps = [run.at(t, side="after")["a"] - run.at(t, side="before")["a"] for t, _ in shifts(run)]
    expected = [(32 * 5.86 - K) * 20, (K - 32 * 5.86) * 14.375, (14 * 13.39 - K) * 5]
    assert jumps == pytest.approx(np.array(expected) / M, abs=1e-9)
