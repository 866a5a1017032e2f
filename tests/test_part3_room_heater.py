"""The handbook's item 4 of part 3 on the notebook's own models.

Limit cycle, weighted mean, daily outside temperature, two time constants, dead times.
"""

import math

import numpy as np
import pytest

from labkit import simulate

NAME = "part3/04_room_heater"
TIGHT = {"rtol": 1e-11, "atol": 1e-12}


def test_handbook_values(names):
    system = names["system"]
    assert (names["horizon"], names["horizon_two"], names["horizon_three"]) == (
        24.0,
        72.0,
        24.0,
    ) and system.time == "h"
    assert [system.parameters[n].value for n in ("T", "K", "U", "C0", "theta0", "b", "Td")] == [
        1,
        2,
        5,
        15,
        20,
        0.5,
        0.2,
    ]
    assert (
        system.start == {"tau": 0.0}
        and system.mode == "on"
        and names["system_two"].start == {"theta": 15.0}
    )
    assert names["system_three"].parameters["Tc"].value == 1.5


def test_limit_cycle_of_the_handbook(names):
    high, low, on, off = names["observed"](simulate(names["system"], 24.0, **TIGHT))
    assert (round(low, 3), round(high, 3), round(on + off, 4)) == (18.684, 21.316, 1.0779)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"Td": 0.0},
        {"Td": 1.0},
        {"b": 0.0},
        {"U": 3.0},
        {"C0": 12.0, "theta0": 19.0},
        {"T": 2.0},
    ],
)
@pytest.mark.parametrize("which", ["system", "system_three"])
def test_limit_cycle_against_the_formula(names, which, change):
    """Thresholds overrun for Td along the exponentials, each phase with its own time constant.

    Written here once more by hand.
    """
    system = names[which]
    p = system.values(change)
    Th, Tc = p.T, getattr(p, "Tc", p.T)
    R, h, low = p.K * p.U, p.theta0 + p.b - p.C0, p.theta0 - p.b - p.C0
    top, bottom = R + (h - R) * math.exp(-p.Td / Th), low * math.exp(-p.Td / Tc)
    wanted = [
        p.C0 + top,
        p.C0 + bottom,
        Th * math.log((R - bottom) / (R - top)),
        Tc * math.log(top / bottom),
    ]
    assert np.allclose(
        names["observed"](simulate(system, 24.0, **TIGHT, **change)), wanted, rtol=0, atol=1e-8
    )
    assert np.allclose(names["cycle"](p), wanted, rtol=0, atol=1e-12)


def test_every_switch_is_the_crossing_of_one_dead_time_ago(names):
    for system, value, end in (
        (names["system"], lambda s: 15 + s["tau"], 24.0),
        (names["system_two"], lambda s: s["theta"], 72.0),
    ):
        run = simulate(system, end, **TIGHT)
        assert len(run.events) > 40
        for event in run.events:
            assert value(run.at(event.t - 0.2)) == pytest.approx(
                20.5 if event.target == "off" else 19.5, abs=1e-8
            )


def test_all_switching_instants_of_a_day(names):
    run = simulate(names["system"], 24.0, **TIGHT)
    assert np.allclose([e.t for e in run.events], names["instants"](run.p, 24.0), rtol=0, atol=1e-8)


@pytest.mark.parametrize("Td", [0.05, 0.2, 0.7])
@pytest.mark.parametrize("b", [0.0, 0.5])
def test_the_swing_is_a_weighted_mean(names, Td, b):
    high, low, *_ = names["observed"](simulate(names["system"], 24.0, Td=Td, b=b, **TIGHT))
    q = math.exp(-Td)
    assert high - low == pytest.approx(10 * (1 - q) + 2 * b * q, abs=1e-8)


def test_the_smaller_heater_calms_and_clicks_less(names):
    given, perfect, small = (
        names["observed"](simulate(names["system"], 24.0, **change))
        for change in ({}, {"b": 0.0}, {"U": 3.0})
    )
    swing = [high - low for high, low, *_ in (given, perfect, small)]
    times = [on + off for *_, on, off in (given, perfect, small)]
    assert (
        swing[1] < swing[2] < 0.75 * swing[0]
        and times[1] < 0.7 * times[0]
        and times[2] > 1.9 * times[0]
    )


def test_outside_temperature_added_after_the_lag_is_wrong_by_076(names):
    run = names["both"]
    w = 2 * math.pi / 24
    assert np.abs(run["error"]).max() == pytest.approx(
        3 * w / math.hypot(1, w), abs=1e-4
    ) and 3 * w / math.hypot(1, w) == pytest.approx(0.76, abs=1e-3)
    alone = simulate(names["system_two"], 72.0, rtol=1e-10, atol=1e-12)
    assert np.allclose(
        [e.t for e in alone.events], [e.t for e in run.events], atol=1e-7
    )  # the right room of the pair is system_two


def test_a_day_without_amplitude_is_the_first_task(names):
    one, two = (
        simulate(names["system"], 24.0, **TIGHT),
        simulate(names["system_two"], 24.0, A=0.0, **TIGHT),
    )
    assert np.allclose(
        [e.t for e in one.events], [e.t for e in two.events], atol=1e-8
    ) and np.allclose(15 + one["tau"], two["theta"], atol=1e-8)


def test_two_time_constants_make_heat(names):
    """Mean of τ = R·t_on/P + (Tc − Th)·Δ/P, by quadrature of the samples."""
    high, low, on, off = names["cycle"](names["system_three"].values())
    assert names["mean"] == pytest.approx((10 * on + 0.5 * (high - low)) / (on + off), abs=1e-4)


def test_the_past_matters(names):
    """What is made from the present misses the cycle; the tangent has a closed form of its own."""
    high, low, on, off = names["observed"](simulate(names["tangent_model"], 24.0, **TIGHT))
    assert (high, low) == (
        pytest.approx(15 + 7.5 / 1.2, abs=1e-8),
        pytest.approx(15 + 4.5 / 1.2, abs=1e-8),
    ) and abs(on + off - 1.0779) > 0.05
    assert names["by_hand"](0.002, delay=1)[2] < 0.45 and names["by_hand"](0.0005)[
        2
    ] == pytest.approx(1.0779, abs=2e-3)


def test_without_location_the_period_is_too_long(names):
    period, P = names["period"], sum(names["cycle"](names["system"].values())[2:])
    located, late = (
        period(simulate(names["system"], 24.0, method="RK4", step=0.03, locate=here))
        for here in (True, False)
    )
    assert abs(located - P) < 1e-6 and 0.005 < late - P < 0.15


def test_ideal_switch_slides(names):
    run = simulate(names["system"], 24.0, b=0.0, Td=0.0)
    assert run.stopped == "finished" and run["tau"][-1] == pytest.approx(5, abs=1e-9)


def test_answers_of_the_tasks(names):
    """By hand, from the formulas of the swing and the period."""
    q, right = math.exp(-0.2), names["solutions"]
    assert right["power"] == pytest.approx(2.5, abs=1e-6)
    assert right["period"] == pytest.approx(2 * math.log(2 / q - 1), abs=1e-8)
    assert right["calmest"] == pytest.approx(2.75)
    assert right["swing"] == pytest.approx(10 * (1 - q) + q - 1.5 * q, abs=1e-8)
    assert names["run"].events["switch off"].t[0] == pytest.approx(math.log(10 / 4.5) + 0.2)


def test_a_loss_that_depends_on_the_mode_closes_the_balance(names):
    """Energy: with one capacity, what is lost in a cycle is what was paid; with one loss, not."""
    _, _, on, _ = names["cycle"](names["system_three"].values())
    assert names["paid"] == pytest.approx(5 * on, abs=1e-6)
    assert names["lost"][1] == pytest.approx(5 * on, abs=1e-4)
    assert names["lost"][0] - names["paid"] > 0.5


def test_an_error_in_time_stays(names):
    """Without location every cycle adds its own part, so ten days are ten times as wrong as one."""
    late = names["ten_days"][False]
    assert 8 < late[-1] / late[42] < 12 and names["ten_days"][True][-1] < 1e-6
