"""What the engine promises about events, each line a test.

Nothing lost, nothing repeated, nothing endless.
"""

import math
import re

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from labkit import At, Every, Mode, System, Transition, simulate

from . import systems

BOTH = ("plain", "compiled")


def counter(guard, directions=(1, -1), rate=lambda t, s, p: (0.0, 0.0)):
    """Counts the crossings of a guard: states x (moved by `rate`) and n."""
    return System(
        "counter",
        {"x": "", "n": ""},
        {"level": 0.0, "phase": 0.0, "w": 1.0},
        [Mode("only", rate)],
        [
            Transition(
                "only",
                "only",
                guard=guard,
                direction=d,
                urgent=False,
                reset=lambda t, s, p: (s.x, s.n + 1),
            )
            for d in directions
        ],
        start={"x": 0.0, "n": 0.0},
    )


WAVE = counter(
    lambda t, s, p: s.x - p.level, rate=lambda t, s, p: (p.w * math.cos(p.w * t + p.phase), 0.0)
)
BARE = counter(lambda t, s, p: math.sin(p.w * t + p.phase) - p.level)


@pytest.mark.parametrize("depth", [10.0**-k for k in range(1, 11)])
def test_dips_at_25_phases(depth):
    """One dip of sin under −1 + depth a period, at 25 phases against the steps.

    All of them, entered and left.
    """
    for phase in np.linspace(0, 2 * math.pi, 25, endpoint=False):
        run = simulate(
            WAVE,
            2 * math.pi,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            level=-1 + depth,
            phase=phase,
            start={"x": math.sin(phase)},
            backend="compiled",
        )
        assert run.final["n"] == 2 or abs(math.sin(phase) + 1) <= depth, phase


@pytest.mark.parametrize("level", [0.9, 0.99, 0.999, 0.9999])
@pytest.mark.parametrize("method", ["RK45", "DOP853"])
@pytest.mark.parametrize("backend", BOTH)
def test_sine_over_a_high_level(level, method, backend):
    """Ten periods, loose and tight tolerance.

    20 of 20 crossings, also when the guard reads the time and the flow is nothing.
    """
    for rtol in (1e-5, 1e-9):
        assert (
            simulate(
                BARE,
                20 * math.pi,
                method=method,
                level=level,
                rtol=rtol,
                max_step=5.0,
                backend=backend,
            ).final["n"]
            == 20
        )
    if method == "DOP853":
        assert (
            simulate(
                WAVE,
                20 * math.pi,
                method=method,
                level=level,
                rtol=1e-9,
                atol=1e-11,
                backend=backend,
            ).final["n"]
            == 20
        )


def test_a_guard_that_wiggles_within_one_step():
    """Guard sin 40t with a flow that lets the step grow without bound.

    The samples, not the steps, resolve it.
    """
    assert simulate(BARE, 10.0, w=40.0, phase=0.1, max_step=1.0).final["n"] == math.floor(
        (40 * 10 + 0.1) / math.pi
    )


@pytest.mark.parametrize("backend", BOTH)
def test_event_on_a_step_boundary_counts_once(backend):
    """Fixed steps of 1/8 that end exactly on the surface x = 1 (all are binary fractions)."""
    system = counter(lambda t, s, p: s.x - 1.0, directions=(1,), rate=lambda t, s, p: (1.0, 0.0))
    for method in ("Euler", "Heun", "RK4"):
        run = simulate(system, 3.0, method=method, step=0.125, backend=backend)
        assert (
            run.final["n"] == 1 and 1.0 <= run.events[0].t <= 1.0 + 4e-16
        )  # on the far side, an ulp or two away


@pytest.mark.parametrize("backend", BOTH)
def test_location_where_the_flow_is_exact(backend):
    """x = t² − 2: the root of 2 to 1e-12 by every method that integrates a parabola exactly.

    The state on the far side.
    """
    system = System(
        "parabola",
        {"x": "", "v": ""},
        {},
        [Mode("only", lambda t, s, p: (s.v, 2.0))],
        [Transition("only", None, guard=lambda t, s, p: s.x, direction=1)],
        {"x": -2.0, "v": 0.0},
    )
    for method in ("Heun", "RK4", "RK45", "DOP853"):
        run = simulate(system, 3.0, method=method, step=0.4, backend=backend)
        assert abs(run.t[-1] / math.sqrt(2) - 1) <= 1e-12 and run["x"][-1] >= 0


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("e", [0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99])
def test_zeno_of_the_ball(e, backend):
    exact = math.sqrt(2 * 10 / 9.81) * (1 + e) / (1 - e)
    run = simulate(systems.ball(), 2 * exact, e=e, backend=backend)
    assert (
        run.events[-1].target == "rest"
        and run.events[-1].t == pytest.approx(exact, rel=1e-8)
        and run.final["y"] == pytest.approx(0, abs=1e-9)
    )
    bounces = [x.t for x in run.events[:-1]]
    first = math.sqrt(2 * 10 / 9.81)
    assert bounces[:30] == pytest.approx(
        [
            first * (1 + 2 * sum(e**j for j in range(1, k + 1)))
            for k in range(min(30, len(bounces)))
        ],
        rel=1e-9,
    )


def test_event_chain_at_one_instant_reaches_a_fixed_point():
    """a → b → c → d by urgent guards, then rest; a ring of urgent guards is stopped and named."""

    def flow(t, s, p):
        return (1.0,)

    chain = [
        Transition(x, y, guard=lambda t, s, p: s.x - 1, direction=1, urgent=True)
        for x, y in (("a", "b"), ("b", "c"), ("c", "d"))
    ]
    run = simulate(
        System("chain", {"x": ""}, {}, [Mode(n, flow) for n in "abcd"], chain, {"x": 0.0}), 3.0
    )
    assert (
        [e.target for e in run.events] == ["b", "c", "d"]
        and len({e.t for e in run.events}) == 1
        and run.stopped == "finished"
    )
    ring = [
        Transition(x, y, guard=lambda t, s, p: s.x - 1, direction=1, urgent=True, label="round")
        for x, y in (("a", "b"), ("b", "c"), ("c", "a"))
    ]
    run = simulate(
        System("ring", {"x": ""}, {}, [Mode(n, flow) for n in "abc"], ring, {"x": 0.0}), 3.0
    )
    assert (
        run.stopped.startswith("endless loop at t = 1: ")
        and '"round"' in run.stopped
        and run.t[-1] == pytest.approx(1)
    )


@pytest.mark.parametrize("backend", BOTH)
def test_chattering_without_a_sliding_mode_is_named(backend):
    """Three modes in a ring on one surface, each pushing back.

    No two of them make a Filippov pair, so the run ends and names the guard.
    """
    down, up = (lambda t, s, p: (-1.0,)), (lambda t, s, p: (1.0,))
    system = System(
        "ring",
        {"x": ""},
        {},
        [Mode("a", down), Mode("b", up), Mode("c", down)],
        [
            Transition("a", "b", guard=lambda t, s, p: s.x, direction=-1, label="a to b"),
            Transition("b", "c", guard=lambda t, s, p: s.x, direction=1, label="b to c"),
            Transition("c", "a", guard=lambda t, s, p: s.x, direction=-1, label="c to a"),
        ],
        start={"x": 1.0},
    )
    run = simulate(system, 5.0, backend=backend)
    assert re.match(
        r'endless loop at t = 1: [0-9]+ events at one instant, the last of them ".*" \(chattering',
        run.stopped,
    )
    assert run.t[-1] == pytest.approx(1.0) and len(run.events) > 100  # what was computed is kept


def test_short_pulses_are_not_stepped_over():
    """A push of 1 for a microsecond at t = 5 in a system at rest.

    X' is 1e-6 afterwards, whatever the step.
    """
    system = System(
        "pulse",
        {"x": "", "v": ""},
        {},
        [Mode("quiet", lambda t, s, p: (s.v, 0.0)), Mode("push", lambda t, s, p: (s.v, 1.0))],
        [Transition("quiet", "push", at=At(5.0)), Transition("push", "quiet", at=At(5.000001))],
        {"x": 0.0, "v": 0.0},
    )
    for backend in BOTH:
        assert simulate(system, 100.0, backend=backend).final["v"] == pytest.approx(1e-6, rel=1e-9)


def test_relay_pendulum_switches_ever_faster():
    """x'' + a x' + K sign x = 0 from x' = 2.

    Each swing has a closed form, solved here with thirty digits; a thousand switches.
    """
    system = System(
        "relay pendulum",
        {"x": "", "v": ""},
        {"a": 0.2, "K": 1.0},
        [
            Mode("right", lambda t, s, p: (s.v, -p.a * s.v - p.K)),
            Mode("left", lambda t, s, p: (s.v, -p.a * s.v + p.K)),
        ],
        [
            Transition("right", "left", guard=lambda t, s, p: s.x, direction=-1),
            Transition("left", "right", guard=lambda t, s, p: s.x, direction=1),
        ],
        {"x": 0.0, "v": 2.0},
    )
    run = simulate(system, 85.0, rtol=1e-12, atol=1e-17, backend="compiled")
    exact = []
    with mpmath.workdps(30):
        a, K, t, v = mpmath.mpf("0.2"), mpmath.mpf(1), mpmath.mpf(0), mpmath.mpf(2)
        for _ in range(1000):
            swing = mpmath.findroot(
                lambda s, v=v: (v + K / a) * (1 - mpmath.exp(-a * s)) / a - K * s / a,
                2 * v / K * (1 - a * v / (3 * K)),
            )
            v, t = K / a - (v + K / a) * mpmath.exp(-a * swing), t + swing
            exact.append(float(t))
    assert np.allclose([e.t for e in run.events[:1000]], exact, rtol=0, atol=1e-6)
    assert np.allclose([e.t for e in run.events[:100]], exact[:100], rtol=0, atol=1e-9)


# ---------------------------------------------------------------- random piecewise linear systems

number = st.floats(-2, 2).map(lambda x: round(x, 3))
vector = st.tuples(number, number)
linear = st.tuples(vector, vector, vector)  # rows of A, and b


@st.composite
def hybrids(draw):
    """Two to four modes x' = Ax + b in the plane; guards c·x − d between random modes.

    Resets that keep, scale or push; a clock.
    """
    count = draw(st.integers(2, 4))
    flows = [draw(linear) for _ in range(count)]
    edges = []
    for mode in range(count):
        for _ in range(draw(st.integers(1, 2))):
            c = draw(vector.filter(lambda v: abs(v[0]) + abs(v[1]) > 0.2))
            edges.append(
                (
                    mode,
                    draw(st.integers(0, count - 1)),
                    c,
                    draw(number),
                    draw(st.sampled_from([1, -1])),
                    draw(st.sampled_from([(1.0, 0.0), (0.5, 0.0), (1.0, 0.25)])),
                )
            )
    clock = draw(
        st.one_of(
            st.none(),
            st.tuples(
                st.integers(0, count - 1),
                st.integers(0, count - 1),
                st.floats(0.3, 1.5).map(lambda x: round(x, 3)),
            ),
        )
    )
    return flows, edges, clock, draw(vector)


def build(recipe):
    flows, edges, clock, start = recipe

    def make_flow(a, b, c):
        return lambda t, s, p: (a[0] * s.x + a[1] * s.y + c[0], b[0] * s.x + b[1] * s.y + c[1])

    def make_guard(c, d):
        return lambda t, s, p: c[0] * s.x + c[1] * s.y - d

    def make_reset(k, shift):
        return lambda t, s, p: (k * s.x + shift, k * s.y)

    modes = [Mode(f"m{i}", make_flow(*flow)) for i, flow in enumerate(flows)]
    transitions = [
        Transition(
            f"m{i}",
            f"m{j}",
            guard=make_guard(c, d),
            direction=direction,
            urgent=False,
            reset=make_reset(*reset),
        )
        for i, j, c, d, direction, reset in edges
    ]
    if clock:
        transitions.append(Transition(f"m{clock[0]}", f"m{clock[1]}", at=Every(clock[2])))
    return System(
        "random", {"x": "", "y": ""}, {}, modes, transitions, dict(zip("xy", start, strict=True))
    )


def certify(recipe, run):
    """Holds a run against matrix exponentials, mode by mode.

    Every stretch follows them, every event lies on its guard and
    crosses it in its direction, every reset is right, and on a fine grid no directed crossing was
    passed over.
    """
    flows, edges, clock, _ = recipe
    stops = [*run.events, None]
    t, mode, state = 0.0, 0, np.array(list(run.start.values()))
    for event in stops:
        end = run.t[-1] if event is None else event.t
        M = np.zeros((3, 3))
        M[:2, :2], M[:2, 2] = flows[mode][:2], flows[mode][2]
        size = 1 + np.abs(state).max()
        fine = np.linspace(0, end - t, 400)
        step = expm(M * (fine[1] - fine[0]))
        path = [np.append(state, 1.0)]
        for _ in fine[1:]:
            path.append(step @ path[-1])
        path = np.array(path)[:, :2]
        size = max(size, np.abs(path).max())
        reached = np.array(list((run.final if event is None else event.before).values()))
        assert np.abs(path[-1] - reached).max() <= 1e-6 * size, (
            "the stretch follows the exponential"
        )
        for i, _, c, d, direction, _ in edges:
            if i == mode:
                g = direction * (path @ c - d)
                inner = g[1:-1]
                assert not np.any((inner[:-1] < -1e-6 * size) & (inner[1:] > 1e-6 * size)), (
                    "no crossing passed over"
                )
        if event is None:
            break
        if event.index < len(edges):
            i, j, c, d, direction, (k, shift) = edges[event.index]
            assert i == mode and abs(reached @ c - d) <= 1e-6 * size, "the event lies on its guard"
            rate = direction * (np.array(c) @ (M @ np.append(reached, 1.0))[:2])
            assert rate >= -1e-5 * size, "and crosses it in its direction"
            state = np.array([k * reached[0] + shift, k * reached[1]])
        else:
            assert abs(event.t / clock[2] - round(event.t / clock[2])) < 1e-12 and mode == clock[0]
            j, state = clock[1], reached
        assert np.allclose(state, list(event.after.values()), atol=1e-12 * size)
        t, mode = event.t, j


@settings(max_examples=40, deadline=None)
@given(hybrids())
def test_random_piecewise_linear_systems(recipe):
    system = build(recipe)
    plain = simulate(system, 4.0, rtol=1e-9, atol=1e-11, backend="plain", max_events=60)
    assert plain.stopped == "finished" or plain.stopped.split()[0] in (
        "too",
        "endless",
        "Zeno",
        "resting",
        "diverged:",
    ), plain.stopped
    assume(not any("sliding" in (e.source, e.target) for e in plain.events))
    certify(recipe, plain)


@settings(max_examples=5, deadline=None)
@given(hybrids())
def test_random_systems_compiled_as_plain(recipe):
    system = build(recipe)
    plain, fast = (simulate(system, 4.0, backend=b, max_events=60) for b in BOTH)
    assert [e.index for e in plain.events] == [
        e.index for e in fast.events
    ] and plain.stopped.split(":")[0].split(" at ")[0] == fast.stopped.split(":")[0].split(" at ")[
        0
    ]
    assert np.allclose([e.t for e in plain.events], [e.t for e in fast.events], rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", ["plain", "auto"])
@pytest.mark.parametrize("what", ["x", "h"])
def test_a_reset_that_gives_no_number_is_named(backend, what):
    """Not the flow that reads the value a moment later."""
    huge = {
        "x": {"x": lambda t, s, p: 1e308 * (s.x + 9) - 1e308 * (s.x + 9)},
        "h": {"h": lambda t, s, p: 1e308 * (s.x + 9) - 1e308 * (s.x + 9)},
    }
    system = System(
        "bad reset",
        {"x": "m"},
        {},
        [Mode("moves", lambda t, s, p: (s.h,))],
        [
            Transition(
                "moves",
                "moves",
                guard=lambda t, s, p: s.x - 1,
                direction=1,
                reset=huge[what],
                label="kick",
            )
        ],
        start={"x": 0.0},
        held={"h": ("", 1.0)},
    )
    run = simulate(system, 3.0, backend=backend)
    assert run.ended == "not a number"
    assert f"after 'kick' at t = 1 the value of '{what}' is not finite" in run.stopped
