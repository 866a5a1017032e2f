"""part3/00_torn_pendulum against closed forms: elliptic integrals before, parabolas after."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from labkit import simulate

from .helpers import load

NAME = "part3/00_torn_pendulum"
G = 9.81


def time_to(theta, L=2.0):
    """Seconds from rest at π/2 down to theta: ∫ dθ/√(2 (g/L) cos θ), with θ = π/2 − z²."""
    return quad(
        lambda z: 2 * z / math.sqrt(2 * G / L * math.sin(z * z)) if z else math.sqrt(2 * L / G),
        0,
        math.sqrt(math.pi / 2 - theta),
        epsabs=1e-13,
    )[0]


def landing(theta, way, L=2.0, floor=4.0, factor=1.0):
    """(seconds of flight, x) from a release at theta, moving down (-1) or up (+1)."""
    speed = factor * way * math.sqrt(2 * G * L * math.cos(theta))
    vx, vy = speed * math.cos(theta), speed * math.sin(theta)
    x, y = L * math.sin(theta), -L * math.cos(theta)
    t = (vy + math.sqrt(vy**2 + 2 * G * (y + floor))) / G
    return t, x + vx * t


def test_it_tears_at_the_angle_of_the_closed_form_and_lands_where_the_parabola_says():
    names = load(NAME)
    system, horizon = names["system"], names["horizon"]
    p = system.values()
    assert horizon == 4 and [p.L, p.m, p.Tc, p.g] == [2, 1, 25, G]
    assert system.start == {"theta": math.pi / 2, "omega": 0}
    run = simulate(system, horizon, rtol=1e-11)
    angle = math.acos(25 / (3 * G))
    tear = run.events[0]
    assert tear.before["theta"] == pytest.approx(angle, abs=1e-9)
    assert tear.t == pytest.approx(time_to(angle), abs=1e-8)
    speed = math.sqrt(2 * G * 2 * math.cos(angle))
    after = [tear.after[key] for key in ("x", "y", "vx", "vy")]
    assert after == pytest.approx(
        [
            2 * math.sin(angle),
            -2 * math.cos(angle),
            -speed * math.cos(angle),
            -speed * math.sin(angle),
        ],
        abs=1e-8,
    )
    flight, x = landing(angle, -1)
    assert [run.t[-1], run.final["x"]] == pytest.approx([tear.t + flight, x], abs=1e-7)
    assert np.ptp(run["E"]) < 1e-8


def test_each_variable_lives_in_its_mode_only():
    run = load(NAME)["run"]
    flies = run.mode == "flight"
    assert 0 < flies.sum() < len(flies)
    assert np.array_equal(np.isnan(run["theta"]), flies)
    assert np.array_equal(np.isnan(run["x"]), ~flies)
    assert not np.isnan(run["X"]).any()


def test_the_cut_on_the_way_up():
    names = load(NAME)
    run = simulate(names["system_two"], names["horizon_two"], rtol=1e-11)
    half = 2 * time_to(0.0)  # to the turn on the left
    back = half + 2 * time_to(0.0) - time_to(math.pi / 4)
    assert run.events[0].t == pytest.approx(back, abs=1e-8)
    assert run.events[0].t == pytest.approx(2.777, abs=5e-4)
    assert run.final["x"] == pytest.approx(landing(math.pi / 4, +1)[1], abs=1e-7)
    angles = np.arange(10.0, 71.0)
    far = [landing(math.radians(angle), +1)[1] for angle in angles]
    assert names["best"] == angles[np.argmax(far)] < 45
    assert np.allclose(names["distances"], far, rtol=0, atol=1e-6)


def test_the_pull_is_three_weights_at_most_whatever_the_length():
    names = load(NAME)
    for L in (0.7, 2.0, 3.0):
        run = simulate(names["system"], 8.0, L=L, Tc=60.0, points=8001)
        assert run["T"].max() == pytest.approx(3 * G, rel=1e-5)
        torn = simulate(names["system"], 8.0, L=L).events[0]
        assert math.cos(torn.before["theta"]) == pytest.approx(25 / (3 * G), abs=1e-7)
    assert names["solutions"]["limit"] == pytest.approx(3 * G)


def test_as_printed_the_factor_is_missing_in_speed_and_energy():
    names = load(NAME)
    angle = math.acos(25 / (3 * G))
    for L, word, gained, x in names["rows"]:
        factor = 1 / L if word == "as printed" else 1.0
        kinetic = G * L * math.cos(angle)
        assert gained == pytest.approx(kinetic * (factor**2 - 1), abs=1e-5)
        assert x == pytest.approx(landing(angle, -1, L, factor=factor)[1], abs=1e-5)


def test_noticed_late_the_landing_is_of_first_order():
    names = load(NAME)
    order = names["order"]
    assert order["located"] > 3 and 0.6 < order["noticed at the end of a step"] < 1.7


def test_a_pull_that_is_too_large_at_the_start_tears_at_once():
    run = simulate(load(NAME)["system"], 4.0, Tc=5.0, start={"theta": 0.3})
    assert run.events[0].t == 0 and run.events[0].target == "flight"
    assert run.final["x"] == pytest.approx(2 * math.sin(0.3))
