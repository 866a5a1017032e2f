"""Assignment 3.2 on the notebook's own models.

Against SciPy from swap to swap with the phases as formulas, and against the closed form of one
job; who is destroyed by which control; the comb; the accumulated phase; the swaps told and not.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from labkit import simulate

NAME = "part3/02_unbalanced_rotor"
TIGHT = {"rtol": 1e-12}
SECOND = {"k": 0.5, "begin": 10.0}


def turn(t, tw, c, ramp=10.0):
    """By how much time the rotor has turned at its nominal speed: the integral of the rate."""
    u = t - tw
    if u <= 0:
        return t
    return t + c / 100 * (u * u / (2 * ramp) if u < ramp else u - ramp / 2)


def by_scipy(k, c, t_end, W=40.0, D=200.0):
    """(warning, destruction or None, q at the end), times from the start of the machine."""
    t, y, tw, job = 0.0, np.zeros(2), math.inf, 0
    while t < t_end:
        stop = min(50.0 * (job + 1), t_end)
        if tw < math.inf and t < tw + 10 < stop:
            stop = tw + 10

        def flow(s, y, tw=tw, job=job):
            r = turn(s, tw, c)
            Q = 3 * math.cos(0.5 * r) if job % 2 else 2 * math.sin(0.3 * r)
            return [y[1], Q - k * k * y[0]]

        level = W if tw == math.inf else D

        def pass_level(s, y, level=level):
            return abs(y[0]) - level

        pass_level.direction, pass_level.terminal = 1, True
        found = solve_ivp(
            flow,
            (t, stop),
            y,
            method="DOP853",
            rtol=1e-12,
            atol=1e-11,
            max_step=0.5,
            events=pass_level,
        )
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1 and level == D and tw < math.inf:
            return tw, t, y[0]
        if found.status == 1:
            tw = t
        elif t == 50.0 * (job + 1):
            job += 1
    return tw, None, y[0]


def test_values(names, system):
    p, p2 = system.values(), names["system_two"].values()
    assert (p.k, p.H1, p.H2, p.omega1, p.omega2, p.a, p.T) == (0.4, 2, 3, 0.3, 0.5, 1, 50)
    assert (p.W, p.D, p.c, p.Tr, p.begin) == (40, 200, -10, 10, 0)
    assert (p2.k, p2.begin) == (0.5, 10) and names["horizon"] == names["horizon_two"] == 600
    assert simulate(names["system_two"], 9.0).final["q"] == 0


@pytest.mark.parametrize("c", [-10.0, 0.0, 5.0])
@pytest.mark.parametrize(("k", "begin"), [(0.4, 0.0), (0.5, 10.0)])
def test_against_scipy(system, k, begin, c):
    run = simulate(system, 400.0 + begin, k=k, begin=begin, c=c, **TIGHT)
    tw, end, q = by_scipy(k, c, 400.0)
    assert run.events["warning"].t[0] - begin == pytest.approx(tw, abs=1e-7)
    assert (run.stopped == 'terminal event "destroyed"') == (end is not None)
    if end is not None:
        assert run.t[-1] - begin == pytest.approx(end, abs=1e-6)
    assert run.final["q"] == pytest.approx(q, abs=1e-6)


@pytest.mark.parametrize("k", [0.4, 0.65])
def test_one_job_is_the_closed_form(system, k):
    """H/(k² − ω²)·(sin ωt − ω/k·sin kt) until the first swap, without a warning."""
    run = simulate(system, 50.0, k=k, W=190.0, **TIGHT)
    w, t = 0.3, run.t
    exact = 2 / (k * k - w * w) * (np.sin(w * t) - w / k * np.sin(k * t))
    assert np.abs(run["q"] - exact).max() < 1e-8


def test_resonance_grows_by_half_the_force_over_k(system):
    """Job 2 alone, ω2 = k: q = H2/(2k)·t·sin kt, when it comes first."""
    start = {"b": 0.0}
    run = simulate(system, 50.0, k=0.5, c=0.0, D=400.0, start=start, **TIGHT)
    assert np.abs(run["q"] - 3 / (2 * 0.5) * run.t * np.sin(0.5 * run.t)).max() < 1e-7


def test_who_is_destroyed(names, system):
    """The printed rule destroys machine 1, which would survive, and saves machine 2."""
    for values, c, lost in (
        ({}, 0.0, False),
        ({}, -10.0, True),
        ({}, 5.0, False),
        (SECOND, 0.0, True),
        (SECOND, -10.0, False),
        (SECOND, 5.0, False),
    ):
        assert names["destroyed"](simulate(system, 600.0, c=c, **values)) == lost, (values, c)
    for values in ({}, SECOND):  # warned at 90 cm both survive the same rule
        assert not names["destroyed"](simulate(system, 600.0, W=90.0, **values))


def test_with_80_cm_nothing_keeps_both(names):
    one, two = (names["peaks"][name] for name in ("machine 1", "machine 2"))
    assert not np.any((one < 80) & (two < 80)) and np.any(one < 80)
    assert np.sum((one < 200) & (two < 200)) > 20


def test_frequencies_and_phases_in_a_change(system):
    """θ' = ω: the angle is the integral of the rate, through swaps and the change."""
    run = simulate(system, 150.0, c=20.0, D=400.0, **TIGHT)
    tw = run.events["warning"].t[0]
    for t in (20.0, 30.0, 49.0, 80.0, 149.0):
        at = run.at(t)
        assert at["theta1"] == pytest.approx(0.3 * turn(t, tw, 20.0), abs=1e-9)
        assert at["theta2"] == pytest.approx(0.5 * turn(t, tw, 20.0), abs=1e-9)
        assert at["b"] == (t // 50 + 1) % 2


def test_the_warning_comes_once(system):
    run = simulate(system, 600.0, c=5.0)
    assert len(run.events["warning"].t) == len(run.events["done"].t) == 1
    assert run.events["done"].t[0] - run.events["warning"].t[0] == pytest.approx(10.0, abs=1e-9)
    assert len(run.events["swap"].t) == 12


@pytest.mark.parametrize(("machine", "k"), [(1, 0.4), (2, 0.5)])
def test_the_hills_stand_on_the_comb(names, machine, k):
    """Where a tooth meets k, |q| has a maximum near it."""
    peak, changes = names["peaks"][f"machine {machine}"], names["changes"]
    for w, n in ((0.5, 0), (0.5, -1), (0.5, 1), (0.3, 1)):
        at = 100 * ((k - n * math.pi / 50) / w - 1)
        if abs(at) > 25:
            continue
        near = np.abs(changes - at) < 4
        top = changes[near][np.argmax(peak[near])]
        assert abs(top - at) <= 1.0 and peak[near].max() > 400


def test_a_side_tooth_grows_as_the_comb_says(system, names):
    free = names["system_free"]
    run = simulate(free, 5000.0, c=100 * (math.pi / 50) / 0.5, points=50, **SECOND)
    assert run["A"][-1] / 5000 == pytest.approx(3 / math.pi / (2 * 0.5), rel=0.01)


def test_the_wrong_phase(names):
    """cos(ω(t)·t) nearly stops the rotor for ten seconds."""
    tw = names["run_two"].events["warning"].t[0] - 10
    lowest = 0.5 * (0.9 - 0.01 * (tw + 10))
    assert names["lowest"] == pytest.approx(lowest, abs=1e-9) and 0 < lowest < 0.1
    right, wrong = (
        simulate(one, 200.0, **SECOND, **TIGHT).final["q"]
        for one in (names["system"], names["system_trap"])
    )
    assert abs(right - wrong) > 10


def test_told_and_not_told(names):
    """RK4 keeps its order only where the swaps are a schedule."""
    goal = by_scipy(0.4, 0.0, 200.0, W=1e3, D=1e3)[2]
    errors = {}
    for name in ("told", "untold"):
        errors[name] = [
            abs(simulate(names[name], 200.0, method="RK4", step=h).final["q"] - goal)
            for h in (0.25, 0.125)
        ]
    assert 3.8 < math.log2(np.divide(*errors["told"])) < 4.2
    assert math.log2(np.divide(*errors["untold"])) < 1.5 and min(errors["untold"]) > 1e-3


def test_answers_of_the_tasks(names, system):
    right = names["solutions"]
    t = np.arange(0, 600.001, 0.25)
    alone = names["heights"](system.values({"c": 0.0}), t, np.inf)
    assert right["level"] == pytest.approx(np.abs(alone).max(), rel=5e-3)
    assert right["tooth"] == pytest.approx(12.566, abs=1e-3)
    assert right["growth"] == pytest.approx(0.95493, abs=1e-5)

    def over(c):  # the highest peak of machine 2, over the limit; its place moves little
        run = simulate(names["system_free"], 600.0, c=c, points=40_000, **SECOND)
        return np.abs(run["q"]).max() - 200

    assert right["raise"] == pytest.approx(brentq(over, 4.0, 5.0, xtol=1e-4), abs=2e-3)
