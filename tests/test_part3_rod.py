"""Assignment 3.11 on the notebook's own models.

A parameter that swings: resonance, two clocks, readings of s. The reference is SciPy, piece by
piece, with the equations written once more.
"""

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labkit import simulate

NAME = "part3/11_rod_and_pendulum"
TIGHT = {"rtol": 1e-11, "atol": 1e-15}


@cache
def rod(omega, end, reading="printed", x_max=math.inf):
    """(t, x, v, θ) at the end, or where |x| comes to x_max: cut at all multiples of 20 and 30 s."""
    read = {
        "printed": lambda s: s,
        "size of s": abs,
        "about the middle": lambda s: 2.5 + s,
    }[reading]
    cuts = sorted({*np.arange(0, end, 20.0), *np.arange(0, end, 30.0), end})
    y = [0.1, 0.0, 0.0]
    for start, stop in zip(cuts, cuts[1:], strict=False):
        twenty, thirty = int(start // 20), int(start // 30)
        f = 1.0 if twenty == 0 else 0.6 if twenty % 2 else 1.4

        def flow(t, y, f=f, thirty=thirty):
            s = read(2 * math.sin(y[2]) if thirty % 2 else 1.5 * math.cos(y[2]))
            return y[1], -3 * y[0] / (5 * (5 - s) ** 2), f * omega

        def limit(t, y):
            return abs(y[0]) - x_max

        limit.terminal = True
        done = solve_ivp(
            flow, (start, stop), y, method="DOP853", rtol=1e-11, atol=1e-14,
            events=limit if x_max < math.inf else None, max_step=2.0,
        )  # fmt: skip
        y = done.y[:, -1]
        if done.status == 1:
            return done.t[-1], *y
    return end, *y


def test_handbook_values(names):
    p = names["system"].values()
    assert (p.omega, p.H1, p.H2, p.l, p.EJ, p.m, p.x_max) == (1, 1.5, 2, 5, 1, 1, 3)
    assert (p.d, p.T_w, p.T_s, p.s0, p.fold) == (0.4, 20, 30, 0, 0)
    assert names["system"].start == {"x": 0.1, "v": 0.0, "theta": 0.0, "f": 1.0}
    assert names["horizon"] == names["horizon_two"] == 600.0


def test_the_clocks_and_the_phase(names):
    """1, then 0.6 and 1.4 every 20 s; cosine and sine every 30 s; the phase does not jump."""
    run = simulate(names["free"], 250.0)
    phase = 0.0
    for second in range(250):
        t = second + 0.5
        k = int(t // 20)
        f = 1.0 if k == 0 else 0.6 if k % 2 else 1.4
        at = run.at(t)
        assert at["f"] == f and at["mode"] == ("sine" if int(t // 30) % 2 else "cosine")
        assert at["theta"] == pytest.approx(phase + 0.5 * f, abs=1e-9)
        s = 2 * math.sin(at["theta"]) if at["mode"] == "sine" else 1.5 * math.cos(at["theta"])
        assert at["s"] == pytest.approx(s, abs=1e-12)
        phase += f


@pytest.mark.parametrize(
    ("omega", "reading", "change"),
    [(1.0, "printed", {}), (0.3, "printed", {}), (0.65, "printed", {}),
     (0.3, "size of s", {"fold": 1.0}), (0.2, "about the middle", {"s0": 2.5})],
)  # fmt: skip
def test_runs_against_scipy(names, omega, reading, change):
    _, x, v, theta = rod(omega, 240.0, reading)
    run = simulate(names["free"], 240.0, omega=omega, **TIGHT, **change)
    assert run["theta"][-1] == pytest.approx(theta, abs=1e-8)
    assert run["x"][-1] == pytest.approx(x, abs=1e-6 * max(1, abs(x)))
    assert run["v"][-1] == pytest.approx(v, abs=1e-6 * max(1, abs(x)))


@pytest.mark.parametrize(
    ("omega", "reading", "change", "instant"),
    [(0.3, "printed", {}, 250.3), (1.0, "about the middle", {"s0": 2.5}, 35.41)],
)
def test_instants_of_destruction(names, omega, reading, change, instant):
    run = simulate(names["system"], 600.0, omega=omega, **TIGHT, **change)
    assert run.stopped == 'terminal event "destroyed"'
    assert run.t[-1] == pytest.approx(instant, abs=0.05)
    assert run.t[-1] == pytest.approx(rod(omega, 600.0, reading, 3.0)[0], abs=1e-6)


def test_the_handbooks_rod_survives(names):
    run = simulate(names["system"], 600.0, points=6001)
    assert run.ended == "finished" and np.abs(run["x"]).max() == pytest.approx(0.147, abs=5e-4)


def test_area_is_kept(names):
    a, b = (
        simulate(names["free"], 600.0, start={"x": x, "v": v}, **TIGHT)
        for x, v in ((1.0, 0.0), (0.0, 1.0))
    )
    assert np.abs(a["x"] * b["v"] - b["x"] * a["v"] - 1).max() < 1e-8


def test_linear_and_without_a_push_nothing(names):
    one, two = (
        simulate(names["free"], 300.0, omega=0.3, start={"x": x}, **TIGHT) for x in (0.1, 0.2)
    )
    assert np.allclose(2 * one["x"], two["x"], rtol=1e-8, atol=1e-10)
    assert not simulate(names["free"], 300.0, omega=0.3, start={"x": 0.0})["x"].any()


@pytest.mark.parametrize("H", [0.1, 0.25, 0.5])
def test_the_main_tongue_has_the_rate_of_mathieus_equation(names, H):
    """ω0 H/2l for small H, at twice the own frequency; the multiplier by SciPy."""
    own = math.sqrt(3 / 125)
    T = math.pi / own
    columns = [
        solve_ivp(
            lambda t, y: (y[1], -3 * y[0] / (5 * (5 - H * math.cos(2 * own * t)) ** 2)),
            (0, T), start, rtol=1e-12, atol=1e-14, method="DOP853",
        ).y[:, -1]
        for start in ((1.0, 0.0), (0.0, 1.0))
    ]  # fmt: skip
    mu = np.abs(np.linalg.eigvals(np.transpose(columns))).max()
    found = names["by_monodromy"](2 * own, H)
    assert found == pytest.approx(math.log(mu) / T, rel=1e-6)
    assert found == pytest.approx(own * H / 10, rel=0.1 * H)
    assert columns[0][0] == pytest.approx(columns[1][1], abs=1e-9)  # s is even


def test_the_map_of_steady_shaking_is_floquets(names):
    chart, w = names["chart"], names["frequencies"]
    for k in range(5, 111, 15):
        H = names["sizes"][11]
        y = solve_ivp(
            lambda t, y, w=w[k], H=H: (y[1], -3 * y[0] / (5 * (5 - H * math.cos(w * t)) ** 2)),
            (0, 2 * math.pi / w[k]), (1.0, 0.0), rtol=1e-10, atol=1e-12,
        ).y  # fmt: skip
        assert chart.values[k, 11] == pytest.approx(y[0, -1], abs=1e-5)


def test_two_clocks_at_one_instant(names):
    """A program that lets only one of them strike loses a change of frequency, and the verdict."""
    assert names["careless"].ended == "finished" and names["slow"].ended != "finished"
    after = [one.at(61.0)["f"] for one in (names["slow"], names["careless"])]
    assert after == [0.6, 1.4]


def test_teeth(names):
    g = names["maps"]["as printed"]
    lost = g.axes["omega"][g.values > 30]
    assert lost.min() == pytest.approx(0.185, abs=0.01) and 0.1 < (g.values > 30).mean() < 0.3
    assert (g.values[(g.axes["omega"] > 0.9)] < 30).all()


def test_answers_of_the_tasks(names):
    right = names["solutions"]
    assert right["start"] == pytest.approx(2.041, abs=0.005)
    gain = simulate(names["free"], 600.0, points=60_001, **TIGHT)["x"]
    assert right["start"] == pytest.approx(0.3 / np.abs(gain).max(), rel=1e-5)
    assert right["half"] == pytest.approx(rod(0.3, 600.0, "printed", 6.0)[0], abs=1e-4)
    assert right["rate"] == pytest.approx(math.sqrt(3 / 125) * 0.05, rel=0.05)
