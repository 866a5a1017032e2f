"""The handbook's sample 4.3 on the notebook's own model: first slip, the erratum's numbers.

The sharp-drop limit, energy.
"""

import math

import numpy as np
import pytest

from labkit import simulate

from .helpers import load

NAME = "part3/00_sample_dry_friction"
TIGHT = {"rtol": 1e-11, "atol": 1e-12}


@pytest.fixture(scope="module")
def system():
    return load(NAME)["system"]


def test_handbook_values(system):
    assert load(NAME)["horizon"] == 30.0
    assert [system.parameters[n].value for n in ("m", "k", "Vp", "Fs", "Fc", "V0")] == [
        1,
        2,
        2,
        5.88,
        4,
        1,
    ]
    assert system.start == {"x": 0.0, "V": 0.0}
    assert simulate(system, 0.1).mode[0] == "stick"
    assert simulate(system, 0.1, start={"x": 2.0, "V": 2.5}).mode[0] == "slip"


@pytest.mark.parametrize("change", [{}, {"k": 3.0}, {"Vp": 0.7}, {"Fs": 8.0}])
def test_first_slip(system, change):
    p = system.values(change)
    run = simulate(system, 2 * p.Fs / (p.k * p.Vp), **TIGHT, **change)
    assert (
        run.events[0].transition == "break loose"
        and abs(run.events[0].t - p.Fs / (p.k * p.Vp)) <= 1e-10
    )


def test_sharp_drop_is_the_limit(system):
    """As V0 → 0 slip time, stick time and highest speed approach the closed form."""
    sharp, cycle = load(NAME)["sharp_drop"], load(NAME)["cycle"]
    misses = [
        np.abs(
            np.subtract(
                cycle(simulate(system, 30.0, V0=V0, points=20001, **TIGHT)), sharp(system.values())
            )
        )
        for V0 in (0.1, 0.03, 0.01)
    ]
    assert (
        np.all(misses[2] < 0.02) and np.all(misses[1] < misses[0]) and np.all(misses[2] < misses[1])
    )


def test_handbook_numbers_leave_no_drop(system):
    """With Fc = Fs the block follows V = Vp(1 − cos ωτ): highest speed 4, period 4.443.

    No sticking that lasts.
    """
    run = simulate(system, 30.0, Fc=5.88, rtol=1e-11, atol=1e-13, points=30001)
    tau = np.maximum(run.t - 1.47, 0)
    assert np.abs(run["V"] - 2 * (1 - np.cos(math.sqrt(2) * tau))).max() < 1e-6
    assert run["V"].max() == pytest.approx(4, abs=1e-6) and 2 * math.pi / math.sqrt(
        2
    ) == pytest.approx(4.443, abs=1e-3)


def test_inside_the_ring_nothing_is_lost(system):
    """While V > V0 friction is constant: (V − Vp)² + (k/m)(x − Fc/k)² stays what it was."""
    run = simulate(system, 60.0, start={"x": 2.0, "V": 2.9}, mode="slip", **TIGHT)
    radius = (run["V"] - 2) ** 2 + 2 * (run["x"] - 2) ** 2
    assert len(run.events) == 0 and np.ptp(radius) < 1e-8


def test_energy_balance_over_the_run(system):
    """Work of the pull = change of spring and kinetic energy + what friction took.

    By quadrature of the samples.
    """
    run = simulate(system, 30.0, points=60001, **TIGHT)
    pull = np.trapezoid(2 * run["x"] * 2.0, run.t)
    lost = np.trapezoid(run["F"] * run["V"], run.t)
    stored = 0.5 * run["V"] ** 2 + run["x"] ** 2
    assert pull == pytest.approx(stored[-1] - stored[0] + lost, abs=1e-5)


def test_friction_while_sticking_balances_the_spring(system):
    run = simulate(system, 30.0)
    stick = run.mode == "stick"
    assert (
        np.allclose(run["F"][stick], 2 * run["x"][stick])
        and np.all(run["F"] <= 5.88 + 1e-6)
        and np.all(run["V"] >= -1e-10)
    )
