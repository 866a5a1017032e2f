"""Bodies at rest whatever their guard looks like, roots that are told from rounding, and what a run
says of the things that it cannot do.
"""

import itertools
import math
import random
from fractions import Fraction

import numpy as np
import pytest

from labkit import (
    At,
    Ended,
    Every,
    Mode,
    ModelError,
    System,
    Transition,
    simulate,
    simulate_many,
)

from .coincidences import bodies, contacts, floors, linear, restarts

BOTH = ("plain", "compiled")
FLOORS = {
    "round": lambda t, s, p: math.hypot(s.x, s.y + p.R) - p.R,
    "square": lambda t, s, p: s.x**2 + (s.y + p.R) ** 2 - p.R**2,
    "cube": lambda t, s, p: s.y**3,
    "flat": lambda t, s, p: 1 - math.cos(s.y) if s.y > 0 else -1 + math.cos(s.y),
}


@pytest.mark.parametrize("name", FLOORS)
@pytest.mark.parametrize("method", ["DOP853", "RK45"])
def test_a_ball_rests_on_a_floor_whose_guard_has_no_slope_or_large_constants(name, method):
    system = System(
        "ball on a round floor",
        {"x": "m", "y": "m", "v": "m/s"},
        {"R": 0.1, "e": 0.7, "g": 9.81},
        [
            Mode("fly", lambda t, s, p: (0.0, s.v, -p.g)),
            Mode("rest", lambda t, s, p: (0.0, 0.0, 0.0)),
        ],
        [
            Transition(
                "fly", "fly", guard=FLOORS[name], direction=-1, zeno="rest",
                reset={"v": lambda t, s, p: -p.e * s.v},
            )
        ],
        {"x": 0.0, "y": 1.0, "v": 0.0},
    )  # fmt: skip
    for e in (0.1, 0.7, 0.9):
        run = simulate(system, 20.0, method=method, backend="plain", e=e, max_steps=20_000)
        rest = math.sqrt(2 / 9.81) * (1 + 2 * e / (1 - e))
        assert run.stopped == "finished" and run.mode[-1] == "rest"
        assert abs(run.final["y"]) < 1e-4
        assert run.events[-1].t == pytest.approx(rest, abs=1e-2)


#: kind, seed and method of cases that went wrong once, each for a reason of its own
ONCE = [
    (bodies, 107, "RK4"),  # a guard located at 1e-17 counted again one step later
    (contacts, 124, "DOP853"),  # a guard within its own rounding taken for one that runs wild
    (contacts, 164, "RK45"),  # one root of a polynomial, three of the guard
    (floors, 119, "BDF"),  # a tolerance finer than the clock
    (floors, 350, "BDF"),  # come to the floor, by the method's error, with a speed upwards
    (restarts, 116, "RK45"),  # 1e-34 beyond a surface, and no slope
    (linear, 7, "RK4"),  # urgent=False fires by a crossing along the flow only
]


@pytest.mark.parametrize("kind, seed, method", ONCE, ids=lambda it: getattr(it, "__name__", it))
def test_coincidences_that_were_wrong_once(kind, seed, method):
    case = kind.generate(random.Random(seed))
    assert kind.check(case, "plain", method) == []


def test_a_body_sent_back_so_slowly_that_the_clock_cannot_tell_rests():
    """An impact far slower than the flights before it."""
    case = floors.Case(0.0, 2.22, 4.66, 0.8, 3e5, "rest")
    for method in ("BDF", "LSODA", "Radau"):
        assert floors.check(case, "plain", method) == []


def test_stiff_kinetics_to_the_end_by_the_default_tolerance():
    """Robertson 1966; the value at 1e11 after the Test Set for IVP Solvers."""
    system = System(
        "Robertson", {"a": "", "b": "", "c": ""}, {},
        [
            Mode(
                "only",
                lambda t, s, p: (
                    -0.04 * s.a + 1e4 * s.b * s.c,
                    0.04 * s.a - 1e4 * s.b * s.c - 3e7 * s.b * s.b,
                    3e7 * s.b * s.b,
                ),
            )
        ],
        [], {"a": 1.0, "b": 0.0, "c": 0.0},
    )  # fmt: skip
    for method in ("Radau", "BDF"):
        run = simulate(system, 1e11, method=method, backend="plain")
        assert run.stopped == "finished"
        assert run.final["a"] == pytest.approx(2.0833401497e-8, rel=1e-2)


@pytest.mark.parametrize("method", ["DOP853", "RK45", "Radau", "LSODA", "BDF"])
def test_every_method_names_a_jump_hidden_in_a_flow(method):
    pulse = System(
        "pulse", {"x": ""}, {}, [Mode("m", lambda t, s, p: (1.0 if t % 1.0 < 0.3 else 0.0,))],
        [], {"x": 0.0},
    )  # fmt: skip
    run = simulate(pulse, 10.0, backend="plain", method=method)
    assert run.notes[0].startswith("the flow seems to jump near t = 0.3")
    steep = System(
        "logistic", {"x": ""}, {}, [Mode("m", lambda t, s, p: (40 * s.x * (1 - s.x),))],
        [], {"x": 1e-6},
    )  # fmt: skip
    assert simulate(steep, 10.0, backend="plain", method=method).notes == []


def test_a_state_that_grows_from_below_its_tolerance_is_named():
    there_and_back = System(
        "decay and growth",
        {"x": ""},
        {},
        [Mode("decay", lambda t, s, p: (-s.x,)), Mode("growth", lambda t, s, p: (s.x,))],
        [Transition("decay", "growth", at=At(30.0))],
        {"x": 1.0},
    )
    for method in ("DOP853", "RK45"):
        run = simulate(there_and_back, 60.0, backend="plain", method=method)
        assert run.notes[0].startswith("x fell below its tolerance, 1e-10, and grew again")
        exact = simulate(there_and_back, 60.0, backend="plain", method=method, atol={"x": 0.0})
        assert exact.notes == [] and exact.final["x"] == pytest.approx(1, rel=1e-6)


def test_a_state_that_is_driven_or_dies_out_is_not():
    def chain(t, s, p):
        return 1.0 - s.a, s.a - s.b, s.b - s.c, s.c - s.d

    names = dict.fromkeys("abcd", "")
    tanks = System("tanks", names, {}, [Mode("m", chain)], [], dict.fromkeys("abcd", 0.0))
    dying = System(
        "dying", {"x": "", "v": ""}, {}, [Mode("m", lambda t, s, p: (-s.x, s.x - 2 * s.v))],
        [], {"x": 1.0, "v": 0.0},
    )  # fmt: skip
    for system in (tanks, dying):
        assert simulate(system, 60.0, backend="plain").notes == []


def test_sliding_on_two_surfaces_at_once_names_both():
    def to(source, target, guard, direction, label):
        return Transition(source, target, guard=guard, direction=direction, label=label)

    x, y = (lambda t, s, p: s.x), (lambda t, s, p: s.y)
    corner = System(
        "corner",
        {"x": "", "y": ""},
        {},
        [
            Mode("pp", lambda t, s, p: (-1.0, -1.0)),
            Mode("pm", lambda t, s, p: (-1.0, 1.0)),
            Mode("mp", lambda t, s, p: (1.0, -1.0)),
            Mode("mm", lambda t, s, p: (1.0, 1.0)),
        ],
        [
            to("pp", "mp", x, -1, "x falls"),
            to("mp", "pp", x, 1, "x rises"),
            to("pm", "mm", x, -1, "x falls, y < 0"),
            to("mm", "pm", x, 1, "x rises, y < 0"),
            to("pp", "pm", y, -1, "y falls"),
            to("pm", "pp", y, 1, "y rises"),
            to("mp", "mm", y, -1, "y falls, x < 0"),
            to("mm", "mp", y, 1, "y rises, x < 0"),
        ],
        {"x": 1.0, "y": 2.0},
    )
    run = simulate(corner, 5.0, backend="plain")
    assert run.ended is Ended.LOOP and run.t[-1] == pytest.approx(2.0)
    assert "slides on two surfaces at once" in run.stopped
    assert '"x ' in run.stopped and '"y ' in run.stopped


def test_powers_to_the_last_bit():
    """x**2 is not x*x in one of a thousand cases, x**3 not x*x*x in one of four."""
    powers = System(
        "powers",
        {"a": "", "b": "", "c": "", "d": ""},
        {},
        [
            Mode(
                "m", lambda t, s, p: (-(s.a**2), -(s.b**3), -(abs(s.c) ** 4), -(s.d**-1) * s.a**0.5)
            )
        ],
        [],
        dict(a=1.0, b=1.1, c=0.9, d=3.0),
    )
    one, two = (simulate(powers, 2.0, backend=b, points=400) for b in BOTH)
    assert two.work.backend == "compiled" and np.array_equal(one.values, two.values)


def test_urgent_false_with_a_direction_waits_on_entering():
    """Zero on entering, and the new flow goes beyond: that is no crossing along the flow."""
    half = Fraction(1, 2)
    system = System(
        "two modes",
        {"x": ""},
        {},
        [Mode("a", lambda t, s, p: (-1.0,)), Mode("b", lambda t, s, p: (1.0,))],
        [
            Transition("a", "b", at=At(float(half))),
            Transition("b", "a", guard=lambda t, s, p: s.x, direction=1, urgent=False),
        ],
        {"x": float(half)},
    )
    run = simulate(system, 2.0, backend="plain")
    assert [event.t for event in run.events] == [0.5] and run.final["x"] == pytest.approx(1.5)


GROWTH = {
    "exponential": lambda t, s, p: (s.x,),
    "square": lambda t, s, p: (s.x * s.x,),
    "cube": lambda t, s, p: (s.x**3,),
    "exp": lambda t, s, p: (math.exp(s.x),),
    "downwards": lambda t, s, p: (-math.sinh(s.x * s.x),),
}


@pytest.mark.parametrize("method", ["DOP853", "RK45", "RK4", "LSODA", "BDF"])
@pytest.mark.parametrize("law", GROWTH)
def test_growth_without_bound_is_called_diverged(law, method):
    """Also where a number overflows, and where the pole comes at 35."""
    for unit in (1.0, 1e-6):  # of the time
        system = System(
            "growth", {"x": ""}, {"r": 1 / unit},
            [Mode("m", lambda t, s, p: tuple(p.r * rate for rate in GROWTH[law](t, s, p)))],
            start={"x": -1.0 if law == "downwards" else 1.0},
        )  # fmt: skip
        run = simulate(system, 800 * unit, method=method, backend="plain", rtol=1e-3)
        assert run.ended is Ended.DIVERGED and run.stopped.startswith("diverged: |x| = ")


@pytest.mark.parametrize("method", ["DOP853", "RK4", "BDF"])
@pytest.mark.parametrize("part", ["flow", "guard"])
def test_a_root_of_a_negative_number_is_named(part, method):
    """In Python (-1.0)**0.5 is a complex number."""

    def root(t, s, p):
        return (2.0 - s.x) ** 0.5

    guard = root if part == "guard" else lambda t, s, p: 1.0
    system = System(
        "tank", {"x": ""}, {},
        [Mode("m", lambda t, s, p: (1.0 + (root(t, s, p) if part == "flow" else 0.0),))],
        [Transition("m", None, guard=lambda t, s, p: 1.0 + guard(t, s, p), label="empty")],
        {"x": 0.0},
    )  # fmt: skip
    run = simulate(system, 5.0, method=method, backend="plain")
    what = "the flow of mode 'm'" if part == "flow" else "the guard of 'empty'"
    assert run.ended is Ended.NOT_A_NUMBER
    assert run.stopped.startswith(f"not a number: {what} is a complex number near t = ")
    assert "max(…, 0)" in run.stopped and "float()" not in run.stopped


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("directions", [(-1, 1), (0, 0)])
def test_two_modes_that_push_towards_a_jump_do_not_slide_by_halves(directions, backend):
    """A sign has no slope that says how the flows mix: that is said; half of each left the
    surface.
    """

    def sign(t, s, p):
        return 1.0 if s.x > 0 else -1.0

    relay = System(
        "relay", {"x": ""}, {},
        [Mode("a", lambda t, s, p: (-1.0,)), Mode("b", lambda t, s, p: (3.0,))],
        [
            Transition("a", "b", guard=sign, direction=directions[0], label="down"),
            Transition("b", "a", guard=sign, direction=directions[1], label="up"),
        ],
        {"x": 1.0},
    )  # fmt: skip
    run = simulate(relay, 3.0, backend=backend)
    assert run.ended is Ended.LOOP and run.t[-1] == pytest.approx(1.0)
    assert 'the guard of "up", which jumps there' in run.stopped


def test_a_schedule_written_out_twice_is_one_clock():
    """Two clocks would go to and fro at every instant."""

    def circuit(one, other):
        return System(
            "circuit", {"x": ""}, {"T": 1.0},
            [Mode("on", lambda t, s, p: (1.0,)), Mode("off", lambda t, s, p: (-1.0,))],
            [Transition("on", "off", at=one), Transition("off", "on", at=other)],
            {"x": 0.0},
        )  # fmt: skip

    half = 2
    for one, other in (
        (Every(lambda p: p.T / 2), Every(lambda p: p.T / 2)),
        (Every("T", lambda p: p.T / half), Every("T", lambda p: p.T / half)),
        (At(0.5, lambda p: p.T), At(0.5, lambda p: p.T)),
    ):
        run = simulate(circuit(one, other), 1.2, backend="plain")
        assert all(e.source == ("off" if n % 2 else "on") for n, e in enumerate(run.events))
        assert [e.t for e in run.events][:1] == [0.5] and len({e.t for e in run.events}) == len(
            run.events
        )

    def by_name(share):
        return Every(lambda p, *, share=share: share * p.T)

    def by_table(*table):
        rows = np.array(table)
        return Every(lambda p, rows=rows: rows[0] * p.T)

    for one, other in (
        (Every(lambda p: p.T), Every(lambda p: 1 * p.T)),
        (by_name(1.0), by_name(0.5)),
        (by_table(1.0, 2.0), by_table(1.0, 2.0)),
    ):
        apart = simulate(circuit(one, other), 1.2, backend="plain")
        assert [e.target for e in apart.events] == ["off", "on"]


def test_a_schedule_that_asks_for_a_name_without_a_value_is_said():
    for at in (At(lambda p: later), Every(lambda p: later)):
        bare = System(
            "bare", {"x": ""}, {}, [Mode("A", lambda t, s, p: (1.0,))],
            [Transition("A", "A", at=at)], {"x": 0.0},
        )  # fmt: skip
        with pytest.raises(ModelError, match="cannot be worked out: NameError"):
            simulate(bare, 1.0, backend="plain")
    later = 1.0
    assert [e.t for e in simulate(bare, 1.0, backend="plain").events] == [later]


@pytest.mark.parametrize("method", ["DOP853", "RK45", "RK4"])
def test_what_leaves_rest_by_its_third_derivative_does_not_cross_by_rounding(method):
    """Force and holding force cancel at that instant but for their rounding, of either sign."""

    def moving(sign):
        return lambda t, s, p: (s.v, p.h * math.sin(t + p.phase) - sign * p.K)

    def push(t, s, p):
        return p.h * math.sin(t + p.phase) - p.K

    def crosses(source, target, direction):
        return Transition(source, target, guard=lambda t, s, p: s.x, direction=direction)

    relay = System(
        "relay at rest", {"x": "", "v": ""}, {"h": 1.0, "K": 0.8, "phase": 0.0},
        [
            Mode("rest", lambda t, s, p: (0.0, 0.0)),
            Mode("right", moving(1)),
            Mode("left", moving(-1)),
        ],
        [
            Transition("rest", "right", guard=push, direction=1),
            crosses("right", "left", -1),
            crosses("left", "right", 1),
        ],
        {"x": 0.0, "v": 0.0},
    )  # fmt: skip
    dice = random.Random(method)
    for _ in range(6):
        K, phase = dice.uniform(0.3, 0.9), dice.uniform(-3.0, 0.0)
        run = simulate(relay, 5.0 - phase, method=method, backend="plain", K=K, phase=phase)
        leaves, *later = (event.t for event in run.events)
        assert leaves == pytest.approx(math.asin(K) - phase, abs=1e-9)
        assert not later or later[0] > leaves + 0.1


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e6])
def test_a_body_rests_on_its_surface_only(size):
    """A start in a mode of rest off its surface is refused, as one lane's reason, too; where a run
    has left the body it may start again.
    """
    table = System(
        "ball on a shaken table", {"y": "m", "v": "m/s"}, {"A": size},
        [
            Mode("flight", lambda t, s, p: (s.v, -9.81 * p.A)),
            Mode("rest", lambda t, s, p: (p.A * math.cos(t), -p.A * math.sin(t))),
        ],
        [
            Transition(
                "flight", "flight", direction=-1, zeno="rest", label="bounce",
                guard=lambda t, s, p: s.y - p.A * math.sin(t),
                reset={"v": lambda t, s, p: 1.3 * p.A * math.cos(t) - 0.3 * s.v},
            )
        ],
        {"y": 2.0 * size, "v": 0.0},
    )  # fmt: skip
    run = simulate(table, 8.0, backend="plain", rtol=1e-5)
    assert run.mode[-1] == "rest"
    again = dict(t0=8.0, mode="rest", backend="plain", rtol=1e-5)
    assert simulate(table, 9.0, start=run.final, **again).stopped == "finished"
    off = size * math.sin(8.0) + size * np.array([0.0, 0.5, -3.0])
    runs = simulate_many(table, 9.0, start={**run.final, "y": off}, **again)
    assert [run.ended for run in runs] == [Ended.FINISHED, Ended.REFUSED, Ended.REFUSED]
    with pytest.raises(ModelError, match="rests on the surface of 'bounce': its guard is"):
        simulate(table, 9.0, start={"y": off[1]}, **again)


def test_a_mode_that_is_entered_otherwise_too_is_no_mode_of_rest():
    ball = System(
        "ball and hand", {"y": "m", "v": "m/s"}, {},
        [Mode("flight", lambda t, s, p: (s.v, -9.81)), Mode("held", lambda t, s, p: (0.0, 0.0))],
        [
            Transition("flight", "flight", lambda t, s, p: s.y, direction=-1, zeno="held",
                       reset={"v": lambda t, s, p: -0.5 * s.v}),
            Transition("flight", "held", at=At(0.1)),
        ],
        {"y": 1.0, "v": 0.0},
    )  # fmt: skip
    assert simulate(ball, 1.0, mode="held", backend="plain").final["y"] == 1.0


def above(t, s, p):
    """Height over a floor that is accelerated."""
    return s.y - p.H - p.V * (t - p.begin) - p.A * (t - p.begin) ** 2 / 2


WRITTEN = {
    "sign": lambda z: float(np.sign(z)),
    "step": lambda z: 1.0 if z > 0 else -1.0,
    "stairs": lambda z: math.floor(8 * z) + 0.5,
    "cube": lambda z: z**3,
    "arc": lambda z: math.atan(20 * z),
    "square": lambda z: (z + 1e-3) ** 2 - 1e-6,
}


def grounded(name):
    return System(
        "ball", {"y": "m", "v": "m/s"}, {"e": 0.5, "H": 0.0, "V": 0.0, "A": 0.0, "begin": 0.0},
        [
            Mode("fly", lambda t, s, p: (s.v, -9.81)),
            Mode("rest", lambda t, s, p: (p.V + p.A * (t - p.begin), p.A)),
        ],
        [
            Transition(
                "fly", "fly", lambda t, s, p: WRITTEN[name](above(t, s, p)), direction=-1,
                reset={"v": lambda t, s, p: (1 + p.e) * (p.V + p.A * (t - p.begin)) - p.e * s.v},
                zeno="rest",
            )
        ],
        {"y": 1.0, "v": 0.0},
    )  # fmt: skip


@pytest.mark.parametrize("method", ["LSODA", "BDF", "DOP853"])
@pytest.mark.parametrize("H", [0.0, 30.0])
def test_a_sign_holds_the_floor_down_to_the_last_ticks(method, H):
    for name in ("sign", "step"):
        for e in (0.3, 0.7):
            run = simulate(
                grounded(name), 12.0, t0=4.0, start={"y": H + 2.5}, method=method, rtol=1e-10,
                backend="plain", e=e, H=H,
            )  # fmt: skip
            rest = 4 + math.sqrt(5 / 9.81) * (1 + 2 * e / (1 - e))
            assert run.mode[-1] == "rest" and abs(run.final["y"] - H) < 1e-6
            assert run.events[-1].t == pytest.approx(rest, abs=1e-3)


@pytest.mark.parametrize("name", WRITTEN)
def test_a_ball_rests_on_any_floor_by_any_guard_on_any_clock(name):
    """A floor that lies high, moves or is accelerated; a guard that jumps, bends or has no slope;
    flights that shrink slowly, at once, or that never begin.
    """
    ball = grounded(name)
    dice = random.Random(name)
    for case in range(16):
        e, H = dice.choice([0.0, 0.01, 0.3, 0.7]), dice.choice([0.0, 1.0, 100.0, 1e3])
        V, A = dice.choice([0.0, 0.9, -1.6]), dice.choice([0.0, 3.9, -2.9])
        begin, height = dice.choice([0.0, 1.0, 1e3, 1e6]), dice.choice([0.0, 0.2, 3.0])
        method = dice.choice(["RK45", "DOP853", "RK4", "LSODA", "BDF"])
        fall = math.sqrt(2 * height / (9.81 + A))
        rest = fall * (1 + 2 * e / (1 - e))
        run = simulate(
            ball, begin + rest + 1.0, t0=begin, start={"y": H + height, "v": V}, method=method,
            backend="plain", max_steps=20_000, rtol=1e-8, e=e, H=H, V=V, A=A, begin=begin,
        )  # fmt: skip
        assert run.stopped == "finished" and run.mode[-1] == "rest", (case, method, run.stopped)
        low = min(
            above(t, ball.S["fly"](y, 0.0), run.p) for t, y in zip(run.t, run["y"], strict=True)
        )
        assert low > -2e-4, (case, method, low)
        lies = [event.t - begin for event in run.events if event.target == "rest"]
        assert lies == pytest.approx([rest], abs=2e-2), (case, method)


@pytest.mark.parametrize("directions", [(1, -1), (0, 0), (1, 0), (0, -1)])
@pytest.mark.parametrize("scale", [1.0, 1e16, -1e-16])
def test_a_run_begins_on_a_surface_that_both_flows_push_to(directions, scale):
    """As one goes on that was cut in two; and passes where they do not."""

    def guard(t, s, p):
        return scale * (s.x - 3.0)

    up, down = (int(math.copysign(1, scale)) * each for each in directions)
    system = System(
        "two fields", {"x": "", "y": ""}, {"b": -1.0},
        [Mode("A", lambda t, s, p: (2.0, 1.0)), Mode("B", lambda t, s, p: (p.b, 0.0))],
        [
            Transition("A", "B", guard=guard, direction=up),
            Transition("B", "A", guard=guard, direction=down),
        ],
        {"x": 3.0, "y": 0.0},
    )  # fmt: skip
    for t0 in (0.0, 1e5):
        for mode in "AB":
            run = simulate(system, t0 + 3.0, t0=t0, mode=mode, backend="plain")
            assert run.events[-1].target == "sliding" and run.events[-1].t == t0
            assert run.final["x"] == pytest.approx(3.0, abs=1e-12)
            assert run.final["y"] == pytest.approx(1.0, abs=1e-7)  # a third of A
        run = simulate(system, t0 + 3.0, t0=t0, mode="B", b=1.0, backend="plain")
        assert run.final["x"] == pytest.approx(6.0) and not len(run.events)


# ---------------------------------------------------------------- guards that are steep, or signs

STEEP = {
    "bounded": lambda t, s, p: s.y / (abs(s.y) + p.w),
    "tanh": lambda t, s, p: math.tanh(s.y / p.w),
    "sign": lambda t, s, p: 1.0 if s.y > 0 else -1.0,
}


def bouncing(guard) -> System:
    return System(
        "ball over a steep guard",
        {"y": "m", "v": "m/s"},
        {"w": 1e-9, "e": 0.5},
        [Mode("flight", lambda t, s, p: (s.v, -9.81)), Mode("rest", lambda t, s, p: (0.0, 0.0))],
        [
            Transition(
                "flight",
                "flight",
                guard=guard,
                direction=-1,
                reset=lambda t, s, p: (s.y, -p.e * s.v),
                zeno="rest",
            )
        ],
        start={"y": 1.0, "v": 0.0},
    )


@pytest.mark.parametrize("kind", STEEP)
def test_a_steep_guard_holds_the_ball_and_its_end_fits_the_rest(kind):
    system = bouncing(STEEP[kind])
    for k, (w, h, method) in enumerate(
        itertools.product((1e-7, 1e-9, 1e-11, 1e-13), (0.3, 1.0, 2.7), ("RK45", "DOP853"))
    ):
        backend = BOTH[k == 7]  # one of them compiled
        run = simulate(system, 5.0, start={"y": h}, w=w, method=method, backend=backend)
        assert run.mode[-1] == "rest" and abs(run.final["y"]) < 1e-7, (w, h, method)
        assert run.events[0].t == pytest.approx(math.sqrt(2 * h / 9.81), abs=1e-7)
        again = simulate(system, 6.0, t0=5.0, start=run.final, mode="rest", w=w, backend="plain")
        assert again.ended == Ended.FINISHED and not len(again.events)


def test_a_sign_that_a_reset_leaves_as_it_was_is_no_contact():
    """Beyond stays beyond, but the state has moved on: it goes on from there."""
    for speed, last in ((1.0, 6.0), (-1.0, -1.0)):
        system = System(
            "sign",
            {"x": "", "v": ""},
            {},
            [Mode("m", lambda t, s, p: (s.v, 0.0))],
            [
                Transition(
                    "m",
                    "m",
                    guard=lambda t, s, p: 1.0 if s.x >= 1 else -1.0,
                    direction=1,
                    reset=lambda t, s, p, speed=speed: (s.x + 3.0, speed * s.v),
                )
            ],
            start={"x": 0.0, "v": 1.0},
        )
        run = simulate(system, 3.0 if speed > 0 else 6.0, backend="plain")
        assert [round(event.t, 9) for event in run.events] == [1.0]
        assert run.ended == Ended.FINISHED and run.final["x"] == pytest.approx(last)


def test_a_coarse_guard_carries_no_other_to_the_end_of_a_step():
    """A clock of 1.7e9 s is known to 1e-5 s; a bounce 8e-6 s before the end is not there yet."""
    system = System(
        "ball beside a large clock",
        {"tau": "s", "y": "m", "v": "m/s"},
        {"e": 0.9},
        [Mode("m", lambda t, s, p: (1.0, s.v, -9.81))],
        [
            Transition("m", "m", guard=lambda t, s, p: s.tau - (1.7e9 + 5 - 1.6e-5), direction=1),
            Transition(
                "m",
                "m",
                guard=lambda t, s, p: s.y,
                direction=-1,
                reset={"v": lambda t, s, p: -p.e * s.v},
                label="bounce",
            ),
        ],
        start={"tau": 1.7e9, "y": 0.5 * 9.81 * (5 - 8e-6) ** 2, "v": 0.0},
    )
    for e in (0.001, 0.9):
        for how in ({}, {"method": "RK4", "step": 5.0}):
            run = simulate(system, 5.0, e=e, backend="plain", **how)
            assert run.events["bounce"].t == pytest.approx([5 - 8e-6], abs=1e-9)
            assert run.final["y"] == pytest.approx(e * 9.81 * 5 * 8e-6, rel=1e-3)


def test_an_event_at_a_start_that_its_reset_cannot_have_left_is_not_skipped():
    def counted(x):
        return System(
            "counter",
            {"x": "", "n": ""},
            {},
            [Mode("m", lambda t, s, p: (1.0, 0.0))],
            [
                Transition(
                    "m",
                    "m",
                    guard=lambda t, s, p: s.x - 1.0,
                    direction=1,
                    reset=lambda t, s, p: (s.x + x, s.n + 1.0),
                )
            ],
            start={"x": 1.0, "n": 0.0},
        )

    for t0 in (0.0, 5.0):
        run = simulate(counted(2.0), t0 + 1.2, t0=t0, backend="plain")
        assert run.final == pytest.approx({"x": 4.2, "n": 1.0})
    # one that counts only is counted by the run before, if there is one
    assert simulate(counted(0.0), 6.2, t0=5.0, backend="plain").final["n"] == 0.0


def test_a_start_on_a_sign_that_both_flows_push_to_is_said():
    for direction in (0, 1):
        system = System(
            "relay by signs",
            {"y": ""},
            {},
            [Mode("above", lambda t, s, p: (-1.0,)), Mode("below", lambda t, s, p: (1.0,))],
            [
                Transition("above", "below", guard=STEEP["sign"], direction=-direction),
                Transition("below", "above", guard=STEEP["sign"], direction=direction),
            ],
            start={"y": 0.0},
        )
        for mode in ("above", "below"):
            run = simulate(system, 1.0, mode=mode, backend="plain")
            assert run.ended == Ended.LOOP and "jumps there" in run.stopped


# ---------------------------------------------------------------- late on the clock

FORCES = {  # (flow, its integral)
    "sine": (lambda t, s, p: (math.sin(t),), lambda t: -math.cos(t)),
    "fast": (lambda t, s, p: (10 * math.cos(10 * t),), lambda t: math.sin(10 * t)),
    "time": (lambda t, s, p: (t,), None),
    "slow": (lambda t, s, p: (1e-6 * math.sin(t),), lambda t: -1e-6 * math.cos(t)),
}


@pytest.mark.parametrize("name", FORCES)
@pytest.mark.parametrize("method", ["RK45", "DOP853", "Radau", "LSODA"])
def test_a_state_from_zero_is_known_as_well_as_a_late_clock_lets_it(method, name):
    """Its size is nothing to begin with, and so was its tolerance: "diverged", or "no step is short
    enough".
    """
    flow, whole = FORCES[name]
    system = System("forced", {"x": ""}, {}, [Mode("m", flow)], [], start={"x": 0.0})
    for t0 in (1e3, 1e6, 1e8):
        for rtol in (1e-6, 1e-9, 1e-12):
            run = simulate(system, t0 + 7, t0=t0, method=method, rtol=rtol, backend="plain")
            assert run.stopped == "finished", (t0, rtol, run.stopped)
            exact = 3.5 * (2 * t0 + 7) if whole is None else whole(t0 + 7) - whole(t0)
            size = 7 * t0 if whole is None else 1e-6 if name == "slow" else 1.0
            off = abs(run.final["x"] - exact) / size
            assert off < 3000 * rtol + 3000 * np.spacing(t0), (t0, rtol, off)
