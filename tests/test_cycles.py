"""Poincaré points, cycles and Floquet multipliers against exact ones."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import mathieu_a, mathieu_b

from labkit import (
    Every,
    Mode,
    ModelError,
    Parameter,
    System,
    Transition,
    characteristic,
    monodromy,
    periodic,
    section,
    simulate,
)

PERIOD_VDP = 6.6632868593231301  # of van der Pol's cycle at mu = 1


def plain(name, flow, start, **parameters):
    return System(name, dict.fromkeys(start, ""), parameters, [Mode("m", flow)], start=start)


damped = plain("damped", lambda t, s, p: (s.v, -2 * p.d * s.v - s.x), {"x": 1.0, "v": 0.0}, d=0.1)
lifted = plain("lifted", lambda t, s, p: (s.v, 5.0 - s.v - s.x), {"x": 1.0, "v": 0.0})
vdp = plain(
    "van der Pol",
    lambda t, s, p: (s.v, p.mu * (1 - s.x**2) * s.v - s.x),
    {"x": 2.0, "v": 0.0},
    mu=1.0,
)
mathieu = plain(
    "Mathieu",
    lambda t, s, p: (s.v, -2 * p.c * s.v - (p.a - 2 * p.q * math.cos(2 * t)) * s.x),
    {"x": 0.0, "v": 0.0},
    a=1.0,
    q=0.3,
    c=0.0,
)

bouncer = System(
    "ball",
    {"y": "m", "v": "m/s"},
    {"e": 0.5},
    [Mode("flight", lambda t, s, p: (s.v, -10.0))],
    [
        Transition(
            "flight",
            "flight",
            lambda t, s, p: s.y,
            -1,
            reset=lambda t, s, p: (0.0, -p.e * s.v),
            label="bounce",
        )
    ],
    start={"y": 5.0, "v": 0.0},
)


def at_zero(t, s, p):
    return s.x


def at_rest(t, s, p):
    return s.v


# ---- sections


def test_zeros_of_a_swing():
    w = math.sqrt(0.99)
    run = simulate(damped, 30.0, rtol=1e-12)
    tops = section(run, at_rest, direction=-1)  # v falls through zero at the tops
    np.testing.assert_allclose(tops.t, 2 * np.pi / w * np.arange(5), rtol=1e-10)
    np.testing.assert_allclose(tops["x"], np.exp(-0.1 * tops.t), rtol=1e-9)
    both = section(run, at_rest, since=1.0)
    np.testing.assert_allclose(both.t, np.pi / w * np.arange(1, 10), rtol=1e-10)
    assert set(tops["mode"]) == {"m"} and len(tops) == 5 and "5 points" in repr(tops)
    bottoms = section(run, at_rest, direction=1)
    assert sorted([*tops.t[1:], *bottoms.t]) == pytest.approx(list(both.t))


def test_once_a_period():
    run = simulate(damped, 10.0, rtol=1e-12)
    points = section(run, 2.5)
    np.testing.assert_array_equal(points.t, [0.0, 2.5, 5.0, 7.5, 10.0])
    np.testing.assert_array_equal(points["x"], run.at(points.t)["x"])
    np.testing.assert_array_equal(section(run, 2.5, since=4.0).t, [5.0, 7.5, 10.0])


def test_a_jump_is_no_point_and_a_guard_s_own_zero_is_one():
    run = simulate(bouncer, 3.2, rtol=1e-12)
    bounces = run.events["bounce"].t
    assert len(bounces) >= 4
    landed = section(run, lambda t, s, p: s.y, direction=-1)
    np.testing.assert_allclose(landed.t, bounces, rtol=1e-12)
    tops = section(run, lambda t, s, p: s.v)  # the speed jumps from − to + at a bounce: no point
    middles = (bounces[1:] + bounces[:-1]) / 2
    np.testing.assert_allclose(tops.t, [0.0, *middles][: len(tops)], rtol=1e-12)
    assert len(tops) >= len(middles) and np.all(landed["v"] < 0)


def sections(run, g):
    """Points of g and of −g: rising, falling, both; those of −g must be the same."""

    def mirrored(t, s, p):
        return -g(t, s, p)

    up, down, both = (section(run, g, direction).t for direction in (1, -1, 0))
    np.testing.assert_array_equal(section(run, mirrored, -1).t, up)
    np.testing.assert_array_equal(section(run, mirrored, 1).t, down)
    np.testing.assert_array_equal(section(run, mirrored).t, both)
    np.testing.assert_array_equal(np.sort([*up, *down]), both)
    return up, down, both


def test_a_section_that_is_a_guard_and_its_mirror_image():
    run = simulate(bouncer, 3.2, rtol=1e-12)
    bounces = run.events["bounce"].t
    assert len(bounces) >= 4
    up, down, _ = sections(run, lambda t, s, p: s.y)
    np.testing.assert_array_equal(up, [])  # it leaves the ground by an event, not by its flow
    np.testing.assert_allclose(down, bounces, rtol=1e-12)
    up, down, _ = sections(run, lambda t, s, p: s.v)  # the start, v = 0, is the first top
    np.testing.assert_array_equal(up, [])
    middles = (bounces[1:] + bounces[:-1]) / 2
    np.testing.assert_allclose(down, [0.0, *middles][: len(down)], rtol=1e-12)


def test_a_start_and_an_end_on_the_section_are_points_and_a_touch_is_none():
    swing = plain("swing", lambda t, s, p: (s.v, -s.x), {"x": 1.0, "v": 0.0})
    run = simulate(swing, 8.0, rtol=1e-12)
    up, down, _ = sections(run, at_rest)
    np.testing.assert_allclose(up, [math.pi], rtol=1e-10)
    np.testing.assert_allclose(down, [0.0, 2 * math.pi], rtol=1e-10)
    assert not len(sections(run, lambda t, s, p: 0.0)[2])
    straight = simulate(plain("straight", lambda t, s, p: (1.0,), {"x": -1.0}), 1.0)
    up, down, _ = sections(straight, at_zero)
    assert list(up) == [1.0] and not len(down)
    assert not len(sections(straight, lambda t, s, p: s.x**2)[0])


@pytest.mark.parametrize("x", np.linspace(1, 3, 8))
def test_every_stop_of_a_pendulum_with_hysteresis_is_a_zero_of_its_speed(x):
    relay = characteristic("relay with hysteresis")
    pendulum = System(
        "pendulum",
        {"x": "", "v": ""},
        {"K": 1.0, "a": 0.4},
        **relay.modes(lambda t, s, p, F: (s.v, -F - 0.5 * s.v)),
        start={"x": float(x), "v": 0.0},
    )
    run = simulate(pendulum, 20.0, method="RK45", rtol=1e-6)
    stops = run.events["stop"].t
    assert len(stops) >= 5
    _, _, both = sections(run, at_rest)
    np.testing.assert_allclose(both, [0.0, *stops[stops > 0]], rtol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.0,), "the period of a section must be positive, not 0"),
        (("x",), "the period of a section must be a number"),
        ((at_zero, 2), "direction is 1 .* not 2"),
        ((0.5, 2), "direction is 1 .* not 2"),
    ],
)
def test_wrong_sections_are_refused(arguments, words):
    run = simulate(damped, 1.0)
    with pytest.raises(ModelError, match=words):
        section(run, *arguments)
    with pytest.raises(ModelError, match="there is no 'y' on the section"):
        section(run, 0.5)["y"]


# ---- linear systems


def test_a_damped_oscillator_has_exponentials_of_its_eigenvalues():
    A = np.array([[0, 1], [-1, -0.2]])
    made = monodromy(damped, 3.0)
    np.testing.assert_allclose(made.matrix, expm(3 * A), atol=1e-11)
    exact = np.exp(3 * np.linalg.eigvals(A))
    np.testing.assert_allclose(
        np.sort_complex(made.multipliers), np.sort_complex(exact), atol=1e-11
    )
    assert made.stable and made.error < 1e-9 and made.names == ("x", "v") and not made.trivial
    assert not monodromy(damped, 3.0, d=-0.1).stable


@pytest.mark.parametrize("q", [0.1, 0.3, 2.0])
def test_mathieu_s_tongues(q):
    """On their borders, the characteristic values, the trace is −2 (odd) or 2 (even)."""
    for n in (1, 2, 3):
        for a in (mathieu_a(n, q), mathieu_b(n, q)):
            trace = monodromy(mathieu, math.pi, a=a, q=q).matrix.trace()
            assert trace == pytest.approx((-1) ** n * 2, abs=1e-8)
        middle = (mathieu_a(n, q) + mathieu_b(n, q)) / 2
        assert not monodromy(mathieu, math.pi, a=middle, q=q).stable
        between = (max(mathieu_a(n, q), mathieu_b(n, q)) + mathieu_b(n + 1, q)) / 2
        assert monodromy(mathieu, math.pi, a=between, q=q).stable


def test_the_determinant_is_that_of_liouville():
    for c in (0.0, 0.05, 0.3):
        made = monodromy(mathieu, math.pi, c=c)
        assert np.linalg.det(made.matrix) == pytest.approx(math.exp(-2 * c * math.pi), rel=1e-10)


def test_modes_that_switch_by_the_clock_are_linear_too():
    """Meissner's equation: products of matrix exponentials."""
    hill = System(
        "Meissner",
        {"x": "", "v": ""},
        {"k": Parameter(1.3), "m": Parameter(0.4), "T": Parameter(2.0)},
        [
            Mode("stiff", lambda t, s, p: (s.v, -(p.k + p.m) * s.x)),
            Mode("soft", lambda t, s, p: (s.v, -(p.k - p.m) * s.x + 0.7)),
        ],
        [
            Transition("stiff", "soft", at=Every("T", first=0.8)),
            Transition("soft", "stiff", at=Every("T")),
        ],
        start={"x": 1.0, "v": 0.0},
    )
    made = monodromy(hill, 2.0)
    stiff, soft = (np.array([[0, 1], [-k, 0]]) for k in (1.7, 0.9))
    np.testing.assert_allclose(made.matrix, expm(1.2 * soft) @ expm(0.8 * stiff), atol=1e-11)
    cycle = periodic(hill, 2.0)
    assert cycle.miss < 1e-9 and cycle.mode == "stiff"
    np.testing.assert_allclose(cycle.matrix, made.matrix, atol=1e-7)


# ---- held variables: what toggles has no neighbours, what is sampled has


TOGGLES = {
    "sign": lambda t, s, p: -s.q,
    "equality": lambda t, s, p: -1.0 if s.q == 1.0 else 1.0,
    "threshold": lambda t, s, p: 1.0 if s.q < 1.0 else -1.0,
}


@pytest.mark.parametrize("toggle", TOGGLES.values(), ids=TOGGLES)
@pytest.mark.parametrize("q", [1.0, -1.0])
def test_a_held_variable_that_toggles_is_no_direction_of_the_matrix(toggle, q):
    """Meissner's equation with the stiffness held: the product of two matrix exponentials."""
    hill = System(
        "Meissner, held",
        {"x": "", "v": ""},
        {},
        [Mode("m", lambda t, s, p: (s.v, -(1.3 + 0.4 * s.q) * s.x - 0.1 * s.v + 0.7))],
        [Transition("m", "m", at=Every(1.0), reset={"q": toggle})],
        start={"x": 1.0, "v": 0.0},
        held={"q": ("", q)},
    )
    first, second = (np.array([[0, 1], [-1.3 - 0.4 * k, -0.1]]) for k in (q, -q))
    made, cycle = monodromy(hill, 2.0), periodic(hill, 2.0, settle=2)
    np.testing.assert_allclose(made.matrix, expm(second) @ expm(first), atol=1e-11)
    np.testing.assert_allclose(cycle.matrix, made.matrix, atol=1e-7)
    assert made.names == ("x", "v") == cycle.monodromy.names and cycle.start["q"] == q
    with pytest.raises(ModelError, match="held variable.* 'q' does not return after one period"):
        periodic(hill, 1.0)


@pytest.mark.parametrize("nonlinear", [0.0, 1.0])
def test_a_sampled_controller_s_held_variable_is_a_state_of_its_own(nonlinear):
    """u = −K(x + c x³) of the last tick: over a period x' = e x + w u, u' = −K(1 + 3c x'²)x'."""
    a, K, w0 = 0.5, 0.9, math.exp(0.5)
    sampled = System(
        "sampled",
        {"x": ""},
        {"c": nonlinear},
        [Mode("m", lambda t, s, p: (0.5 * s.x + s.u + math.sin(2 * math.pi * t),))],
        [
            Transition(
                "m", "m", at=Every(1.0), reset={"u": lambda t, s, p: -0.9 * (s.x + p.c * s.x**3)}
            )
        ],
        start={"x": 0.1},
        held={"u": ("", 0.0)},
    )
    cycle = periodic(sampled, 1.0, settle=5)
    w, slope = (w0 - 1) / a, -K * (1 + 3 * nonlinear * cycle.start["x"] ** 2)
    exact = np.array([[w0, w], [slope * w0, slope * w]])
    np.testing.assert_allclose(cycle.matrix, exact, atol=2e-7)
    assert cycle.monodromy.names == ("x", "u")
    if not nonlinear:
        np.testing.assert_allclose(monodromy(sampled, 1.0).matrix, exact, atol=1e-11)
    assert len(cycle.multipliers) == 2 and cycle.multipliers[1] == pytest.approx(0, abs=1e-6)
    assert cycle.multipliers[0] == pytest.approx(w0 + slope * w, abs=1e-6)


def test_a_count_does_not_return():
    counted = System(
        "counted",
        {"x": ""},
        {},
        [Mode("m", lambda t, s, p: (-s.x,))],
        [Transition("m", "m", at=Every(1.0), reset={"x": 1.0, "n": lambda t, s, p: s.n + 1})],
        start={"x": 1.0},
        held={"n": ("", 0.0)},
    )
    for call in (periodic, monodromy):
        with pytest.raises(ModelError, match="'n' does not return .* from n = 1 to n = 2"):
            call(counted, 1.0)


# ---- cycles


def test_van_der_pol():
    cycle = periodic(vdp, at_zero, horizon=50.0)
    assert cycle.period == pytest.approx(PERIOD_VDP, abs=1e-9)
    assert cycle.run["x"].max() == pytest.approx(2.00861986087, abs=1e-4)  # of the samples
    t = np.linspace(0, cycle.period, 20001)
    states = cycle.at(cycle.t0 + t)
    divergence = np.trapezoid(1 - states["x"] ** 2, t)
    one, other = cycle.multipliers
    assert one == pytest.approx(1, abs=1e-6) and other == pytest.approx(
        math.exp(divergence), abs=1e-6
    )
    assert cycle.stable and cycle.monodromy.trivial and abs(one - 1) <= 10 * cycle.monodromy.error
    for shift in (-7, 1, 2):
        again = cycle.at(cycle.t0 + 1.0 + shift * cycle.period)
        assert again["x"] == pytest.approx(cycle.at(cycle.t0 + 1.0)["x"], abs=1e-8)
    assert "period 6.66328" in repr(cycle) and "stable" in repr(cycle.monodromy)


def test_an_unstable_cycle():
    back = plain("back", lambda t, s, p: (-s.v, s.x - (1 - s.x**2) * s.v), {"x": 2.0, "v": 0.0})
    cycle = periodic(back, at_zero, start={"x": 2.0086, "v": 0.0}, horizon=14.0, settle=0)
    assert cycle.period == pytest.approx(PERIOD_VDP, abs=1e-8)
    assert not cycle.stable and cycle.multipliers[0] == pytest.approx(1 / 0.000859695, rel=1e-3)


def test_a_driven_duffing_oscillator_returns_after_its_period():
    duffing = plain(
        "Duffing",
        lambda t, s, p: (s.v, -0.2 * s.v - s.x - s.x**3 + p.F * math.cos(1.2 * t)),
        {"x": 0.0, "v": 0.0},
        F=0.3,
    )
    T = 2 * math.pi / 1.2
    cycle = periodic(duffing, T, settle=5)
    long = simulate(duffing, 80 * T, rtol=1e-12).final
    assert cycle.start["x"] == pytest.approx(long["x"], abs=1e-7)
    assert np.linalg.det(cycle.matrix) == pytest.approx(math.exp(-0.2 * T), rel=1e-6)
    assert cycle.stable and not cycle.monodromy.trivial
    np.testing.assert_allclose(monodromy(duffing, T, settle=5).matrix, cycle.matrix, rtol=1e-7)


relay = System(
    "relay",
    {"x": "", "z": ""},
    {"a": 0.3, "T": 0.5},
    [
        Mode("up", lambda t, s, p: (-s.x + 1, (s.x - s.z) / p.T)),
        Mode("down", lambda t, s, p: (-s.x - 1, (s.x - s.z) / p.T)),
    ],
    [
        Transition("up", "down", lambda t, s, p: s.z - p.a, 1),
        Transition("down", "up", lambda t, s, p: s.z + p.a, -1),
    ],
    start={"x": 0.0, "z": 0.0},
)


held_relay = System(
    "relay, held",
    {"x": "", "z": ""},
    {"a": 0.3, "T": 0.5},
    [Mode("up", lambda t, s, p: (-s.x + s.u, (s.x - s.z) / p.T))],
    [
        Transition(
            "up",
            "up",
            lambda t, s, p: s.z * (1 if s.u == 1 else -1) - p.a,
            1,
            reset={"u": lambda t, s, p: -1.0 if s.u == 1 else 1.0},
        )
    ],
    start={"x": 0.0, "z": 0.0},
    held={"u": ("", 1.0)},
)
SECTIONS = {
    "x": (at_zero, 1),
    "the guard": (lambda t, s, p: s.z - p.a, 1),
    "the other guard": (lambda t, s, p: s.z + p.a, -1),
}


@pytest.mark.parametrize("system", [relay, held_relay], ids=lambda system: system.name)
@pytest.mark.parametrize(("where", "direction"), SECTIONS.values(), ids=SECTIONS)
def test_a_relay_s_cycle_has_the_multipliers_of_its_saltation_matrices(system, where, direction):
    cycle = periodic(system, where, direction=direction, horizon=30.0, settle=6)
    run, A = cycle.run, np.array([[-1.0, 0], [2.0, -2.0]])
    assert len(run.events) == 2 and (cycle.mode == "up" or where is not at_zero)
    assert cycle.period == pytest.approx(2.6881999899, abs=1e-9)
    M, last = np.eye(2), cycle.t0
    for event in run.events:
        x, z = event.before["x"], event.before["z"]
        sign = math.copysign(1.0, z)  # it falls from +a, and rises from −a
        before, after = np.array([-x + sign, 2 * (x - z)]), np.array([-x - sign, 2 * (x - z)])
        normal = np.array([0.0, 1.0])
        S = np.eye(2) + np.outer(after - before, normal) / (normal @ before)
        M, last = S @ expm(A * (event.t - last)) @ M, event.t
    M = expm(A * (cycle.t0 + cycle.period - last)) @ M
    np.testing.assert_allclose(cycle.matrix, M, atol=max(2e-7, 2 * cycle.monodromy.error))
    assert cycle.monodromy.error < 1e-5
    np.testing.assert_allclose(cycle.multipliers, np.sort(np.linalg.eigvals(M))[::-1], atol=1e-6)
    assert cycle.stable and cycle.monodromy.trivial
    late = simulate(relay, 60.0, rtol=1e-12).events[-4:]
    assert cycle.period == pytest.approx(late[-1].t - late[-3].t, abs=1e-8)
    # seen by the switching alone: half a period lifts z from −a to a and x from −X to X
    assert run.events[0].before["x"] == pytest.approx(-run.events[1].before["x"], abs=1e-8)


e, omega, G = 0.6, 2 * math.pi, 9.81
AMPLITUDE = 0.045


def table(t):
    return AMPLITUDE * math.sin(omega * t)


ball = System(
    "ball on a table",
    {"y": "m", "v": "m/s"},
    {},
    [Mode("flight", lambda t, s, p: (s.v, -G))],
    [
        Transition(
            "flight",
            "flight",
            lambda t, s, p: s.y - AMPLITUDE * math.sin(omega * t),
            -1,
            reset=lambda t, s, p: (
                s.y,
                (1 + e) * AMPLITUDE * omega * math.cos(omega * t) - e * s.v,
            ),
            label="bounce",
        )
    ],
    start={"y": 1.2, "v": 0.0},
)


def test_a_ball_on_a_shaking_table():
    """One bounce a period: the table's speed there is w = gT(1 − e)/(2(1 + e))."""
    T, w = 1.0, G * (1 - e) / (2 * (1 + e))
    amplitude = 1.05 * w / omega  # the bounce is near the greatest speed
    shaken = ball.variant(
        "shaken",
        parameters={"A": Parameter(amplitude, "m")},
        transitions={
            "bounce": {
                "guard": lambda t, s, p: s.y - p.A * math.sin(omega * t),
                "reset": lambda t, s, p: (
                    s.y,
                    (1 + e) * p.A * omega * math.cos(omega * t) - e * s.v,
                ),
            }
        },
    )
    phase = math.acos(w / (amplitude * omega)) / omega  # on the way up, where it is stable
    y, v, rest = amplitude * math.sin(omega * phase), G * T / 2, T / 2 - phase
    top = {"y": y + v * (rest) - G * rest**2 / 2 + 1e-3, "v": v - G * rest}
    cycle = periodic(shaken, T, start=top, t0=T / 2)
    assert len(cycle.run.events) == 1
    (bounce,) = cycle.run.events
    assert bounce.t % T == pytest.approx(phase, abs=1e-8)
    assert bounce.after["v"] == pytest.approx(G * T / 2, abs=1e-7)
    # the saltation matrix of a reset at a guard that moves
    flight = lambda t: np.array([[1, t], [0, 1.0]])  # noqa: E731
    R, before, after = np.diag([1, -e]), np.array([-v, -G]), np.array([v, -G])
    jolt = np.array([0, -(1 + e) * amplitude * omega**2 * math.sin(omega * phase)])
    normal, moves = np.array([1.0, 0]), -w
    S = R + np.outer(after - R @ before - jolt, normal) / (normal @ before + moves)
    M = flight(cycle.t0 + T - bounce.t) @ S @ flight(bounce.t - cycle.t0)
    np.testing.assert_allclose(cycle.matrix, M, atol=1e-6)
    assert np.linalg.det(cycle.matrix) == pytest.approx(e**2, abs=1e-6)
    assert cycle.stable and not cycle.monodromy.trivial
    np.testing.assert_allclose(np.abs(cycle.multipliers), e, atol=1e-6)


def test_a_slow_multiplier_costs_no_accuracy():
    """A deviation e^(−0.005) as large after a period: a cycle that closes to 1e-9 is 2e-7 off."""
    slow = plain("slow", lambda t, s, p: (1 - 0.005 * s.x + math.sin(2 * math.pi * t),), {"x": 0.0})
    w = 2 * math.pi
    exact = 200 - w / (w**2 + 0.005**2)  # of the sine: (0.005 sin wt − w cos wt)/(w² + 0.005²)
    for start in (0.0, 190.0, 199.9):
        cycle = periodic(slow, 1.0, start={"x": start})
        assert cycle.start["x"] == pytest.approx(exact, abs=2e-9)


def test_a_tank_that_fills_by_the_clock_and_empties_by_its_level():
    tank = System(
        "tank",
        {"h": "m", "q": ""},
        {},
        [
            Mode("fill", lambda t, s, p: (1.0 - 0.1 * s.h, -s.q)),
            Mode("empty", lambda t, s, p: (-1.0 - 0.1 * s.h, -s.q)),
        ],
        [
            Transition("fill", "empty", lambda t, s, p: s.h - 1, 1, label="full"),
            Transition("empty", "fill", at=Every(3.0), label="tick"),
        ],
        start={"h": 0.0, "q": 0.2},
    )
    cycle = periodic(tank, 3.0)
    assert cycle.miss < 1e-9 and len(cycle.run.events) == 2 and cycle.stable
    exact = [-1.1 / 0.9 * math.exp(-0.3), math.exp(-3.0)]  # the ratio of the speeds at the level
    np.testing.assert_allclose(cycle.multipliers, exact, atol=1e-7)


def test_a_start_on_a_guard_is_moved_to_a_flight():
    """A deviation upward would begin beyond the guard."""
    pulses = System(
        "pulses",
        {"h": ""},
        {},
        [Mode("decay", lambda t, s, p: (-s.h,))],
        [
            Transition("decay", "decay", at=Every(2.0), reset={"h": 1.0}, label="pulse"),
            Transition("decay", None, lambda t, s, p: s.h - 1, 1, label="overflow", urgent=False),
            Transition("decay", None, lambda t, s, p: s.h - 1.0, 1, label="too much"),
        ],
        start={"h": 0.5},
    )
    cycle = periodic(pulses, 2.0)
    assert cycle.t0 == pytest.approx(3.0) and cycle.start["h"] == pytest.approx(math.exp(-1))
    assert abs(cycle.multipliers[0]) < 1e-7  # a pulse forgets what was before
    assert cycle.at(0.5)["h"] == pytest.approx(math.exp(-0.5))


# ---- what cannot be


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: periodic(vdp, at_zero), "say how long to look for returns to it, horizon="),
        (lambda: periodic(vdp, -1.0, settle=np.int64(2)), "the period must be positive, not -1"),
        (lambda: periodic(vdp, -1.0, settle=-2), "settle must be a whole number"),
        (lambda: periodic(vdp, at_zero, horizon=9.0, direction=0), "direction is 1 .* not 0"),
        (lambda: periodic(vdp, at_zero, horizon=1.0), "crosses the section 0 times, but 3"),
        (lambda: periodic(damped, at_zero, horizon=90.0), "is at rest, not a cycle"),
        (lambda: periodic(damped, 3.0), "is at rest, not a cycle"),
        (lambda: periodic(lifted, 3.0), "is at rest, not a cycle: x = 5, v = "),
        (lambda: periodic(vdp, 5.0), "no cycle was found"),
        (lambda: periodic(vdp, at_zero, horizon=9.0, nu=1.0), "'nu' is not a parameter"),
        (lambda: monodromy(mathieu, 1.0, nu=1.0), "'nu' is not a parameter"),
        (
            lambda: periodic(plain("free", lambda t, s, p: (1.0,), {"x": 0.0}), 1.0),
            "no cycle was found",
        ),
    ],
)
def test_what_is_no_cycle_is_said(call, words):
    with pytest.raises(ModelError, match=words):
        call()


def test_a_small_answer_to_a_small_force_is_a_cycle():
    driven = plain(
        "driven", lambda t, s, p: (s.v, 1e-6 * math.cos(t) - s.v - s.x), {"x": 1.0, "v": 0.0}
    )
    cycle = periodic(driven, 2 * math.pi)
    assert cycle.at(math.pi / 2)["x"] == pytest.approx(1e-6, rel=1e-5)


def test_a_driven_system_needs_its_period():
    driven = plain(
        "driven",
        lambda t, s, p: (s.v, -0.2 * s.v - s.x - s.x**3 + 0.3 * math.cos(1.2 * t)),
        {"x": 0.5, "v": 0.0},
    )
    with pytest.raises(ModelError, match="no cycle was found|give its period instead"):
        periodic(driven, at_zero, horizon=60.0)


def test_an_option_and_a_parameter_of_one_name_do_not_collide_silently():
    turned = plain(
        "turned", lambda t, s, p: (s.v, -p.direction * s.x), {"x": 1.0, "v": 0.0}, direction=1.0
    )
    with pytest.raises(ModelError, match="'direction' is an option of periodic and a parameter of"):
        periodic(turned, at_zero, direction=1, horizon=20.0)
    with pytest.raises(ModelError, match="'direction' is an option of periodic and a parameter of"):
        monodromy(turned, math.pi, direction=4.0)
