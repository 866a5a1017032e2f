"""Assignment 3.1 on the notebook's own model.

Speeds, instants and the pool against closed forms and against SciPy in one Cartesian frame; the
force and its peak; what ends a run; late events; the errors of the handbook.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labkit import simulate

NAME = "part3/01_water_slide"
TIGHT = {"rtol": 1e-12, "points": 20}
CASES = [
    {},
    {"beta": 25.0},
    {"beta": 50.0, "r": 3.0, "kw": 0.8},
    {"alpha": 20.0, "L": 33.0, "k": 0.2, "H": 1.0},
    {"k": 0.0, "m": 110.0, "g": 3.7},
]


def by_hand(p):
    """v1², v2², velocity at the lip, time of flight: the facts of the assignment, once more."""
    A, B = math.radians(p.alpha), math.radians(p.beta)
    square = 2 * p.g * math.sin(A) * p.L
    if p.k:
        square = p.g * math.sin(A) / p.k**2 * (1 - math.exp(-2 * p.k**2 * p.L))
    later = square + 2 * p.g * p.r * (math.cos(B) - math.cos(A))
    speed = math.sqrt(max(later, 0.0))
    vx, vy = speed * math.cos(B), speed * math.sin(B)
    return square, later, vx, max(np.roots([-p.g / 2, vy, p.H]).real)


def in_one_frame(p):
    """Times of bend, lip and splash and the place of the splash, by SciPy in X and Y."""
    A, B = math.radians(p.alpha), math.radians(p.beta)
    centre = np.array([-p.r * math.sin(B), p.H + p.r * math.cos(B)])
    bend = centre + p.r * np.array([-math.sin(A), -math.cos(A)])
    start = bend + p.L * np.array([-math.cos(A), math.sin(A)])

    def slope(t, y):
        pull = p.g * math.sin(A) - p.k**2 * (y[2] ** 2 + y[3] ** 2)
        return [y[2], y[3], pull * math.cos(A), -pull * math.sin(A)]

    def arc(t, y):
        inward = (centre - y[:2]) / p.r
        force = (y[2] ** 2 + y[3] ** 2) / p.r + p.g * inward[1]
        return [y[2], y[3], force * inward[0], force * inward[1] - p.g]

    def air(t, y):
        return [y[2], y[3], 0.0, -p.g]

    times, y, t = [], np.array([*start, 0.0, 0.0]), 0.0
    for flow, place, sign in (
        (slope, lambda t, y: y[0] - bend[0], 1),
        (arc, lambda t, y: y[0], 1),
        (air, lambda t, y: y[1], -1),
    ):
        place.terminal, place.direction = True, sign
        found = solve_ivp(flow, (t, 60), y, method="DOP853", rtol=1e-12, atol=1e-12, events=place)
        t, y = found.t[-1], found.y[:, -1]
        times.append(t)
    return times, y[0]


def test_values(names, system):
    p = system.values()
    assert (p.m, p.L, p.alpha, p.k, p.r, p.beta, p.H, p.kw) == (70, 20, 35, 0.05, 8, 0, 5, 2)
    assert names["run"].stopped == 'terminal event "after 3 s"'
    splash = names["run"].events["splash"].t[0]
    assert names["run"].t[-1] - splash == pytest.approx(3.0, abs=1e-9)


@pytest.mark.parametrize("change", CASES)
def test_speeds_and_pool(names, system, change):
    run = simulate(system, 60.0, P=150.0, **TIGHT, **change)
    v1, v2, vx, T = by_hand(run.p)
    bend, lip, splash = (run.events[name] for name in ("bend", "lip", "splash"))
    assert bend.before["v"][0] ** 2 == pytest.approx(v1, rel=1e-10)
    assert (run.p.r * lip.before["w"][0]) ** 2 == pytest.approx(v2, rel=1e-10)
    assert splash.t[0] - lip.t[0] == pytest.approx(T, rel=1e-10)
    assert splash.after["X"][0] == pytest.approx(vx * T, rel=1e-10)
    need = vx * T + vx / run.p.kw
    assert names["reach"](run) == pytest.approx(need, rel=1e-10)
    assert names["theory"](run.p)[3] == pytest.approx(need, rel=1e-12)
    assert run.final["X"] == pytest.approx(need - vx / run.p.kw * math.exp(-3 * run.p.kw), rel=1e-9)


@pytest.mark.parametrize("change", CASES)
def test_against_one_frame(system, change):
    run = simulate(system, 60.0, P=150.0, **TIGHT, **change)
    times, landed = in_one_frame(run.p)
    assert [e.t for e in run.events][:3] == pytest.approx(times, abs=1e-8)
    assert run.events["splash"].after["X"][0] == pytest.approx(landed, abs=1e-7)


@pytest.mark.parametrize("beta", [0.0, 20.0, 50.0])
def test_the_force_is_largest_at_the_lowest_point(names, system, beta):
    run = simulate(system, 60.0, beta=beta, P=150.0, rtol=1e-11, points=20_001)
    p, arc = run.p, run.mode == "arc"
    top = np.argmax(np.where(arc, run["N"], 0))
    assert run["phi"][top] == pytest.approx(math.radians(35), abs=2e-3)
    v1 = by_hand(p)[0]
    peak = p.m * (v1 / p.r + p.g * (3 - 2 * math.cos(math.radians(35))))
    assert run["N"][top] == pytest.approx(peak, rel=1e-5)
    assert names["theory"](p)[4] == pytest.approx(peak, rel=1e-12)
    assert run.at(1.0)["N"] == pytest.approx(70 * 9.81 * math.cos(math.radians(35)))


def test_the_mass_changes_no_motion(system):
    light, heavy = (simulate(system, 60.0, m=m, **TIGHT) for m in (30.0, 120.0))
    assert light.final == heavy.final and [e.t for e in light.events] == [e.t for e in heavy.events]


@pytest.mark.parametrize(
    ("change", "end"),
    [
        ({"P": 22.0}, "hits the wall"),
        ({"P": 10.0}, "flies past the pool"),
        ({"L": 5.0, "alpha": 10.0, "beta": 60.0, "r": 15.0}, "slides back"),
    ],
)
def test_what_ends_a_run(system, change, end):
    run = simulate(system, 60.0, **TIGHT, **change)
    assert run.stopped == f'terminal event "{end}"'
    if end == "slides back":  # the height of the turning point is that of the energy
        p, v1 = run.p, by_hand(run.p)[0]
        high = math.cos(math.radians(p.alpha)) - v1 / (2 * p.g * p.r)
        assert math.cos(math.radians(p.alpha) - run.final["phi"]) == pytest.approx(high, abs=1e-9)
    else:
        assert run.final["X"] == pytest.approx(run.p.P, abs=1e-9)


def test_the_worst_lip(names, system):
    """There the pool does not change to first order, and is shorter to both sides."""

    def need(beta):
        _, _, vx, T = by_hand(system.values({"beta": beta}))
        return vx * T + vx / 2

    worst = names["worst"]
    assert need(worst) == pytest.approx(names["longest"], rel=1e-12)
    assert abs(need(worst + 1e-3) - need(worst - 1e-3)) < 1e-7
    assert need(worst) > max(need(worst - 1), need(worst + 1)) and 29.5 < worst < 30.2


def test_the_map(names, system):
    pools = names["pools"]
    for row, column in ((0, 0), (6, 3), (24, 18), (13, 6)):
        beta, kw = pools.axes["beta"][row], pools.axes["kw"][column]
        _, _, vx, T = by_hand(system.values({"beta": beta, "kw": kw}))
        assert pools.values[row, column] == pytest.approx(vx * T + vx / kw, abs=1e-4)


def test_late_events(names):
    """Not told, a level lip errs to the safe side only; a lip of 30° to both."""
    level, tilted = names["signs"].values()
    assert level.min() > 0 and tilted.min() < -0.5 and tilted.max() > 0.5
    assert np.abs(names["sizes"]["RK4, located"]).max() < 1e-4


def test_the_printed_force(names, system):
    wrong = simulate(names["printed"], 30.0, **TIGHT)
    p, w = wrong.p, wrong.events["bend"].after["w"][0]
    assert wrong.at(wrong.events["bend"].t[0])["N"] == pytest.approx(
        p.m * w**2 + p.g * math.cos(math.radians(35))
    )


def test_one_frame_leaves_the_slide(names):
    """The same pool, but the lip is missed by the error of the solver."""
    run = simulate(names["system_two"], names["horizon_two"], rtol=1e-12)
    lip = run.events["lip"].after
    assert math.hypot(lip["X"][0], lip["Y"][0] - 5) < 1e-9
    assert run.final["X"] + run.final["vX"] / 2 == pytest.approx(names["pool"], abs=1e-8)
    coarse = simulate(names["system_two"], 30.0, method="RK45", rtol=1e-3).events["lip"].after
    assert math.hypot(coarse["X"][0], coarse["Y"][0] - 5) > 1e-4


def test_answers_of_the_tasks(names, system):
    right, p = names["solutions"], system.values()
    v1, v2, vx, T = by_hand(p)
    radius = v1 / (2 * p.g * math.cos(math.radians(35)))  # v1²/r = 2 g cos α
    assert right["gentle"] == pytest.approx(radius, rel=1e-9)
    for beta in right["limits"]:
        _, _, x, time = by_hand(system.values({"beta": beta}))
        assert x * time + x / 2 == pytest.approx(25.0, abs=1e-9)
    faster = math.sqrt(v2 + 9 * math.exp(-2 * p.k**2 * p.L))
    assert right["run-up"] == pytest.approx((faster - vx) * (T + 0.5), abs=1e-7)
    sunk = p.g * T / p.kw * (1 - math.exp(-3 * p.kw))
    assert right["depth"] == pytest.approx(sunk, abs=1e-6)
