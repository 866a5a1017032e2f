"""Assignment 3.12 on the notebook's own models.

The limit is touched and never passed; the four readings; energy; true geometry; the weight.
"""

import math

import numpy as np
import pytest
from scipy.special import ellipkinc

from labkit import simulate

NAME = "part3/12_mass_beam_spring"
TIGHT = {"rtol": 1e-12, "atol": 1e-14}
R = math.sqrt(0.5)


def test_handbook_values(names, system):
    assert names["horizon"] == 100.0
    p = system.values()
    assert (p.m, p.c0, p.l, p.S, p.t1, p.r, p.kappa, p.lambda_) == (1, 1, 10, 2, 25, 0.5, 0, 1)
    run = simulate(system, 1.0)
    assert run.at(0.0) == pytest.approx(
        {
            "phi": 0,
            "w": p.S / (2 * p.m * p.l),
            "phi_max": p.S / (p.l * math.sqrt(p.c0 * p.m)),
            "A": 0.2,
            "mode": "whole",
        }
    )


@pytest.mark.parametrize("change", [{}, {"m": 1.7}, {"c0": 0.4}, {"l": 7.3, "S": 1.1}])
def test_the_limit_is_touched_and_not_passed_whatever_the_numbers(system, change):
    """Before the loss of mass φ = φmax sin ωt: it comes to the limit and survives."""
    p = system.values(change)
    omega, top = math.sqrt(p.c0 / (4 * p.m)), p.S / (p.l * math.sqrt(p.c0 * p.m))
    run = simulate(system, 25.0, t1=30.0, **TIGHT, **change)
    late = run.t > 0
    assert (
        run.stopped == "finished" and np.abs(run["phi"] - top * np.sin(omega * run.t)).max() < 1e-10
    )
    assert run.at(math.pi / (2 * omega))["phi"] == pytest.approx(top, abs=1e-11) and np.allclose(
        run["A"][late], top, rtol=0, atol=1e-10
    )


CASES = [(0, 1, 0.1417, 0.2828), (0, 0, 0.1417, 0.2), (1, 1, 0.2825, 0.2828), (1, 0, 0.2825, 0.2)]


@pytest.mark.parametrize(("kappa", "lambda_", "amplitude", "bound"), CASES)
def test_four_readings(system, kappa, lambda_, amplitude, bound):
    """Only 'angular momentum kept, initial mass' is destroyed; closed form, written once more."""
    theta = 12.5
    exact = 0.2 * math.sqrt(math.sin(theta) ** 2 + 0.5 ** (1 - 2 * kappa) * math.cos(theta) ** 2)
    assert exact == pytest.approx(amplitude, abs=5e-5) and 0.2 * 0.5 ** (
        -lambda_ / 2
    ) == pytest.approx(bound, abs=5e-5)
    run = simulate(system, 100.0, kappa=kappa, lambda_=lambda_, **TIGHT)
    assert run["A"][-1] == pytest.approx(exact, abs=1e-10) and run["phi_max"][-1] == pytest.approx(
        0.2 * 0.5 ** (-lambda_ / 2), abs=1e-15
    )
    if (kappa, lambda_) == (1, 0):
        assert run.stopped == 'terminal event "destroyed"'
        # at 25 s the beam comes up through −0.0133 rad; the tolerance moves the event by < 1e-5 s
        instant = 25 + (math.asin(0.2 / exact) - math.asin(0.2 * math.sin(theta) / exact)) / R
        assert instant == pytest.approx(26.18, abs=0.005) and 0 < run.t[-1] - instant < 1e-5
    else:
        assert run.stopped == "finished" and run.t[-1] == 100.0


@pytest.mark.parametrize("t1", [25.0, 27.0, 28.9, 31.0, 36.0])
def test_the_verdicts_do_not_hang_on_the_instant(names, system, t1):
    """The notebook's closed form against runs at other instants: one reading is destroyed."""
    for kappa, lambda_ in ((0, 1), (0, 0), (1, 1), (1, 0)):
        change = {"kappa": kappa, "lambda_": lambda_, "t1": t1}
        A, _, instant = names["theory"](system.values(change))
        run = simulate(system, 100.0, **TIGHT, **change)
        assert run["A"][-1] == pytest.approx(A, abs=1e-9)
        assert (instant is not None) == (run.stopped != "finished") == ((kappa, lambda_) == (1, 0))
        assert instant is None or run.t[-1] == pytest.approx(instant, abs=1e-4)


@pytest.mark.parametrize("kappa", [0, 0.5, 1])
def test_what_is_kept(system, kappa):
    event = next(
        e
        for e in simulate(system, 30.0, kappa=kappa, **TIGHT).events
        if e.transition == "mass lost"
    )
    assert event.t == 25.0 and event.after["phi"] == event.before["phi"]
    assert event.after["w"] * 0.5**kappa == pytest.approx(event.before["w"], rel=1e-14)


def test_energy_kept_leaves_the_amplitude(system):
    """κ = ½: the kinetic energy is kept, so the initial limit is touched 11 times in 100 s."""
    run = simulate(system, 100.0, kappa=0.5, lambda_=0.0, points=20001, **TIGHT)
    peaks = run["phi"][1:-1][
        (run["phi"][1:-1] > run["phi"][:-2]) & (run["phi"][1:-1] >= run["phi"][2:])
    ]
    assert (
        run.stopped == "finished"
        and np.sum(peaks > 0.1) == 11
        and np.allclose(peaks[peaks > 0.1], 0.2, rtol=0, atol=2e-6)
    )


@pytest.mark.parametrize(("method", "destroyed"), [("Euler", True), ("Heun", True), ("RK4", False)])
@pytest.mark.parametrize("step", [0.5, 0.125])
def test_sign_of_the_error_decides_for_fixed_steps(names, method, destroyed, step):
    """|R(iz)| > 1 for Euler and Heun, < 1 for RK4: that is the verdict; A follows |R|^n."""
    order = {"Euler": 1, "Heun": 2, "RK4": 4}[method]
    growth = abs(sum((0.5j * step) ** k / math.factorial(k) for k in range(order + 1)))
    assert (growth > 1) == destroyed
    assert (
        simulate(names["system_naive"], 25.0, method=method, step=step).stopped != "finished"
    ) == destroyed
    free = simulate(names["system_free"], 25.0, method=method, step=step)
    assert free.at(25.0, side="before")["A"] == pytest.approx(0.2 * growth ** (25 / step), rel=1e-9)


@pytest.mark.parametrize("method", ["RK45", "DOP853", "LSODA", "BDF", "Radau"])
@pytest.mark.parametrize("rtol", [1e-7, 1e-9])
def test_with_the_tolerance_every_accurate_run_survives(system, method, rtol):
    assert simulate(system, 25.0, method=method, rtol=rtol, atol=rtol / 100).stopped == "finished"


def test_without_tolerance_a_false_destruction_is_reported(names):
    """The trap is real: good solvers pass the limit by an excess far above rounding."""
    naive, false = names["system_naive"], 0
    for rtol in (1e-3, 1e-4, 1e-6, 1e-7):
        for method in ("RK45", "DOP853", "LSODA"):
            false += (
                simulate(naive, 25.0, method=method, rtol=rtol, atol=rtol / 100).stopped
                != "finished"
            )
    assert 3 <= false <= 12
    assert simulate(naive, 25.0, method="DOP853", rtol=1e-4, atol=1e-6).t[-1] == pytest.approx(
        math.pi, abs=0.1
    )


@pytest.mark.parametrize("share", [1e-3, 1e-5, 4e-6, -1e-9, -1e-5, -1e-3])
def test_near_the_touch_the_verdict_flips_where_it_is_stated(names, system, share):
    """Destroyed if 0.2 ε > 1e-6; without tolerance if ε > 0, √(2ε)/ω before the touch."""
    assert (simulate(system, 25.0, start={"w": 0.1 * share}, **TIGHT).stopped != "finished") == (
        share > 5e-6
    )
    naive = simulate(names["system_naive"], 25.0, start={"w": 0.1 * share}, **TIGHT)
    assert (naive.stopped != "finished") == (share > 0)
    if share > 0:
        assert naive.t[-1] == pytest.approx(2 * math.asin(1 / (1 + share)), abs=1e-6)


def test_true_geometry_passes_the_limit(names):
    """4mφ'' + c0 sin φ cos φ = 0 passes 0.2 rad at F(u | 0.04)/ω, sin u = sin 0.2/0.2."""
    run = simulate(names["system_true"], 100.0, **TIGHT)
    instant = ellipkinc(math.asin(math.sin(0.2) / 0.2), 0.04) / 0.5
    assert (
        run.stopped == 'terminal event "destroyed"'
        and 0 < run.t[-1] - instant < 2e-4
        and instant == pytest.approx(2.938, abs=1e-3)
    )
    energy = 4 * run["w"] ** 2 + np.sin(run["phi"]) ** 2
    assert np.ptp(energy[run.t > 0]) < 1e-12


def test_the_map_of_readings_has_the_border_of_theory(names):
    """Destroyed where sin²θ + r^(1−2κ) cos²θ > r^(−λ), by more than the tolerance."""
    readings, theta = names["readings"], 12.5
    kappa, lambda_ = np.meshgrid(*readings.axes.values(), indexing="ij")
    ratio = np.sin(theta) ** 2 + 0.5 ** (1 - 2 * kappa) * np.cos(theta) ** 2
    over = 0.2 * (np.sqrt(ratio) - np.sqrt(0.5**-lambda_))
    clear = np.abs(over - 1e-6) > 1e-8
    assert list(readings.axes) == ["kappa", "lambda_"] and clear.mean() > 0.99
    assert (readings.values == (over > 1e-6))[clear].all() and 0.1 < readings.values.mean() < 0.4


def test_the_weight_moves_the_rest_position(names, system):
    """Upright, φ'' = −φ c0/(4 r m) + g (1 − r)/(2 r l): about the new rest, 2(1 − r)mg/(c0 l)."""
    for g in (0.0, 9.81):
        run = simulate(names["upright"], 100.0, g=g, **TIGHT)
        rest, before = g / 10, simulate(system, 25.0, t1=30.0, **TIGHT)
        phi, w = before["phi"][-1], before["w"][-1]
        A, lag = math.hypot(phi - rest, w / R), math.atan2(w / R, phi - rest)
        t = np.linspace(25, run.t[-1], 50)[1:]
        exact = rest + A * np.cos(R * (t - 25) - lag)
        assert np.allclose(run.at(t)["phi"], exact, rtol=0, atol=1e-9)
        assert (run.ended != "finished") == (g > 0)
    assert run.t[-1] == pytest.approx(25.93, abs=0.005)


def test_answers_of_the_tasks(names):
    right = names["solutions"]
    assert right["middle"] == pytest.approx(0.2 * math.sqrt(2), abs=1e-7)
    assert right["touches"] == 11
    assert right["detective"] == pytest.approx(0.125 * (math.pi - 3.14) ** 2, rel=1e-5)
    x = right["small"] / 10
    assert math.asin(x) - x == pytest.approx(1e-6, rel=1e-6)


def test_the_maps_of_verdicts(names):
    """Without tolerance also fine runs report a destruction, with it only coarse ones."""
    naive, good = (names["alarms"][key].values for key in ("no tolerance", "1e-6 rad"))
    assert naive.shape == good.shape == (4, 10)
    assert naive[:, 4:].sum() >= 4 and not good[:, 4:].any() and good[:, :2].any()
