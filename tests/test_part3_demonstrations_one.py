"""The demonstrations bouncing ball and switched circuit, on the notebooks' own models.

References are closed forms and matrix exponentials, written here from the equations.
"""

import math

import numpy as np
import pytest

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
