"""The handbook's checks for sample 3.3, on the model that its notebook defines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit import simulate

from .helpers import load
from .test_solve import relay_exact

NAME = "part2/00_sample_relay_hysteresis"
TIGHT = {"rtol": 1e-10, "atol": 1e-12}


@pytest.fixture(scope="module")
def book():
    return load(NAME)


@pytest.fixture(scope="module")
def system(book):
    return book["system"]


def turns(run):
    return [event for event in run.events if event.transition == "stop"]


def of_theory(run):
    """Switches and turns; the start after a turn, at the same instant, is labkit's."""
    return [event.t for event in run.events if "off" not in event.transition]


def formula(run, x, v):
    """F as the handbook writes it; meaningless where v = 0 or |x| = a."""
    return run.p.K * np.sign(x - np.sign(v) * run.p.a)


def clear(run):
    """Samples at which the formula has a value, with room for rounding."""
    return (np.abs(run["v"]) > 1e-6) & (np.abs(np.abs(run["x"]) - run.p.a) > 1e-6)


def test_the_handbooks_values(book, system):
    assert book["horizon"] == 60.0
    assert {
        name: system.parameters[name].value for name in ("mu", "K", "a", "h", "omega", "delta")
    } == {"mu": 1.2, "K": 0.8, "a": 0.4, "h": 1.0, "omega": 1.0, "delta": 0.0}
    assert system.start == {"x": 0.0, "v": 0.0} == book["system_relay"].start


def test_both_branches_at_the_start(system):
    """Each branch is consistent with the force that it causes.

    And they lead to the handbook's extremes.
    """
    right, left = (simulate(system, 10.0, first=way) for way in (1, -1))
    assert [(round(e.before["x"], 3), round(e.t, 3)) for e in turns(right)] == [
        (3.035, 3.967),
        (-4.092, 8.503),
    ]
    assert (round(turns(left)[0].before["x"], 3), round(turns(left)[0].t, 3)) == (-0.410, 1.966)
    assert (
        simulate(system, 10.0).mode[0] == right.mode[0] == "→ x < a" and left.mode[0] == "← x > -a"
    )
    assert (
        right["F"][0] == -0.8
        and right.at(1e-3)["v"] > 0
        and left["F"][0] == 0.8
        and left.at(1e-3)["v"] < 0
    )
    assert simulate(system, 10.0, mode="← x > -a").final == left.final


def test_the_outer_force_ends_the_doubt(system):
    """From rest at a later instant both ways are open as long as h sin ωt ≤ K.

    Up to asin(0.8) = 0.9273 s.
    """
    for t0, ways in ((0.927, {"→ x < a", "← x > -a"}), (0.928, {"→ x < a"})):
        assert {simulate(system, 2.0, t0=t0, first=way).mode[0] for way in (1, -1)} == ways


def test_against_the_piecewise_exact_solution(system):
    run = simulate(system, 60.0, **TIGHT)
    switches, x, v = relay_exact(60.0)
    assert len(of_theory(run)) == len(switches) == 15
    assert np.abs(np.array(of_theory(run)) - [t for t, _ in switches]).max() <= 1e-8
    assert abs(run.final["x"] - x) <= 1e-8 and abs(run.final["v"] - v) <= 1e-8


@pytest.mark.parametrize("way", [1, -1])
def test_the_notebooks_own_exact_solution(book, system, way):
    run = simulate(system, 60.0, first=way, rtol=1e-11, atol=1e-13)
    instants, x, v = book["exact"](60.0, way)
    assert len(of_theory(run)) == len(instants) and np.abs(of_theory(run) - instants).max() <= 1e-8
    assert abs(run.final["x"] - x) <= 1e-8 and abs(run.final["v"] - v) <= 1e-8


@settings(max_examples=15)
@given(st.floats(0.5, 3), st.floats(0.2, 2), st.floats(0.1, 1))
def test_free_motion_grows_by_the_area_of_the_loop(mu, K, a):
    n = np.arange(1, 7)
    instants = np.cumsum(2 * np.sqrt(2 * mu * a * (2 * n - 1) / K))
    run = simulate(load(NAME)["system"], 1.01 * instants[-1], h=0, mu=mu, K=K, a=a, **TIGHT)
    assert np.allclose([abs(e.before["x"]) for e in turns(run)], 2 * a * n, rtol=1e-8)
    assert np.allclose([e.t for e in turns(run)], instants, rtol=1e-8)
    energy = np.array(
        [mu * e.before["v"] ** 2 / 2 for e in run.events if e.transition == "up through a"]
    )
    assert np.allclose(np.diff(energy), 4 * a * K, rtol=1e-7)


@pytest.mark.parametrize("way", [1, -1])
def test_work_round_the_loop_of_the_shaken_cart(system, way):
    run = simulate(system, 60.0, first=way, **TIGHT)
    ups = [
        k
        for k in range(len(run.t) - 1)
        if run.j[k + 1] > run.j[k] and run.events[run.j[k]].transition == "up through a"
    ]
    assert len(ups) >= 4
    for first, last in zip(ups[:-1], ups[1:], strict=True):
        work = -np.sum(run["F"][first + 1 : last] * np.diff(run["x"][first + 1 : last + 1]))
        assert work == pytest.approx(4 * 0.4 * 0.8, abs=1e-8)


starts = st.fixed_dictionaries(
    {"x": st.floats(-2, 2), "v": st.one_of(st.just(0.0), st.floats(-2, 2))}
)


@settings(max_examples=60)
@given(starts, st.floats(0, 4), st.floats(0.3, 4), st.sampled_from([1, -1]), st.floats(0, 6))
def test_every_start_obeys_the_formula(start, h, omega, first, t0):
    """Whatever is clicked: the run finishes.

    And F is the handbook's at every sample that has a value.
    """
    run = simulate(
        load(NAME)["system"], t0 + 12.0, t0=t0, start=start, h=h, omega=omega, first=first
    )
    assert run.stopped == "finished"
    use = clear(run)
    assert np.array_equal(run["F"][use], formula(run, run["x"], run["v"])[use])
    to_the_right, to_the_left = (
        np.array([mode.startswith(arrow) for mode in run.mode]) for arrow in "→←"
    )
    assert np.all(run["v"][to_the_right] >= -1e-7) and np.all(run["v"][to_the_left] <= 1e-7)


@settings(max_examples=60)
@given(starts, st.floats(0, 4), st.floats(0.3, 4), st.sampled_from([1, -1]), st.floats(0, 6))
def test_a_relay_with_memory_switches_at_its_switches_only(start, h, omega, first, t0):
    run = simulate(
        load(NAME)["system_relay"], t0 + 12.0, t0=t0, start=start, h=h, omega=omega, first=first
    )
    assert run.stopped == "finished"
    for k in np.flatnonzero(np.diff(run["F"])):
        rise = run["F"][k + 1] > run["F"][k]
        assert run["x"][k] == pytest.approx(0.4 if rise else -0.4, abs=1e-7) and (
            run["v"][k] >= -1e-7 if rise else run["v"][k] <= 1e-7
        )
    outside = np.abs(run["x"]) > 0.4 + 1e-7
    assert np.array_equal(run["F"][outside], 0.8 * np.sign(run["x"][outside]))


@pytest.mark.parametrize("way", [1, -1])
def test_both_readings_agree_with_the_given_numbers(book, way):
    one, other = (
        simulate(book[name], 60.0, first=way, **TIGHT) for name in ("system", "system_relay")
    )
    assert all(abs(e.before["x"]) > 0.4 for e in turns(one))
    switches = [e.t for e in one.events if "through" in e.transition]
    assert switches == pytest.approx([e.t for e in other.events], abs=1e-8)
    assert [one.final[s] for s in "xv"] == pytest.approx([other.final[s] for s in "xv"], abs=1e-7)
    for found, event in zip(zip(*book["turns"](other), strict=True), turns(one), strict=True):
        assert found == pytest.approx((event.t, event.before["x"]), abs=1e-7)


def test_the_readings_part_at_a_turn_inside_the_loop(book):
    one, other = (
        simulate(book[name], 15.0, h=1.5, first=-1) for name in ("system", "system_relay")
    )
    a, b = turns(one)[0], book["turns"](other)[0][0]
    assert a.t == pytest.approx(b, abs=1e-6) == pytest.approx(1.2, abs=0.05)
    assert abs(a.before["x"]) < 0.4 and one.events[1].target == "→ x < a"
    assert one.at(a.t + 1e-6)["F"] == -0.8 and other.at(b + 1e-6)["F"] == 0.8
    assert (
        abs(one.final["x"] - other.final["x"]) > 0.01
        and np.abs(one.at(np.array([4.0]))["x"] - other.at(np.array([4.0]))["x"])[0] > 1
    )


def test_answers_of_the_tasks(system):
    """1 half the loop; 3 a start with a direction; 4 where the first turn falls inside the loop.

    5 the damped self-oscillation.
    """
    ninth = turns(simulate(system, 60.0, h=0, a=0.2))[8]
    assert (round(ninth.before["x"], 3), round(ninth.t, 2)) == (3.6, 39.55)
    for first in (1, -1):
        firsts = [
            turns(simulate(system, 10.0, start={"v": v}, first=first))[0].before["x"]
            for v in (0.01, -0.01)
        ]
        assert [round(x, 3) for x in firsts] == [3.035, -0.413]
    inside = [
        abs(turns(simulate(system, 10.0, h=h, first=-1))[0].before["x"]) < 0.4
        for h in (1.0, 1.05, 1.103, 1.105, 1.2, 1.5)
    ]
    assert inside == [False, False, False, True, True, True]
    for delta, amplitude in ((0.1, 2.60), (0.2, 1.65)):
        for x in (0.5, 8.0):
            last = turns(simulate(system, 200.0, h=0, delta=delta, start={"x": x}))[-1]
            assert abs(last.before["x"]) == pytest.approx(amplitude, abs=0.005)


def test_one_character_chooses_the_future(book):
    right, left = (
        simulate(book[name], 10.0, rtol=1e-10, points=10001) for name in ("blind", "blind_too")
    )
    assert right["x"].max() == pytest.approx(3.035, abs=1e-3) and left["x"].max() == pytest.approx(
        1.243, abs=1e-3
    )


def test_location_pays(book, system):
    """The claims of section 6: less error and less work at one tolerance.

    Order 4 with located events, order 1 without.
    """
    x = book["exact"](60.0)[1]

    def trial(model, **options):
        run = simulate(model, 60.0, points=2, **options)
        return abs(run.final["x"] - x), run.work.evaluations

    for method in ("RK45", "DOP853"):
        located, blind = (
            trial(system, method=method, rtol=1e-8, atol=1e-10),
            trial(book["blind"], method=method, rtol=1e-8, atol=1e-10),
        )
        assert blind[0] > 10 * located[0] and blind[1] > 1.3 * located[1]
    coarse, fine = (trial(system, method="RK4", step=step)[0] for step in (0.6, 0.0375))
    assert fine < coarse / 16**3
    assert all(trial(book["blind"], method="RK4", step=step)[0] > 1e-2 for step in (0.6, 0.0375))
