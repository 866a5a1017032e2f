"""part3/00_ball_on_spring against the closed form of each piece, and its claims."""

import math

import numpy as np
import pytest

from labkit import Ended, simulate

from .helpers import load

NAME = "part3/00_ball_on_spring"
G, K, HS = 9.81, 10.8, 5.5


def exact(t, H=10.0, K=K):
    """(y, v) after t seconds from rest at H: the period, and within it parabola or sine."""
    v1, w = math.sqrt(2 * G * (H - HS)), math.sqrt(K)
    fall, rest = v1 / G, HS - G / K
    # y − rest = A cos(w s) + B sin(w s) from the touch on, until y = HS again
    A, B = G / K, -v1 / w
    stay = (2 * math.pi + 2 * math.atan2(B, A)) / w
    t = t % (2 * fall + stay)
    if t < fall:
        return H - G * t * t / 2, -G * t
    if t > fall + stay:
        back = 2 * fall + stay - t
        return H - G * back * back / 2, G * back
    s = w * (t - fall)
    return (
        rest + A * math.cos(s) + B * math.sin(s),
        w * (B * math.cos(s) - A * math.sin(s)),
    )


def test_the_motion_is_the_exact_one_and_keeps_its_energy():
    names = load(NAME)
    system, horizon = names["system"], names["horizon"]
    p = system.values()
    assert horizon == 10 and [p.g, p.K, p.Hs] == [G, K, HS] and system.start == {"y": 10, "v": 0}
    run = simulate(system, horizon, rtol=1e-11)
    for t in np.linspace(0, horizon, 57):
        found = run.at(t)
        assert [found["y"], found["v"]] == pytest.approx(exact(t), abs=1e-7)
    assert len(run.events) == 6 and np.ptp(run["E"]) < 1e-7
    assert run["E"][0] == pytest.approx(98.1)
    assert np.abs(run["v"]).max() == pytest.approx(9.86, abs=5e-3)


def test_the_numbers_of_theory_are_those_of_the_exact_motion():
    names = load(NAME)
    for H in (5.7, 10.0, 14.0):
        v1, fastest, lowest, contact, period = names["theory"](H, names["system"].values())
        t = np.linspace(0, period, 100_001)
        y, v = np.array([exact(each, H) for each in t]).T
        assert fastest == pytest.approx(np.abs(v).max(), rel=1e-6)
        assert lowest == pytest.approx(y.min(), rel=1e-6)
        assert contact == pytest.approx(period * np.mean(y < HS), rel=1e-4)
        assert v1**2 == pytest.approx(2 * G * (H - HS))
    assert np.allclose(names["found"], names["right"], rtol=1e-6)
    contacts = [names["theory"](H, names["system"].values())[3] for H in (5.6, 6, 8, 10, 14)]
    assert np.all(np.diff(contacts) < 0)  # harder is shorter


def test_it_ends_where_the_spring_is_pressed_flat():
    names = load(NAME)
    height = K * HS**2 / 2 / G
    assert names["solutions"]["flat"] == pytest.approx(height)
    run = simulate(names["system"], 10.0, start={"y": height + 0.5})
    assert run.ended is Ended.TERMINAL and run.final["y"] == pytest.approx(0, abs=1e-9)
    assert run.final["v"] == pytest.approx(-math.sqrt(2 * G * 0.5), rel=1e-6)
    assert simulate(names["system"], 10.0, start={"y": height - 0.1}).ended is Ended.FINISHED


def test_not_told_of_the_kink_a_method_loses_its_order():
    names = load(NAME)
    assert names["order"]["told"] > 3.5 > 3 > names["order"]["not told"] > 1.5
    truth = exact(10.0)
    assert [names["truth"]["y"], names["truth"]["v"]] == pytest.approx(truth, abs=1e-9)
    assert names["drift"]["Euler"][1] < 0 < names["drift"]["RK4"][1]


def test_the_tangent_misses_the_touch_by_its_formula():
    """One Newton step from τ before a fall of 4.5 m: τ²/(2(t1 − τ)) for y − Hs."""
    names = load(NAME)
    t1 = math.sqrt(9.0 / G)
    for tau in (0.1, 0.01):
        right = tau**2 / (2 * (t1 - tau))
        assert names["miss"](lambda d: d, tau) == pytest.approx(right, rel=1e-4)
        cubed = tau - tau * (1 - tau / (2 * t1)) / (1 - tau / t1) / 3  # a third of the way
        assert names["miss"](lambda d: d**3, tau) == pytest.approx(cubed, rel=1e-3)


def test_with_the_other_reading_the_largest_speed_is_that_of_the_touch():
    fastest = load(NAME)["fastest"]
    assert fastest[0.0] == pytest.approx(math.sqrt(2 * G * 4.5), abs=2e-3)
    assert fastest[9.81] == pytest.approx(math.sqrt(2 * G * 4.5 + G**2 / K), abs=2e-3)
