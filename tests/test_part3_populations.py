"""Part 3, item 7 on the notebook's own model: an invariant, seasons, deaths and timers.

The reference integrates the printed equations season by season with SciPy, to 1e-12.
"""

from math import exp, log

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from labkit import simulate

NAME = "part3/07_two_populations"
BEARS = (0.7, 0.7, 0.9, 0.9)
ELKS = (0.6, 0.8, 0.9, 0.9)


def reference(rates, start=(10.0, 20.0), end=240.0, winter=3.0, back=2.0, timers=(3.0, 5.0)):
    """Ends of the seasons with both numbers, and the deaths, in the logarithms of the numbers."""
    e1, g1, e2, g2 = rates
    t, N, due, deaths, ends = 0.0, np.array(start), [np.inf, np.inf], [], []
    while t < end - 1e-9:
        year = 12 * np.floor(t / 12 + 1e-12)
        asleep = winter > 0 and t - year >= 12 - winter - 1e-9
        season = year + (12 if asleep or winter == 0 else 12 - winter)
        until = min(season, *due)
        alive = N > 0

        def flow(t, y, alive=alive, asleep=asleep):
            n1, n2 = np.where(alive, np.exp(y), 0.0)
            F = 0.01 * n2 + (0.0 if asleep else 0.01 * n1)
            return np.where(alive, (e1 - g1 * F, e2 - g2 * F), 0.0)

        watch = [lambda t, y, i=i, alive=alive: y[i] if alive[i] else 1.0 for i in (0, 1)]
        for guard in watch:
            guard.terminal, guard.direction = True, -1
        y = np.log(np.where(alive, N, 1.0))
        found = solve_ivp(flow, (t, until), y, "DOP853", events=watch, rtol=1e-12, atol=1e-13)
        t, N = found.t[-1], np.where(alive, np.exp(found.y[:, -1]), 0.0)
        if found.status == 1:
            i = 0 if len(found.t_events[0]) else 1
            N[i], due[i] = 0.0, t + timers[i]
            deaths.append((t, i + 1))
            continue
        for i in (0, 1):
            if abs(due[i] - t) < 1e-9:
                N[i], due[i] = back, np.inf
        if abs(t - season) < 1e-9:
            ends.append((t, *N))
    return np.array(ends), deaths


def deaths(run):
    return [(e.t, int(e.transition[0])) for e in run.events if "dies" in e.transition]


def test_handbook_values(names):
    system, p, q = names["system"], names["system"].values(), names["system_two"].values()
    assert names["horizon"] == names["horizon_two"] == 240 and system.time == "month"
    assert (p.e1, p.g1, p.e2, p.g2) == BEARS and (q.e1, q.g1, q.e2, q.g2) == ELKS
    assert (p.l1, p.l2, p.winter, p.T1, p.T2, p.back) == (0.01, 0.01, 3, 3, 5, 2) == (
        q.l1, q.l2, q.winter, q.T1, q.T2, q.back)  # fmt: skip
    assert (system.start["N1"], system.start["N2"], p.still) == (10, 20, 0)


def test_the_equations_of_the_handbook(names):
    system = names["system"]
    for z, F in ((0.0, 0.01 * (30 + 60)), (1.0, 0.01 * 60)):
        s = system.S["both"](30.0, 60.0, 0.0, 0.0, z)
        expected = [30 * (0.7 - 0.7 * F), 60 * (0.9 - 0.9 * F), 0, 0]
        assert system.modes["both"].flow(0.0, s, system.values()) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("rates", "change"),
    [
        (BEARS, {}),
        (BEARS, {"winter": 0.0}),
        (BEARS, {"start": (2.0, 400.0)}),
        (ELKS, {}),
        (ELKS, {"winter": 0.0}),
        (ELKS, {"back": 20.0, "winter": 6.0}),
        ((0.9, 0.9, 0.5, 0.9), {}),
    ],
)
def test_seasons_and_deaths_against_the_reference(names, rates, change):
    ends, died = reference(rates, **change)
    change = dict(change)
    start = dict(zip(("N1", "N2"), change.pop("start", (10.0, 20.0)), strict=True))
    e1, g1, e2, g2 = rates
    run = simulate(names["system"], 240.0, start=start, e1=e1, g1=g1, e2=e2, g2=g2, **change)
    assert [n for _, n in deaths(run)] == [n for _, n in died]
    assert [t for t, _ in deaths(run)] == pytest.approx([t for t, _ in died], abs=1e-6)
    at = run.at(ends[:-1, 0], side="after")
    assert at["N1"] == pytest.approx(ends[:-1, 1], abs=2e-6, rel=2e-8)
    assert at["N2"] == pytest.approx(ends[:-1, 2], abs=2e-6, rel=2e-8)


def test_the_invariant_of_the_reading(names):
    run = simulate(names["system"], 240.0)
    constant = run["N1"] ** (1 / 0.7) * run["N2"] ** (-1 / 0.9)
    assert np.ptp(constant) < 1e-7 and constant[0] == pytest.approx(
        10 ** (1 / 0.7) * 20 ** (-1 / 0.9)
    )
    assert not deaths(run)  # with the handbook's numbers nobody dies out


def test_winter_does_not_change_the_end_of_summer(names):
    """The state is on one curve and comes to the line N1 + N2 = 100 there."""
    run = simulate(names["system"], 237.0)
    none = simulate(names["system"], 237.0, winter=0.0)
    n1, n2 = names["goal"]
    assert n1 + n2 == pytest.approx(100, abs=1e-10)
    assert n1 ** (1 / 0.7) * n2 ** (-1 / 0.9) == pytest.approx(10 ** (1 / 0.7) * 20 ** (-1 / 0.9))
    assert none.final["N1"] == pytest.approx(n1, abs=1e-6)
    assert run.final["N1"] == pytest.approx(n1, abs=0.01)


def test_winter_is_logistic(names):
    run = simulate(names["system"], 24.0)
    low, high = run.at(9.0)["N2"], run.at(12.0, side="before")["N2"]
    assert high == pytest.approx(1 / (0.01 + (1 / low - 0.01) * exp(-0.9 * 3)), abs=1e-6)


def test_a_timer_of_three_months_and_two_elks(names):
    run = simulate(names["system_two"], 240.0)
    died, back = run.events["1 dies out"], run.events["1 returns"]
    n = len(back.t)
    assert n >= 34 and back.t == pytest.approx(died.t[:n] + 3.0, abs=1e-9)
    assert np.all(died.after["N1"] == 0) and np.all(back.after["N1"] == 2)
    assert np.all(died.before["N1"] == pytest.approx(1.0, abs=1e-9))


def test_visits_last_as_the_logarithms_say(names):
    run = simulate(names["system_two"], 240.0)
    died, back = run.events["1 dies out"], run.events["1 returns"]
    for k in range(20):
        T = died.t[k + 1] - back.t[k]
        D = died.before["N2"][k + 1] / back.after["N2"][k]
        assert -log(2) / 0.8 - log(D) / 0.9 == pytest.approx((0.75 - 1) * T, abs=1e-8)


def test_the_border_of_the_famine(names):
    for N2 in (150.0, 600.0):
        border = (N2 / 99) ** (0.7 / 0.9)
        for share, lost in ((0.999, 1), (1.001, 0)):
            run = simulate(names["system"], 9.0, start={"N1": border * share, "N2": N2})
            assert len(run.events["1 dies out"]) == lost


def test_sleepers_that_do_not_multiply_lose_each_winter(names):
    run = simulate(names["system"], 240.0, still=1.0)
    for year in range(1, 20):
        a, b = run.at(12.0 * year - 3), run.at(12.0 * year, side="before")
        assert a["N1"] == pytest.approx(b["N1"], abs=1e-7)
        grown = 1 / (0.01 + (1 / a["N2"] - 0.01) * exp(-0.9 * 3))
        assert b["N2"] == pytest.approx(grown, abs=1e-6)
    assert run.at(237.0)["N1"] < 6


def test_the_calendar_hidden_in_the_flow_costs_steps_and_digits(names):
    hidden, truth = names["hidden"], reference(BEARS)[0]
    good = simulate(names["system"], 240.0)
    late = simulate(hidden, 240.0)
    assert late.work.steps > 2 * good.work.steps and late.work.rejected > 5 * good.work.rejected
    t = truth[1:-1:2, 0]
    errors = [
        np.abs(simulate(m, 240.0, method="RK4", step=0.16).at(t)["N1"] - truth[1:-1:2, 1]).max()
        for m in (names["system"], hidden)
    ]
    assert errors[1] > 100 * errors[0]


def test_both_pairs_in_one_system_are_the_two(names):
    run = simulate(names["both_pairs"], 240.0)
    died = [e.t for e in run.events if e.transition == "3 dies out"]
    assert died == pytest.approx([t for t, _ in reference(ELKS)[1]], abs=1e-6)
    ends = reference(BEARS)[0][:-1]
    assert np.abs(run.at(ends[:, 0])["N1"] - ends[:, 1]).max() < 2e-6


def test_tasks(names):
    found = names["solutions"]
    assert found["tie"] == pytest.approx(0.8)
    assert found["back"] == len(reference(ELKS, back=20.0)[1])
    n1 = found["eaters"]
    assert 0.01 * n1 + 0.02 * 20 * (n1 / 10) ** (0.9 / 0.7) == pytest.approx(1, abs=1e-9)
    run = simulate(names["system"], found["frugal"] + 1, g1=0.693, points=2)
    n1 = run.events["2 dies out"].before["N1"][0]
    t = (log(n1 / 10) / 0.693 - log(1 / 20) / 0.9) / (0.7 / 0.693 - 1)
    assert found["frugal"] == pytest.approx(t, rel=1e-6)
