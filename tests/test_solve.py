"""The engine against closed forms, SciPy and itself: both back ends, every method, events.

Schedules, dead times, bad input.
"""

import math
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from labkit import (
    METHODS,
    At,
    Every,
    Mode,
    ModelError,
    Parameter,
    System,
    Transition,
    simulate,
    simulate_many,
)
from labkit.solve import backend as backends
from labkit.solve import cache

from . import systems

pytestmark = [
    pytest.mark.filterwarnings("error"),
    # what is collected here may be another file's garbage
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
BOTH = ("plain", "compiled")
EXPLICIT = ("Euler", "Heun", "RK4", "RK45", "DOP853")


# ---------------------------------------------------------------- smooth problems


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("method", ["RK45", "DOP853"])
def test_spiral_against_the_exact_solution(method, backend):
    run = simulate(systems.spiral(), 10.0, method=method, rtol=1e-10, atol=1e-12, backend=backend)
    exact = systems.spiral_exact(run.t)
    assert np.abs(exact - [run["s1"], run["s2"]]).max() <= 1e-9
    t = np.linspace(0.013, 9.97, 777)  # between the samples too
    assert np.abs(systems.spiral_exact(t) - [run.at(t)["s1"], run.at(t)["s2"]]).max() <= 1e-9
    assert run.stopped == "finished" and run.t[0] == 0 and run.t[-1] == 10


@pytest.mark.parametrize("method", ["LSODA", "Radau", "BDF"])
def test_scipy_methods_against_the_exact_solution(method):
    run = simulate(systems.spiral(), 10.0, method=method, rtol=1e-9, atol=1e-11)
    assert np.abs(systems.spiral_exact(run.t) - [run["s1"], run["s2"]]).max() <= 2e-7
    assert run.work.method == method and run.work.evaluations > 100


@pytest.mark.parametrize("method", ["LSODA", "Radau", "BDF"])
def test_scipy_methods_end_one_tick_after_an_event(method):
    """0.1 + 0.1 + … passes 0.7 and 3 by one tick of the clock, where LSODA does not start."""
    system = one_mode(
        lambda t, s, p: (1.0, 0.0), transitions=[Transition("motion", "motion", at=Every(0.1))]
    )
    for end in (np.nextafter(0.7, 1), np.nextafter(3.0, 4)):
        run = simulate(system, end, method=method)
        assert run.stopped == "finished" and run.t[-1] == end and len(run.events) == round(10 * end)
        assert run.final["x"] == pytest.approx(run.start["x"] + end, abs=1e-12)


@pytest.mark.parametrize(("method", "order"), [("Euler", 1), ("Heun", 2), ("RK4", 4)])
def test_order_of_the_fixed_step_methods(method, order):
    errors = [
        np.abs(
            systems.spiral_exact(np.array([2.0]))[:, 0]
            - list(simulate(systems.spiral(), 2.0, method=method, step=h).final.values())
        ).max()
        for h in (0.02, 0.01)
    ]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("method", ["RK45", "DOP853"])
def test_same_numbers_as_scipy(method):
    """Same tableau, same step control: SciPy's accepted steps are reproduced."""
    run = simulate(systems.spiral(), 10.0, method=method, rtol=1e-6, atol=1e-9, backend="plain")
    system = systems.spiral()
    scipy = solve_ivp(
        lambda t, y: system.modes["motion"].flow(t, system.S["motion"](*y), system.values()),
        (0, 10),
        [4.0, -2.0],
        method=method,
        rtol=1e-6,
        atol=1e-9,
    )
    ours = run.at(scipy.t)
    assert np.allclose([ours["s1"], ours["s2"]], scipy.y, rtol=0, atol=1e-12)
    assert run.work.steps == len(scipy.t) - 1


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-3, 0.5),
    st.floats(-4, 4),
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.sampled_from(["RK45", "DOP853"]),
)
def test_both_back_ends_give_the_same_numbers(alpha, beta, x, y, method):
    plain, fast = (
        simulate(
            SPIRAL,
            5.0,
            alpha=alpha,
            beta=beta,
            start={"s1": x, "s2": y},
            method=method,
            rtol=1e-7,
            backend=b,
        )
        for b in BOTH
    )
    assert (plain.work.steps, plain.work.rejected, plain.work.evaluations) == (
        fast.work.steps,
        fast.work.rejected,
        fast.work.evaluations,
    )
    assert np.allclose(plain.values, fast.values, rtol=1e-11, atol=1e-11)


SPIRAL = systems.spiral()


@pytest.mark.parametrize(
    "make", [systems.ball, systems.stick_slip, systems.relay, systems.heater, systems.circuit]
)
def test_both_back_ends_give_the_same_events(make):
    system = make()
    plain, fast = (simulate(system, 12.0, backend=b) for b in BOTH)
    assert [e.transition for e in plain.events] == [e.transition for e in fast.events] and len(
        plain.events
    ) > 2
    assert np.allclose([e.t for e in plain.events], [e.t for e in fast.events], rtol=0, atol=1e-11)
    assert np.allclose(plain.t, fast.t, atol=1e-11) and np.allclose(
        plain.values, fast.values, atol=1e-9
    )
    assert plain.work.steps == fast.work.steps and plain.stopped == fast.stopped


# ---------------------------------------------------------------- the handbook's checks


@pytest.mark.parametrize("method", METHODS)
def test_dry_friction_first_slip(method):
    run = simulate(systems.stick_slip(), 3.0, method=method, rtol=1e-10, atol=1e-12)
    assert run.events[0].transition == "break loose"
    assert abs(run.events[0].t - 5.88 / (2 * 2)) <= (
        1e-10 if method != "LSODA" else 1e-8
    )  # LSODA's interpolant is of lower order


def test_a_guard_that_leaves_zero_late_is_not_halved_down_to_nothing():
    """The block breaks loose with v = 0 and v' = 0, in a step that 25 halvings took apart."""
    run = simulate(systems.stick_slip(), 1.6, rtol=1e-8, backend="plain")
    assert len(run.events) == 1 and run.work.guard_evaluations < 200


def test_dry_friction_cycle_against_scipy():
    """The slip phase.

    Integrated by SciPy between the exact release and the stop found on its own.
    """
    run = simulate(systems.stick_slip(), 30.0, rtol=1e-10, atol=1e-12)
    system = systems.stick_slip()
    p = system.values()

    def stop(t, y):
        return y[1]

    stop.terminal, stop.direction = True, -1
    release = 1.47
    whole = solve_ivp(
        lambda t, y: system.modes["slip"].flow(t, system.S["slip"](*y), p),
        (release, 10),
        [2.94, 1e-14],
        rtol=1e-12,
        atol=1e-13,
        method="DOP853",
        max_step=0.05,
        events=stop,
    )
    assert run.events[1].t == pytest.approx(whole.t_events[0][0], abs=1e-8)
    gaps = np.diff([e.t for e in run.events[::2]])
    assert (
        np.ptp(gaps) < 1e-8 and len(run.events) == 13
    )  # a limit cycle, thirteen events in thirty seconds
    assert np.all(run["V"] >= -1e-12)


def relay_exact(t_end, mu=1.2, K=0.8, a=0.4):
    """Piece by piece: x'' = (sin t ∓ K)/μ integrated by hand.

    Switches bracketed on a fine grid and found by Brent's method.
    """
    t, x, v, mode = 0.0, 0.0, 0.0, "right, pulled"
    sign = {"right, pulled": -1, "right, held": 1, "left, held": 1, "left, pulled": -1}
    switches = []
    while True:
        s = sign[mode]

        def V(q, t=t, v=v, s=s):
            return v + (np.cos(t) - np.cos(q) - s * K * (q - t)) / mu

        def X(q, t=t, x=x, v=v, s=s):
            shake = np.cos(t) * (q - t) - np.sin(q) + np.sin(t)
            return x + v * (q - t) + (shake - s * K * (q - t) ** 2 / 2) / mu

        guards = {
            "right, pulled": [
                (lambda q, X=X: X(q) - a, "right, held"),
                (lambda q, V=V: -V(q), "left, pulled"),
            ],
            "right, held": [(lambda q, V=V: -V(q), "left, held")],
            "left, held": [(lambda q, X=X: -X(q) - a, "left, pulled"), (V, "right, held")],
            "left, pulled": [(V, "right, pulled")],
        }[mode]
        grid = t + 1e-7 + np.linspace(0, 15, 30001)
        found = []
        for guard, target in guards:
            values = guard(grid)
            rises = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
            if len(rises):
                found.append(
                    (brentq(guard, grid[rises[0]], grid[rises[0] + 1], xtol=1e-15), target)
                )
        when, target = min(found)
        if when > t_end:
            return switches, X(t_end), V(t_end)
        switches.append((when, target))
        t, x, v, mode = when, X(when), V(when), target


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("method", ["RK45", "DOP853"])
def test_relay_against_the_piecewise_exact_solution(method, backend):
    run = simulate(systems.relay(), 40.0, method=method, rtol=1e-10, atol=1e-12, backend=backend)
    switches, x, v = relay_exact(40.0)
    assert [e.target for e in run.events] == [target for _, target in switches]
    assert np.abs(np.array([e.t for e in run.events]) - [t for t, _ in switches]).max() <= 1e-8
    assert abs(run.final["x"] - x) <= 1e-8 and abs(run.final["v"] - v) <= 1e-8


def test_relay_extremes_of_the_handbook_sample():
    run = simulate(systems.relay(), 10.0)
    turns = [e for e in run.events if e.transition == "turn"]
    assert [round(e.t, 3) for e in turns[:2]] == [3.967, 8.503]
    assert [round(e.before["x"], 3) for e in turns[:2]] == [3.035, -4.092]
    other = simulate(systems.relay(), 10.0, mode="left, held")
    first = next(e for e in other.events if e.transition == "turn")
    assert (round(first.t, 3), round(first.before["x"], 3)) == (1.966, -0.410)


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("e", [0.1, 0.5, 0.8, 0.9])
def test_ball_zeno_time(e, backend):
    run = simulate(systems.ball(), 100.0, e=e, backend=backend)
    exact = math.sqrt(2 * 10 / 9.81) * (1 + e) / (1 - e)
    assert run.events[-1].target == "rest" and run.events[-1].t == pytest.approx(exact, rel=1e-9)
    assert run.stopped == "finished" and abs(run.final["v"]) < 1e-9 and np.all(run["y"] > -1e-9)
    stops = simulate(systems.ball(zeno=None), 100.0, e=e, backend=backend)
    assert stops.stopped.startswith("Zeno at t = ") and '"bounce"' in stops.stopped


def test_ball_without_loss_keeps_its_energy():
    run = simulate(systems.ball(), 60.0, e=1.0, rtol=1e-10)
    exact = math.sqrt(2 * 10 / 9.81) * np.arange(1, 100, 2)
    assert (
        np.allclose([e.t for e in run.events], exact[: len(run.events)], rtol=0, atol=1e-9)
        and len(run.events) == 21
    )
    assert np.allclose(0.5 * run["v"] ** 2 + 9.81 * run["y"], 98.1, rtol=1e-9)


def test_ball_that_does_not_bounce_rests():
    run = simulate(systems.ball(), 5.0, e=0.0)
    assert [e.target for e in run.events] == ["flight", "rest"] and run.final["y"] == 0
    assert simulate(systems.ball(zeno=None), 5.0, e=0.0).stopped.startswith("resting contact")


def test_heater_limit_cycle_with_dead_time():
    run = simulate(systems.heater(), 24.0, rtol=1e-10, atol=1e-12)
    up = 10 - (10 - 5.5) * math.exp(-0.2)
    down = 4.5 * math.exp(-0.2)
    late = run.t > 3
    assert run["tau"][late].max() == pytest.approx(up, abs=1e-8) and run["tau"][
        late
    ].min() == pytest.approx(down, abs=1e-8)
    period = math.log((10 - down) / (10 - up)) + math.log(up / down)
    on = [e.t for e in run.events if e.target == "on"]
    assert period == pytest.approx(1.0779, abs=1e-4) and np.allclose(np.diff(on), period, atol=1e-8)
    assert (round(down + 15, 3), round(up + 15, 3)) == (18.684, 21.316)


def test_circuit_against_matrix_exponentials():
    run = simulate(systems.circuit(), 10.0, rtol=1e-10, atol=1e-12)
    y, rest = np.zeros(2), np.array([0, 5.0])
    for k in range(10):
        A = np.array([[-(1.0, 4.0)[k % 2] / 0.5, -2.0], [5.0, 0.0]])
        y = rest + expm(A) @ (y - rest)
    assert np.abs(y - list(run.final.values())).max() < 1e-9
    assert [e.t for e in run.events] == list(range(1, 11)) and [e.target for e in run.events] == [
        "R2",
        "R1",
    ] * 5


# ---------------------------------------------------------------- events


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("method", ["RK45", "DOP853"])
@pytest.mark.parametrize("depth", [1e-1, 1e-4, 1e-7, 1e-10])
def test_pairs_of_crossings_within_one_step(depth, method, backend):
    """sin t above 1 − depth: two crossings ever closer together, whatever the phase."""
    limit = 1.0 - depth
    for phase in np.linspace(0, 2 * math.pi, 5, endpoint=False):
        system = (
            System(
                "dip",
                {"x": "", "n": ""},
                {"limit": limit, "phase": float(phase)},
                [Mode("only", lambda t, s, p: (math.cos(t + p.phase), 0.0))],
                [
                    Transition(
                        "only",
                        "only",
                        guard=lambda t, s, p: math.sin(t + p.phase) - p.limit,
                        direction=d,
                        urgent=False,
                        reset=lambda t, s, p: (s.x, s.n + 1),
                    )
                    for d in (1, -1)
                ],
                start={"x": math.sin(phase), "n": 0.0},
            )
            if phase == 0
            else system  # noqa: F821 (of the round before)
        )
        run = simulate(
            system,
            20 * math.pi,
            method=method,
            phase=phase,
            start={"x": math.sin(phase)},
            backend=backend,
        )
        assert run.final["n"] == 20, (depth, phase)


def test_directions():
    def crossings(direction):
        system = systems.oscillator(
            transitions=[
                Transition(
                    "motion", "motion", guard=lambda t, s, p: s.x, direction=direction, urgent=False
                )
            ]
        )
        return [e.t for e in simulate(system, 10.0, rtol=1e-10, atol=1e-12).events]

    zeros = [math.pi * (k + 0.5) for k in range(3)]
    assert np.allclose(crossings(0), zeros, atol=1e-9)
    assert np.allclose(crossings(-1), zeros[::2], atol=1e-9) and np.allclose(
        crossings(1), zeros[1::2], atol=1e-9
    )


@pytest.mark.parametrize("backend", BOTH)
def test_no_second_event_after_a_reset(backend):
    """With the state put exactly on the surface, kept as it is, and moved through.

    One event a crossing.
    """
    for reset in (None, lambda t, s, p: (0.0, s.v), lambda t, s, p: (s.x, 0.5 * s.v)):
        system = systems.oscillator(
            transitions=[
                Transition("motion", "motion", guard=lambda t, s, p: s.x, direction=-1, reset=reset)
            ]
        )
        run = simulate(system, 20.0, backend=backend)
        assert len(run.events) == 3


def test_guard_zero_at_the_start():
    for v, events in (
        (1.0, 1),
        (-1.0, 2),
    ):  # x starts on the surface: leaving upwards is no event, downwards is
        system = systems.oscillator(
            transitions=[Transition("motion", "motion", guard=lambda t, s, p: s.x, direction=-1)]
        )
        run = simulate(system, 6.5, start={"x": 0.0, "v": v})
        assert len(run.events) == events and run.events[0].t == (
            pytest.approx(math.pi) if v > 0 else 0.0
        )


def test_guards_at_one_instant_go_by_priority():
    def counting(k):
        return lambda t, s, p: (s.x, s.log * 10 + k)

    def make(priorities):
        return System(
            "clock",
            {"x": "", "log": ""},
            {},
            [Mode("run", lambda t, s, p: (1.0, 0.0))],
            [
                Transition(
                    "run",
                    "run",
                    guard=lambda t, s, p: s.x - 1,
                    direction=1,
                    priority=q,
                    reset=counting(k + 1),
                )
                for k, q in enumerate(priorities)
            ],
            start={"x": 0.0, "log": 0.0},
        )

    assert simulate(make([0, 0, 0]), 2.0).final["log"] == 123
    assert simulate(make([0, 1, 2]), 2.0).final["log"] == 321
    assert simulate(make([1, 0, 1]), 2.0).final["log"] == 132


def test_urgent_and_edge():
    def make(urgent):
        return System(
            "door",
            {"x": ""},
            {},
            [
                Mode("a", lambda t, s, p: (1.0,)),
                Mode("b", lambda t, s, p: (1.0,)),
                Mode("c", lambda t, s, p: (1.0,)),
            ],
            [
                Transition("a", "b", guard=lambda t, s, p: s.x - 2, direction=1),
                Transition("b", "c", guard=lambda t, s, p: s.x - 1, direction=1, urgent=urgent),
            ],
            start={"x": 0.0},
        )

    fired = simulate(make(True), 4.0)
    assert [e.target for e in fired.events] == ["b", "c"] and fired.events[0].t == fired.events[1].t
    assert [e.target for e in simulate(make(False), 4.0).events] == ["b"]


def test_touching_a_limit_is_no_event_within_the_tolerance():
    def destroyed(tolerance, amplitude):
        system = systems.oscillator(
            transitions=[
                Transition(
                    "motion",
                    None,
                    guard=lambda t, s, p: s.x - 1,
                    direction=1,
                    tolerance=tolerance,
                    label="destroyed",
                )
            ]
        )
        return simulate(system, 30.0, start={"x": 0.0, "v": amplitude}).stopped

    assert destroyed(1e-6, 1.0) == "finished"
    assert destroyed(1e-6, 1.00001) == 'terminal event "destroyed"'


@pytest.mark.parametrize("backend", BOTH)
def test_touched_limits_are_reported(backend):
    """x = a sin t comes up to 1 every 2π: passed and missed by less than the tolerance of 1e-6.

    Which are touches, and by more.
    """
    system = systems.oscillator(
        transitions=[
            Transition(
                "motion",
                "motion",
                guard=lambda t, s, p: s.x - 1,
                direction=1,
                tolerance=1e-6,
                label="limit",
            )
        ]
    )
    peaks = np.pi / 2 + 2 * np.pi * np.arange(5)
    for amplitude, seen in (
        (1 + 1e-8, 5),
        (1 + 5e-7, 5),
        (1 - 1e-8, 5),
        (1 - 2e-6, 0),
        (0.9, 0),
        (1 + 2e-6, 0),
    ):
        run = simulate(
            system, 30.0, start={"x": 0.0, "v": amplitude}, rtol=1e-12, atol=1e-13, backend=backend
        )
        assert len(run.touches) == seen, amplitude
        assert len(run.events) == (5 if amplitude > 1 + 1e-6 else 0)
        if seen:
            assert np.allclose(
                [touch.t for touch in run.touches], peaks, atol=1e-4
            )  # a peak's place is known to the root of rounding
            assert np.allclose([touch.by for touch in run.touches], amplitude - 1, atol=1e-10)
            assert "touched, no event" in run.ledger()


def test_terminal_event_ends_the_output():
    system = systems.oscillator(
        transitions=[
            Transition("motion", None, guard=lambda t, s, p: s.x, direction=-1, label="through")
        ]
    )
    run = simulate(system, 10.0, rtol=1e-11, atol=1e-13)
    assert run.stopped == 'terminal event "through"' and run.t[-1] == run.events[
        -1
    ].t == pytest.approx(math.pi / 2, abs=1e-10)
    assert run["x"][-1] <= 0 and run.events[-1].target is None  # on the far side
    with pytest.raises(ModelError, match="outside the run"):
        run.at(1.6)


@pytest.mark.parametrize("backend", BOTH)
def test_one_end_of_modes_with_variables_of_their_own(backend):
    """A body that falls (y, v) and then sinks (y, d): either may meet the wall, under one label."""
    system = System(
        "wall",
        {"x": "m", "y": "m", "v": "m/s"},
        {"x_wall": 3.0},
        [
            Mode("falls", lambda t, s, p: (1.0, s.v, -2.0)),
            Mode("sinks", lambda t, s, p: (1.0, 0.5), states={"x": "m", "d": "m"}),
        ],
        [
            Transition("falls", "sinks", guard=lambda t, s, p: s.y, direction=-1, reset={"d": 0.0}),
            Transition(
                ("falls", "sinks"),
                None,
                guard=lambda t, s, p: s.x - p.x_wall,
                direction=+1,
                label="wall",
            ),
        ],
        start={"x": 0.0, "y": 1.0, "v": 0.0},
    )
    sunk = simulate(system, 10.0, backend=backend)
    assert sunk.stopped == 'terminal event "wall"'
    assert sunk.final == pytest.approx({"x": 3.0, "d": 1.0})
    fallen = simulate(system, 10.0, x_wall=0.5, backend=backend)
    assert fallen.final == pytest.approx({"x": 0.5, "y": 0.75, "v": -1.0})


def test_schedules():
    system = System(
        "clock",
        {"x": ""},
        {"T": 0.1, "d": Parameter(0.3, "", "", 0, 1)},
        [Mode("on", lambda t, s, p: (1.0,)), Mode("off", lambda t, s, p: (0.0,))],
        [
            Transition("on", "off", at=Every("T", first=lambda p: p.d * p.T)),
            Transition("off", "on", at=Every("T")),
            Transition("on", "on", at=At(0.35, 0.72), reset=lambda t, s, p: (s.x + 100,)),
        ],
        start={"x": 0.0},
    )
    run = simulate(system, 10.0, method="RK45")
    assert run.final["x"] == pytest.approx(
        10 * 0.3 + 100, abs=1e-9
    )  # 0.35 falls into "off" and is dropped
    starts = [e.t for e in run.events if e.target == "on" and e.source == "off"]
    assert starts == [0.1 * k for k in range(1, 101)]  # k·T, not a sum
    assert simulate(system, 1.0, d=0.6).final["x"] == pytest.approx(0.6 + 200, abs=1e-9)


def test_overlapping_dead_times():
    """A square wave delayed by more than its period: each crossing arrives, in order."""
    system = System(
        "far sensor",
        {"n": ""},
        {"Td": 7.0},
        [Mode("only", lambda t, s, p: (0.0,))],
        [
            Transition(
                "only",
                "only",
                guard=lambda t, s, p: math.sin(t),
                direction=1,
                delay="Td",
                reset=lambda t, s, p: (s.n + 1,),
            )
        ],
        start={"n": 0.0},
    )
    run = simulate(system, 40.0, max_step=0.5)
    crossings = [2 * math.pi * k for k in range(0, 6)]
    assert np.allclose(
        [e.t - 7.0 for e in run.events], [t for t in crossings if t + 7 < 40], atol=1e-9
    )


def test_modes_with_their_own_states():
    def fly(t, s, p):
        return s.vx, s.vy, 0.0, -p.g

    system = System(
        "torn pendulum",
        {"theta": "rad", "w": "rad/s"},
        {"L": 2.0, "g": 9.81, "m": 1.0, "Tc": 25.0},
        [
            Mode("swing", lambda t, s, p: (s.w, -p.g / p.L * math.sin(s.theta))),
            Mode("flight", fly, states={"x": "m", "y": "m", "vx": "m/s", "vy": "m/s"}),
        ],
        [
            Transition(
                "swing",
                "flight",
                guard=lambda t, s, p: p.m * (p.L * s.w**2 + p.g * math.cos(s.theta)) - p.Tc,
                direction=1,
                label="tear",
                reset=lambda t, s, p: (
                    p.L * math.sin(s.theta),
                    -p.L * math.cos(s.theta),
                    p.L * s.w * math.cos(s.theta),
                    p.L * s.w * math.sin(s.theta),
                ),
            )
        ],
        start={"theta": math.pi / 2, "w": 0.0},
    )
    for backend in BOTH:
        run = simulate(system, 4.0, rtol=1e-10, atol=1e-12, backend=backend)
        (tear,) = run.events
        assert math.cos(tear.before["theta"]) == pytest.approx(
            25 / (3 * 9.81), abs=1e-9
        )  # the tension is 3 m g cos θ
        assert math.hypot(tear.after["vx"], tear.after["vy"]) == pytest.approx(
            2 * abs(tear.before["w"])
        )
        energy = 0.5 * (run["vx"] ** 2 + run["vy"] ** 2) + 9.81 * run["y"]
        assert (
            np.nanmax(np.abs(energy)) < 1e-8
            and np.isnan(run["x"][0])
            and np.isnan(run["theta"][-1])
        )


def test_hybrid_time_is_well_formed():
    for system in (systems.ball(), systems.relay(), systems.circuit(), systems.heater()):
        run = simulate(system, 13.0)
        advanced_t, advanced_j = np.diff(run.t), np.diff(run.j)
        assert (
            np.all((advanced_t > 0) ^ (advanced_j == 1))
            and np.all(advanced_t >= 0)
            and np.all(advanced_j >= 0)
        )
        assert run.j[-1] == len(run.events)


def test_before_and_after_an_event():
    run = simulate(systems.ball(), 5.0, rtol=1e-10)
    bounce = run.events[0]
    assert run.at(bounce.t, side="before")["v"] == pytest.approx(bounce.before["v"]) and run.at(
        bounce.t
    )["v"] == pytest.approx(bounce.after["v"])
    assert bounce.after["v"] == pytest.approx(-0.8 * bounce.before["v"])


def test_without_event_location_the_bounce_comes_late():
    located = simulate(systems.ball(), 2.0, method="RK45", max_step=0.1)
    late = simulate(systems.ball(), 2.0, method="RK45", max_step=0.1, locate=False)
    assert located.events[0].before["y"] == pytest.approx(0, abs=1e-12)
    assert late.events[0].t > located.events[0].t and late.events[0].before["y"] < -0.01


# ---------------------------------------------------------------- many at once


@pytest.mark.parametrize("backend", BOTH)
def test_many_runs_are_the_single_runs(backend):
    heights, losses = np.linspace(1, 20, 7), np.linspace(0.5, 0.9, 7)
    system = systems.ball()
    runs = simulate_many(
        system, 6.0, start={"y": heights}, e=losses, rtol=1e-8, atol=1e-10, backend=backend
    )
    assert len(runs) == 7 and runs["y"].shape == runs.t.shape
    for i, lane in enumerate(runs):
        one = simulate(
            system,
            6.0,
            start={"y": heights[i]},
            e=losses[i],
            points=300,
            atol=1e-10,
            backend=backend,
        )
        assert np.array_equal(lane.t, one.t) and np.array_equal(lane["y"], one["y"])
        assert (
            runs.final["v"][i] == one.final["v"]
            and runs.stopped[i] == one.stopped
            and runs.events[i] == len(one.events)
        )


# ---------------------------------------------------------------- runs that cannot go on


@pytest.mark.parametrize("backend", BOTH)
def test_lanes_that_end_for_different_reasons_keep_apart(backend):
    """Finished, terminal, diverged, with many events and few: each lane is what it would be alone.

    Whatever ran before it in the same workspace.
    """
    fall = Mode("fall", lambda t, s, p: (s.v, p.x * s.y * s.y - p.g))
    system = System(
        "many fates",
        states={"y": "m", "v": "m/s"},
        parameters={"g": 10.0, "x": 0.0},
        modes=[fall],
        start={"y": 1.0, "v": 0.0},
        transitions=[
            Transition(
                "fall",
                "fall",
                guard=lambda t, s, p: s.y,
                direction=-1,
                reset=lambda t, s, p: (0.0, -0.9 * s.v),
                label="bounce",
            ),
            Transition(
                "fall",
                None,
                guard=lambda t, s, p: s.y - 5.2 - 1e200 * p.x,
                direction=1,
                label="too high",
            ),
        ],
    )
    start = {"y": np.tile([0.2, 1.0, 3.0, 5.0], 15), "v": np.linspace(-1, 5, 60)}
    x = np.where(np.arange(60) % 5 == 0, 2.0, 0.0)
    runs = simulate_many(
        system, 1.5, start=start, x=x, points=7, rtol=1e-8, atol=1e-10, backend=backend
    )
    assert {reason.split(":")[0].split(" ")[0] for reason in runs.stopped} == {
        "finished",
        "terminal",
        "diverged",
    }
    for lane, row in enumerate(runs):
        alone = simulate(
            system,
            1.5,
            start={key: value[lane] for key, value in start.items()},
            x=x[lane],
            points=7,
            rtol=1e-8,
            atol=1e-10,
            backend=backend,
        )
        assert runs.stopped[lane] == alone.stopped and runs.events[lane] == len(alone.events)
        assert (
            np.array_equal(row.t, alone.t)
            and np.array_equal(row["y"], alone["y"])
            and np.array_equal(row["v"], alone["v"])
        )
        assert runs.final["v"][lane] == alone.final["v"]


@pytest.mark.parametrize("backend", BOTH)
def test_a_workspace_used_again_leaves_no_trace(backend):
    """The same options meet the same memory: a run after others is bit for bit the first one."""
    for make in (systems.relay, systems.stick_slip, systems.ball, systems.heater):
        system = make()
        name = next(iter(system.parameters))
        first = simulate(system, 15.0, backend=backend)
        value = first.p[0]
        for factor in (0.9, 1.1):
            simulate(system, 15.0, backend=backend, **{name: value * factor})
        again = simulate(system, 15.0, backend=backend)
        assert (
            np.array_equal(first.t, again.t)
            and np.array_equal(first.values, again.values, equal_nan=True)
            and np.array_equal(first.pieces, again.pieces)
        )
        assert first.events == again.events and first.work.evaluations == again.work.evaluations


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize(
    ("method", "rtol", "bound"),
    [("RK45", 1e-5, 1e-4), ("RK45", 1e-7, 2e-6), ("DOP853", 1e-5, 1e-4), ("DOP853", 1e-7, 1e-6)],
)
def test_events_are_as_accurate_as_the_tolerance(method, rtol, bound, backend):
    """Located on a step's interpolant alone the instants would be 10 to 50 times worse."""
    switches, x, v = relay_exact(40.0)
    run = simulate(systems.relay(), 40.0, method=method, rtol=rtol, atol=rtol, backend=backend)
    assert len(run.events) == len(switches)
    assert (
        max(abs(event.t - when) for event, (when, _) in zip(run.events, switches, strict=True))
        < bound
    )
    assert abs(run.final["x"] - x) < bound


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_dop853_is_good_between_its_steps_too(rtol):
    """A mildly stiff node: the ends of its long steps are right.

    And without a look at the polynomial what lies between is wrong by 1e-4 at rtol 1e-8.
    """
    node = System(
        "node",
        states={"x": "", "y": ""},
        parameters={},
        start={"x": 1.0, "y": 2.0},
        modes=[Mode("m", lambda t, s, p: (-0.1 * s.x, -2.6 * s.y + 2.5 * s.x))],
    )
    run = simulate(node, 40.0, rtol=rtol, atol=rtol, points=2000)
    exact = np.exp(-0.1 * run.t) + np.exp(-2.6 * run.t)
    assert abs(run["y"] - exact).max() < 30 * rtol
    assert run.work.steps < 60  # and it is no matter of tiny steps


def test_fixed_steps_keep_the_clock():
    """A thousand steps of a thousandth are a thousand steps.

    And the flow is advanced by what the clock shows.
    """
    run = simulate(systems.oscillator(), 7.3, method="RK4")
    assert run.work.steps == 1000
    clock = System(
        "clock",
        states={"c": ""},
        parameters={},
        start={"c": 0.0},
        modes=[Mode("m", lambda t, s, p: (1.0,))],
    )
    run = simulate(clock, 1e5, method="Euler", step=0.1, points=2)
    assert abs(run.final["c"] - 1e5) < 1e-8


def test_runs_end_with_a_named_reason_and_keep_what_there_is():
    blow = System(
        "blow-up", {"x": ""}, {}, [Mode("only", lambda t, s, p: (s.x**2,))], start={"x": 1.0}
    )
    for backend in BOTH:
        run = simulate(blow, 2.0, backend=backend)
        assert (
            run.stopped.startswith("diverged: |x|")
            and run.t[-1] == pytest.approx(1, abs=1e-6)
            and run.work.steps > 10
        )
        root = System(
            "root",
            {"x": ""},
            {},
            [Mode("only", lambda t, s, p: (-math.sqrt(s.x) - 1,))],
            start={"x": 1.0},
        )
        run = simulate(root, 2.0, backend=backend)
        assert (
            run.stopped.startswith("not a number: the flow of mode 'only' fails near")
            and ", x = " in run.stopped
            and 0 < run.t[-1] < 1
        )
        assert simulate(systems.ball(), 12.0, max_events=5, backend=backend).stopped.startswith(
            "too many events: 5 by "
        )
        assert simulate(systems.spiral(), 12.0, max_steps=7, backend=backend).stopped.startswith(
            "too many steps: 7 by "
        )
    stiff = System(
        "stiff",
        {"x": ""},
        {"k": 1e6},
        [Mode("only", lambda t, s, p: (-p.k * (s.x - math.cos(t)),))],
        start={"x": 0.0},
    )
    assert simulate(stiff, 10.0, max_steps=2000).stopped.startswith("too many steps")
    run = simulate(stiff, 10.0, method="Radau", max_steps=2000)
    assert run.stopped == "finished" and run.final["x"] == pytest.approx(math.cos(10), abs=1e-5)
    assert simulate(systems.oscillator(), 50.0, method="Euler", w=1e9, step=1.0).stopped.startswith(
        ("diverged", "not a number")
    )


# ---------------------------------------------------------------- sliding (Filippov)


def drifting(A):
    """x' = −sign x + A sin t: for A ≤ 1 the state stays on x = 0 for ever.

    Else it leaves where A sin t = ±1.
    """
    return System(
        "drift",
        {"x": ""},
        {"A": A},
        [
            Mode("plus", lambda t, s, p: (-1.0 + p.A * math.sin(t),)),
            Mode("minus", lambda t, s, p: (1.0 + p.A * math.sin(t),)),
        ],
        [
            Transition("plus", "minus", guard=lambda t, s, p: s.x, direction=-1, label="down"),
            Transition("minus", "plus", guard=lambda t, s, p: s.x, direction=1, label="up"),
        ],
        start={"x": 1.0},
    )


@pytest.mark.parametrize("backend", BOTH)
def test_sliding_on_a_line(backend):
    run = simulate(drifting(0.5), 20.0, backend=backend)
    assert [e.target for e in run.events] == ["minus", "sliding"] and run.stopped == "finished"
    reached = brentq(lambda t: 1 - t + 0.5 * (1 - math.cos(t)), 0, 3)
    assert (
        run.events[1].t == pytest.approx(reached, abs=1e-8)
        and np.abs(run["x"][run.t > reached]).max() < 1e-12
    )


@pytest.mark.parametrize("backend", BOTH)
def test_sliding_ends_where_one_flow_no_longer_pushes(backend):
    run = simulate(drifting(1.5), 30.0, rtol=1e-10, atol=1e-12, backend=backend)
    ends = [e.t for e in run.events if e.source == "sliding"]
    exact = [
        math.pi * k + math.asin(1 / 1.5)
        for k in range(1, 10)
        if math.pi * k + math.asin(1 / 1.5) < 30
    ]
    assert np.allclose(ends, exact, rtol=0, atol=1e-9) and run.stopped == "finished"
    assert [e.target for e in run.events if e.source == "sliding"] == ["minus", "plus"] * (
        len(ends) // 2
    ) + ["minus"] * (len(ends) % 2)


@pytest.mark.parametrize(
    ("method", "backend"),
    [
        ("RK45", "plain"),
        ("DOP853", "plain"),
        ("RK45", "compiled"),
        ("DOP853", "compiled"),
        ("Radau", "plain"),
    ],
)
def test_sliding_in_the_plane(method, backend):
    """A double integrator under u = −sign(v + c x): on the line x decays as e^{−ct}.

    Whatever the size of the relay.
    """
    system = System(
        "variable structure",
        {"x": "", "v": ""},
        {"c": 1.0},
        [Mode("brake", lambda t, s, p: (s.v, -1.0)), Mode("push", lambda t, s, p: (s.v, 1.0))],
        [
            Transition("brake", "push", guard=lambda t, s, p: s.v + p.c * s.x, direction=-1),
            Transition("push", "brake", guard=lambda t, s, p: s.v + p.c * s.x, direction=1),
        ],
        start={"x": 1.0, "v": 0.0},
    )
    run = simulate(system, 8.0, method=method, rtol=1e-8, backend=backend)
    begin = next(e for e in run.events if e.target == "sliding")
    assert begin.t == pytest.approx(math.sqrt(3) - 1, abs=1e-7)  # 1 − t²/2 = t
    later = run.t > begin.t
    assert np.abs(run["x"][later] - begin.after["x"] * np.exp(begin.t - run.t[later])).max() < 1e-6
    assert np.abs(run["v"] + run["x"])[later].max() < (
        1e-6 if method == "Radau" else 1e-9
    )  # its interpolant has order 3


@pytest.mark.parametrize("backend", BOTH)
def test_other_guards_are_seen_while_sliding(backend):
    system = drifting(0.5)
    stop = Transition("minus", None, guard=lambda t, s, p: t - 5.0, direction=1, label="enough")
    system = System(
        "drift",
        {"x": ""},
        {"A": 0.5},
        list(system.modes.values()),
        [*system.transitions, stop],
        {"x": 1.0},
    )
    run = simulate(system, 20.0, backend=backend)
    assert run.stopped == 'terminal event "enough"' and run.t[-1] == pytest.approx(5, abs=1e-12)


@pytest.mark.parametrize("backend", BOTH)
def test_thousands_of_switches(backend):
    run = simulate(systems.ball(), 3000.0, e=1.0, backend=backend)
    period = 2 * math.sqrt(2 * 10 / 9.81)
    assert len(run.events) == int(3000 / period + 0.5) and run.stopped == "finished"


# ---------------------------------------------------------------- bad input


def one_mode(flow, **more):
    return System(
        "bad",
        {"x": "m", "v": "m/s"},
        {"k": Parameter(1.0, "N/m", "stiffness", 0, 10)},
        [Mode("motion", flow)],
        start={"x": 1.0, "v": 0.0},
        **more,
    )


def good(t, s, p):
    return s.v, -p.k * s.x


@pytest.mark.parametrize(
    ("system", "options", "words"),
    [
        (
            one_mode(lambda t, s, p: (s.v,)),
            {},
            "flow of mode 'motion' returns 1 values, but there are 2 states",
        ),
        (one_mode(lambda t, s, p: s.v), {}, "must return a tuple of 2 derivatives"),
        (one_mode(lambda t, s, p: None), {}, "must return a tuple"),
        (
            one_mode(lambda t, s, p: (s.v, float("nan"))),
            {},
            "returns nan for 'v' at the start, t = 0, x = 1, v = 0",
        ),
        (one_mode(lambda t, s, p: (s.v, 1 / s.v)), {}, "flow of mode 'motion' fails at the start"),
        (one_mode(lambda t, s, p: (s.v, -p.K * s.x)), {}, "unknown name"),
        (one_mode(good), {"k": 11.0}, r"parameter 'k' = 11 is outside its range \[0, 10\] N/m"),
        (one_mode(good), {"k": float("nan")}, "parameter 'k' must be finite"),
        (one_mode(good), {"K": 1.0}, "'K' is not a parameter of 'bad'; there are 'k'"),
        (one_mode(good), {"start": {"y": 1.0}}, "unknown state.*'y'"),
        (one_mode(good), {"start": {"x": float("inf")}}, "start of 'x' must be finite"),
        (one_mode(good), {"mode": "moving"}, "start mode 'moving' is not a mode"),
        (one_mode(good), {"mode": ""}, "start mode '' is not a mode"),
        (one_mode(good), {"mode": 0}, "mode"),
        (one_mode(good), {"mode": ["a"]}, "mode"),
        (one_mode(good), {"mode": lambda t, s, p: s.q}, "the start mode cannot be worked out"),
        (one_mode(good), {"t0": 5.0}, "t_end = 1 must lie after t0 = 5"),
        (one_mode(good), {"rtol": -1e-6}, "rtol = -1e-06"),
        (one_mode(good), {"atol": -1.0}, "atol = -1"),
        (one_mode(good), {"method": "RK9"}, "no method 'RK9'; there are 'Euler'"),
        (one_mode(good), {"backend": "fast"}, "no backend 'fast'"),
        (one_mode(good), {"step": 0.0}, "step = 0"),
        (one_mode(good), {"points": [0.5, 0.4]}, "rising order"),
        (one_mode(good), {"max_events": 0}, "max_events must be a whole number"),
        (
            one_mode(
                good,
                transitions=[
                    Transition(
                        "motion", None, guard=lambda t, s, p: s.x - 0.5, direction=1, label="stop"
                    )
                ],
            ),
            {},
            "the guard of 'stop' is already 0.5",
        ),
        (
            one_mode(good, transitions=[Transition("motion", None, guard=lambda t, s, p: s.x < 0)]),
            {},
            "return the number whose zero is the event",
        ),
        (
            one_mode(
                good,
                transitions=[
                    Transition(
                        "motion", "motion", guard=lambda t, s, p: s.x, reset=lambda t, s, p: (0.0,)
                    )
                ],
            ),
            {},
            "the reset of .* returns 1 values",
        ),
        (
            one_mode(lambda t, s, p: (s.v, (-p.k,))),
            {},
            r"the flow of .* returns \(-1.0,\) for 'v': it must be one number",
        ),
        (one_mode(good), {"locate": "no"}, "locate is True or False, not 'no'"),
        (
            one_mode(good, transitions=[Transition("motion", "motion", at=Every("k"))]),
            {"k": 0.0},
            "a period must be positive",
        ),
        (
            one_mode(
                good,
                transitions=[
                    Transition("motion", "motion", guard=lambda t, s, p: s.x, delay=lambda p: -p.k)
                ],
            ),
            {},
            "a dead time cannot be negative",
        ),
    ],
)
def test_bad_input(system, options, words):
    with pytest.raises(ModelError, match=words):
        simulate(system, **{"t_end": 1.0, **options})


def test_bad_input_of_many():
    with pytest.raises(ModelError, match="one common length"):
        simulate_many(systems.ball(), 1.0, start={"y": np.ones(3)}, e=np.full(4, 0.5))
    with pytest.raises(ModelError, match="nothing to simulate"):
        simulate_many(systems.ball(), 1.0, start={"y": np.array([])})
    with pytest.raises(ModelError, match="parameter 'e' must be finite"):
        simulate_many(systems.ball(), 1.0, e=np.array([0.5, np.nan, 0.6]))
    with pytest.raises(ModelError, match="outside its range"):
        simulate_many(systems.ball(), 1.0, e=np.array([0.5, 1.5, 0.6]))
    with pytest.raises(ModelError, match="start of 'v' must be finite"):
        simulate_many(systems.ball(), 1.0, start={"v": np.array([0.0, np.inf])})
    with pytest.raises(ModelError, match="does not fit mode 'flight'"):  # none of them can start
        simulate_many(systems.ball(), 1.0, start={"y": np.array([-1.0, -2.0])}, backend="compiled")


# ---------------------------------------------------------------- compilation


STIFFNESS = 2.0


def helper(x, k):
    return -k * x


def test_a_parameter_change_compiles_nothing():
    system = systems.stick_slip()
    simulate(system, 3.0, backend="compiled")
    made = []
    original = backends._make_model
    backends._make_model = lambda *a: made.append(a) or original(*a)
    try:
        for k in (1.5, 2.5, 3.5):
            simulate(system, 3.0, k=k, backend="compiled", method="RK45", rtol=1e-5)
    finally:
        backends._make_model = original
    assert not made


def test_a_changed_constant_or_helper_never_meets_a_stale_compilation():
    global STIFFNESS, helper
    system = System(
        "global",
        {"x": "", "v": ""},
        {},
        [Mode("m", lambda t, s, p: (s.v, helper(s.x, STIFFNESS)))],
        start={"x": 1.0, "v": 0.0},
    )
    original = helper
    try:
        for STIFFNESS in (2.0, 3.0, 2.0):
            assert simulate(system, 1.0, backend="compiled").final["x"] == pytest.approx(
                math.cos(math.sqrt(STIFFNESS)), abs=1e-7
            )

        def helper(x, k):
            return -4 * k * x

        assert simulate(system, 1.0, backend="compiled").final["x"] == pytest.approx(
            math.cos(math.sqrt(8.0)), abs=1e-7
        )
    finally:
        STIFFNESS, helper = 2.0, original


def test_odd_functions_compile_too():
    """No source (exec), early returns, loops, local names, whole tuples handed to a helper.

    Closures, NumPy.
    """
    space = {}
    exec("def flow(t, s, p):\n    return s.v, -p.k * s.x", space)  # no source to be had

    def early(t, s, p):
        if s.x > 0.5:
            force = -p.k * s.x
            return s.v, force
        total = 0.0
        for _ in range(4):
            total += 0.25
        return (s.v, -p.k * s.x * total)

    def energy(s, p):
        return 0.5 * s.v**2 + 0.5 * p.k * s.x**2

    def closure(k):
        return lambda t, s, p: (s.v + 0 * energy(s, p), -k * s.x)

    def through_numpy(t, s, p):
        pair = (s.v, -np.abs(p.k) * s.x)
        return pair

    def swap(t, s, p):
        return s.v, s.x  # reads what it overwrites

    def starred(t, s, p):
        return (*early(t, s, p)[:1], -p.k * s.x)

    for flow in (
        space["flow"],
        early,
        closure(1.0),
        through_numpy,
        starred,
        lambda t, s, p: (s.v, -s.x) if p.k > 0 else (0.0, 0.0),
    ):
        transitions = [
            Transition("m", "m", guard=lambda t, s, p: s.x + 0.5, direction=-1, reset=swap)
        ]
        system = System(
            "odd",
            {"x": "", "v": ""},
            {"k": 1.0},
            [Mode("m", flow)],
            transitions,
            start={"x": 1.0, "v": 0.0},
        )
        plain, fast = (simulate(system, 3.0, backend=b) for b in BOTH)
        assert len(plain.events) == 1 and np.allclose(plain.values, fast.values, atol=1e-10)
        assert fast.events[0].after == {
            "x": fast.events[0].before["v"],
            "v": fast.events[0].before["x"],
        }


def test_what_cannot_be_compiled_runs_in_plain_python():
    table = {"k": 1.0}
    system = System(
        "table",
        {"x": "", "v": ""},
        {},
        [Mode("m", lambda t, s, p: (s.v, -sum(table.values()) * s.x))],
        start={"x": 1.0, "v": 0.0},
    )
    with pytest.warns(UserWarning, match="plain Python"):
        assert simulate(system, 1.0, backend="compiled").work.backend == "plain"
    run = simulate(system, 1.0)
    assert run.work.backend == "plain" and run.final["x"] == pytest.approx(math.cos(1), abs=1e-8)


def test_auto_does_not_wait_for_the_compiler():
    """The first run of a model nobody has compiled is plain; a little later it is compiled.

    With the same numbers.
    """
    space = {"tag": time.time()}
    exec("def flow(t, s, p):\n    return s.v, -p.k * s.x + 0.0 * tag", space)
    system = System(
        "new",
        {"x": "", "v": ""},
        {"k": 1.0},
        [Mode("m", space["flow"])],
        start={"x": 1.0, "v": 0.0},
    )
    first = simulate(system, 3.0)
    assert first.work.backend == "plain"
    for _ in range(600):
        again = simulate(system, 3.0)
        if again.work.backend == "compiled":
            break
        time.sleep(0.1)
    assert again.work.backend == "compiled" and np.allclose(first.values, again.values, atol=1e-11)


def test_without_numba_the_plain_back_end_serves(tmp_path):
    """Numba hidden, as in a browser: everything still runs.

    And asking for the compiled back end is a clear error.
    """
    for name in ("numba", "llvmlite"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('hidden')")
    program = (
        "from tests.systems import ball\nfrom labkit import simulate, ModelError\n"
        "run = simulate(ball(), 15.0)\n"
        "assert run.work.backend == 'plain' and run.events[-1].target == 'rest'\n"
        "try: simulate(ball(), 1.0, backend='compiled')\nexcept ModelError as e: print(e)"
    )
    root = os.path.dirname(os.path.dirname(__file__))
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), root])},
        cwd=root,
    )
    assert done.returncode == 0, done.stderr
    assert "needs Numba" in done.stdout


def test_import_is_light():
    program = (
        "import sys, labkit; print(sorted({m.split('.')[0] for m in sys.modules} & "
        "{'numpy', 'scipy', 'numba', 'matplotlib', 'sympy', 'ipywidgets'}))"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True
        ).stdout.strip()
        == "[]"
    )


def with_the_core_only(folder, program):
    """What a program prints whose cache has the compiled core (it takes long.

    So it is lent) and what earlier programs left there.
    """
    core = backends._kept(backends.CORE_KEY)
    folder.chmod(0o700)
    (folder / core).write_bytes(cache.read(core))
    root = os.path.dirname(os.path.dirname(__file__))
    environment = {**os.environ, "LABKIT_CACHE": str(folder), "PYTHONPATH": root}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment, cwd=root
    )
    assert done.returncode == 0 and done.stderr == "", done.stdout + done.stderr
    return done.stdout


def test_nothing_is_imported_or_parsed_beside_a_running_cell(tmp_path):
    """Numba's imports and a cell's (scipy.integrate).

    Its parsing of signatures and IPython's of cells: only one at a time.
    """
    program = """if True:
        import ast, sys, threading
        from labkit import simulate
        from tests.systems import stick_slip
        beside, parse = [], ast.parse
        def seen(*words, **more):
            beside.append(threading.current_thread().name)
            return parse(*words, **more)

        ast.parse = seen
        backend = simulate(stick_slip(), 1.0).work.backend
        # goes on
        (thread,) = [t for t in threading.enumerate() if t.name == "labkit compiles"]
        beside.clear()
        before = set(sys.modules)
        thread.join()
        more = {name.split(".")[0] for name in set(sys.modules) - before} - {"numba"}
        print(backend, beside, more, simulate(stick_slip(), 1.0).work.backend)
    """
    assert with_the_core_only(tmp_path, program).split() == ["plain", "[]", "set()", "compiled"]


def test_code_that_is_ready_just_after_it_was_asked_for_is_not_missed(monkeypatch):
    backends.compiled(systems.stick_slip(), wait=True)
    ask = backends._compiled

    def slow(system, wait):
        answer = ask(system, wait)
        for thread in backends._threads:
            thread.join()
        return answer

    monkeypatch.setattr(backends, "_compiled", slow)
    assert backends.compiled(systems.stick_slip()) is not None


def test_a_later_kernel_finds_the_compiled_code(tmp_path):
    """Two processes, one cache folder: the second compiles nothing (helpers included)."""
    program = (
        "import sys, labkit.solve.backend as b\n"
        "from tests.systems import stick_slip, relay\nfrom labkit import simulate\n"
        "count = []\noriginal = b._compile\n"
        "b._compile = lambda *a: count.append(1) or original(*a)\n"
        "runs = [simulate(s(), 9.0, backend='compiled') for s in (stick_slip, relay)]\n"
        "print(sum(len(r.events) for r in runs), len(count), 'numba' in sys.modules)"
    )
    printed = [with_the_core_only(tmp_path, program).split() for _ in range(2)]
    assert printed == [["7", "2", "True"], ["7", "0", "False"]]  # machine code needs no compiler
    # and waits for it: a run's last digit is not a matter of luck
    program = (
        "from tests.systems import stick_slip\nfrom labkit import simulate\n"
        "print(simulate(stick_slip(), 9.0).work.backend)"
    )
    assert with_the_core_only(tmp_path, program).split() == ["compiled"]


@settings(max_examples=30, deadline=None)
@given(
    st.permutations(range(4)),
    st.integers(1, 5),
    st.integers(1, 5),
    st.sampled_from([(0, 0), (0, 1), (1, 0)]),
    st.sampled_from(["plain", "auto"]),
)
def test_clocks_that_coincide_each_strike_in_any_order(order, swap, tick, priorities, backend):
    """One clock swaps the modes, the other counts in both: whichever is first, none is lost."""
    parts = [
        Transition("a", "b", at=Every("swap"), priority=priorities[0], label="to b"),
        Transition("b", "a", at=Every("swap"), priority=priorities[0], label="to a"),
        *(
            Transition(
                mode,
                mode,
                at=Every("tick"),
                priority=priorities[1],
                reset={"n": lambda t, s, p: s.n + 1},
                label="tick",
            )
            for mode in "ab"
        ),
    ]
    system = System(
        "two clocks",
        {"x": ""},
        {"swap": 1.0, "tick": 1.0},
        [Mode(mode, lambda t, s, p: (1.0,)) for mode in "ab"],
        [parts[k] for k in order],
        start={"x": 0.0},
        held={"n": ("", 0.0)},
    )
    run = simulate(system, 30.5, swap=float(swap), tick=float(tick), backend=backend)
    assert run.final["n"] == 30 // tick
    assert len(run.events) == 30 // tick + 30 // swap
    assert run.mode[-1] == "ab"[30 // swap % 2]
