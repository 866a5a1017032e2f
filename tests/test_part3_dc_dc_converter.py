"""Part 3, item 6 on the notebook's own model: every period against matrix exponentials, gains.

The border of discontinuous conduction, iL ≥ 0.
"""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import simulate

from .helpers import load

NAME = "part3/06_dc_dc_converter"
DEFAULTS = {"E": 20, "L": 1e-3, "C": 220e-6, "R": 50, "RL": 0.2, "RC": 0.05, "Ts": 1e-4, "d": 0.5}


@pytest.fixture(scope="module")
def system():
    return load(NAME)["system"]


def matrices(p):
    """The handbook's matrices, with L where the print has C, acting on (iL, v, 1)."""
    a, zero = 1 / (p.R + p.RC), [0, 0, 0]
    on = [[-p.RL / p.L, 0, p.E / p.L], [0, -a / p.C, 0], zero]
    diode = [
        [-(p.RL + p.R * p.RC * a) / p.L, -p.R * a / p.L, p.E / p.L],
        [p.R * a / p.C, -a / p.C, 0],
        zero,
    ]
    off = [zero, [0, -a / p.C, 0], zero]
    return [np.array(m) for m in (on, diode, off)]


def reference(p, periods):
    """(iL, v) at the ticks and the instants at which the diode blocks.

    Each of them bracketed within its period.
    """
    on, diode, off = matrices(p)
    rest = (1 - p.d) * p.Ts
    charge, deliver = expm(on * p.d * p.Ts), expm(diode * rest)
    states, zeros = [np.array([0.0, 0.0, 1.0])], []
    for k in range(periods):
        x = charge @ states[-1]
        end = deliver @ x
        if end[0] < 0:
            tau = brentq(lambda s, x=x: (expm(diode * s) @ x)[0], 0, rest, xtol=1e-18, rtol=1e-14)
            zeros.append(k * p.Ts + p.d * p.Ts + tau)
            end = expm(off * (rest - tau)) @ ([0, 1, 1] * (expm(diode * tau) @ x))
        states.append(end)
    return np.array(states)[:, :2], np.array(zeros)


def mean(run, name, since):
    k = run.t >= since
    return np.trapezoid(run[name][k], run.t[k]) / (run.t[-1] - run.t[k][0])


def steady(system, **parameters):
    """A run of five periods from the notebook's steady state."""
    p = system.values(parameters)
    return simulate(system, 5 * p.Ts, start=load(NAME)["steady"](p), points=2001, **parameters)


def test_handbook_values(system):
    assert load(NAME)["horizon"] == 20e-3
    assert {name: parameter.value for name, parameter in system.parameters.items()} == DEFAULTS
    assert (
        system.start == {"iL": 0.0, "v": 0.0}
        and system.mode == "on"
        and list(system.modes) == ["on", "diode", "off"]
    )


def test_the_flows_are_the_handbooks_matrices(system):
    p = system.values()
    for mode, matrix in zip(system.modes.values(), matrices(p), strict=True):
        for state in ((0.0, 0.0), (1.5, 40.0)) if mode.name != "off" else ((0.0, 0.0), (0.0, 40.0)):
            assert mode.flow(0.0, system.S["on"](*state), p) == pytest.approx(
                matrix[:2] @ [*state, 1], rel=1e-12, abs=1e-9
            )


@pytest.mark.parametrize(
    ("change", "method", "miss"),
    [
        ({}, "DOP853", 1e-9),
        ({"R": 200.0}, "DOP853", 1e-9),
        ({"d": 0.3, "R": 400.0}, "DOP853", 1e-9),
        ({"d": 0.8, "Ts": 2e-4}, "DOP853", 1e-9),
        ({}, "RK45", 1e-5),
    ],
)
def test_every_period_against_matrix_exponentials(system, change, method, miss):
    p = system.values(change)
    periods = round(20e-3 / p.Ts)
    run = simulate(system, 20e-3, method=method, **change)
    states, zeros = reference(p, periods)
    ticks = run.at(np.minimum(np.arange(periods + 1) * p.Ts, run.t[-1]))
    assert (
        np.abs(ticks["iL"] - states[:, 0]).max() < miss
        and np.abs(ticks["v"] - states[:, 1]).max() < miss
    )
    found = np.array([e.t for e in run.events if e.transition == "diode blocks"])
    assert len(found) == len(zeros) and np.all(np.abs(found - zeros) < 1e-4 * miss)


def test_the_clock_keeps_its_instants(system):
    run = simulate(system, 20e-3)
    k = np.arange(200)
    assert [e.t for e in run.events if e.transition == "switch opens"] == pytest.approx(
        (k + 0.5) * 1e-4, abs=1e-15
    )
    assert [e.t for e in run.events if e.transition == "switch closes"] == pytest.approx(
        (k + 1) * 1e-4, abs=1e-15
    )


def test_the_coil_never_carries_a_negative_current(system):
    for R in (50.0, 200.0, 500.0):
        run = simulate(system, 20e-3, R=R)
        assert (
            run["iL"].min() > -1e-11
            and np.any(run.mode == "off")
            and np.all(run["iL"][(run.mode == "off") & (run.j > run.j[0])] < 1e-11)
        )


def test_without_location_it_does(system):
    run = simulate(system, 20e-3, R=200.0, method="RK4", step=1e-5, locate=False)
    assert run["iL"].min() < -0.1


@pytest.mark.parametrize("d", [0.3, 0.5, 0.7])
def test_ideal_gain(system, d):
    run = steady(system, d=d, R=20.0, RL=0.0, RC=0.0)
    assert not np.any(run.mode == "off") and mean(run, "v_out", 0.0) / 20 == pytest.approx(
        1 / (1 - d), rel=1e-3
    )


@pytest.mark.parametrize("d", [0.3, 0.5, 0.7, 0.8582, 0.95])
def test_gain_with_losses(system, d):
    p = system.values({"d": d, "R": 10.0})
    run = steady(system, d=d, R=10.0)
    assert mean(run, "v_out", 0.0) == pytest.approx(load(NAME)["continuous"](d, 10.0, p), rel=2e-3)


def test_more_duty_may_lower_the_output(system):
    low, best, high = (mean(steady(system, d=d, R=10.0), "v_out", 0.0) for d in (0.80, 0.858, 0.92))
    assert best > low and best > high and best / 20 == pytest.approx(3.484, abs=0.005)


@pytest.mark.parametrize(("d", "R"), [(0.5, 200.0), (0.3, 400.0), (0.6, 450.0)])
def test_discontinuous_gain(system, d, R):
    """Lossless: V/E = (1 + √(1 + 4d²/K))/2 with K = 2L/(R Ts), up to the ripple."""
    run = steady(system, d=d, R=R, RL=0.0, RC=0.0)
    K = 2 * 1e-3 / (R * 1e-4)
    assert np.any(run.mode == "off") and mean(run, "v_out", 0.0) / 20 == pytest.approx(
        (1 + np.sqrt(1 + 4 * d**2 / K)) / 2, rel=1e-3
    )


def test_border_of_discontinuous_conduction(system):
    """160 Ω by the formula, which takes the voltage for constant.

    With its ripple and the losses the border moves by a tenth of a percent.
    """
    assert load(NAME)["border"](0.5, system.values()) == pytest.approx(160.0)
    for losses, low, high in (({"RL": 0.0, "RC": 0.0}, 159.7, 160.1), ({}, 160.0, 160.3)):
        kinds = [np.any(steady(system, R=R, **losses).mode[3:] == "off") for R in (low, high)]
        assert kinds == [False, True]


def test_the_steady_state_is_reached_from_rest(system):
    goal = load(NAME)["steady"](system.values())
    run = simulate(system, 0.2, points=2)
    assert run.final == pytest.approx(goal, rel=1e-8) and run.mode[-1] == "on"
    assert len(run.events) == 4064  # two a period, and 64 times the diode blocks at the start


def test_mean_of_the_output_is_the_mean_of_the_capacitor(system):
    for R in (50.0, 200.0):
        run = steady(system, R=R)
        assert mean(run, "v_out", 0.0) == pytest.approx(mean(run, "v", 0.0), rel=1e-5)


def test_power_balance_of_the_steady_state(system):
    """What the source gives is what the load and both resistances take.

    R_C from the charge that the capacitor exchanges.
    """
    for R in (50.0, 200.0):
        run, p = steady(system, R=R), system.values({"R": R})
        iC = np.where(run.mode == "diode", run["iL"], 0.0) - run["v_out"] / R
        given = np.trapezoid(p.E * run["iL"], run.t)
        taken = np.trapezoid(run["v_out"] ** 2 / R + p.RL * run["iL"] ** 2 + p.RC * iC**2, run.t)
        assert taken == pytest.approx(given, rel=1e-4)


def test_load_steps_are_runs_with_another_load(system):
    names = load(NAME)
    run = simulate(names["system_two"], 0.08)
    one = simulate(system, 0.02, start=names["steady"](system.values()), points=2)
    two = simulate(system, 0.04, R=25.0, start=one.final, points=2)
    three = simulate(system, 0.02, R=200.0, start=two.final, points=2)
    for t, part in ((0.02, one), (0.06, two), (0.08, three)):
        there = run.at(t, side="before")
        assert there["iL"] == pytest.approx(part.final["iL"], abs=1e-8) and there[
            "v"
        ] == pytest.approx(part.final["v"], abs=1e-8)
    assert [e.after["load"] for e in run.events if e.transition == "load step"] == [25.0, 200.0]


def test_printed_matrix_makes_energy_out_of_nothing():
    """Lossless and without source and load.

    C v v' + L i i' is zero with L and (1 − L/C) i v with C in its place.
    """
    names = load(NAME)
    system, system_three = names["system"], names["system_three"]
    p, s = system.values()._replace(E=0.0, RL=0.0, RC=0.0, R=1e15), system.S["diode"](2.0, 40.0)
    power = [
        p.L * s.iL * di + p.C * s.v * dv
        for di, dv in (one.modes["diode"].flow(0.0, s, p) for one in (system, system_three))
    ]
    assert power == pytest.approx([0.0, (1 - p.L / p.C) * 80], abs=1e-6)
