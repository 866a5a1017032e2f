"""What happens when things coincide, by exact answers: a few random cases of every kind in
`coincidences` (many of them: `python -m tests.coincidences 10000`), and examples by name.
"""

import itertools
import random
from fractions import Fraction
from importlib import import_module

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from labkit import At, Every, Mode, ModelError, System, Transition, simulate, simulate_many

from .coincidences import KINDS, belt, bodies, counters, floors
from .coincidences.__main__ import ways
from .coincidences.reference import Edge, Guard, Jump, Story, Unclear

BOTH = ("plain", "compiled")
FEW_SHAPES = {
    "linear": 2,
    "jumps": 2,
    "bodies": 1,
    "billiard": 1,
    "counters": 2,
}  # each shape is compiled anew
EXAMPLES = {"floors": 6, "belt": 6, "linear": 25, "jumps": 25}

both = pytest.mark.parametrize("backend", BOTH)


@both
@pytest.mark.parametrize("name", KINDS)
def test_random_cases(name, backend):
    kind = import_module(f".coincidences.{name}", __package__)
    methods = [method for b, method in ways(kind) if b == backend]
    shapes = {"shapes": FEW_SHAPES[name]} if name in FEW_SHAPES else {}

    # a seed does not become simpler by becoming smaller: nothing to shrink
    @settings(max_examples=EXAMPLES.get(name, 12), deadline=None, phases=[Phase.generate])
    @given(st.integers(0, 10**9), st.sampled_from(methods))
    def examine(seed, method):
        case = kind.generate(random.Random(seed), **shapes)
        assert not kind.check(case, backend, method), f"{method}: {case}"

    examine()


@both
def test_a_step_of_a_few_ticks_of_the_clock(backend):
    """It ends where four guards and two schedules are due; who does not cross in it has not
    crossed with the others.
    """
    crossing = tuple(map(Fraction, ("7/2", "2", "7/2", "7/2", "7/2", "7/2")))
    case = counters.Case(
        Fraction(1, 2), Fraction(5, 4), crossing, (0, 1, 0, 1, 1, -1), (2, 1, 1, 1, 1, 1, 2, 0),
        Fraction(7, 2), (Fraction(7, 2), Fraction(9, 2)), 180180, Fraction(9, 2), (1.0, 0.1),
    )  # fmt: skip
    assert not counters.check(case, backend, "Euler")


# ---------------------------------------------------------------- bodies


@both
@pytest.mark.parametrize("direction", [-1, 0])
def test_three_carts_at_one_place(backend, direction):
    """12, 23, 12 at one instant: a crossing may come again after another has put it back."""
    case = bodies.Case(
        tuple(map(Fraction, (0, Fraction(1, 2), 1, 50, 60, 70))),
        tuple(map(Fraction, (1, 0, -1, 0, 0, 0))),
        direction, (0, 0, 0, 0, 0), 0.0, 0.0, Fraction(3, 2),
    )  # fmt: skip
    assert bodies.expected(case) == 3
    for method in bodies.METHODS:
        assert not bodies.check(case, backend, method)


@both
@pytest.mark.parametrize("swung", [1, 2, 3])
def test_cradle(backend, swung):
    """As many swing out as swing in; bodies that touch and rest are not beyond each other."""
    case = bodies.Case(
        tuple(Fraction(-1 if k < swung else 0) for k in range(6)),
        tuple(Fraction(1 if k < swung else 0) for k in range(6)),
        -1, (0, 0, 0, 0, 0), 0.0, 0.0, Fraction(3),
    )  # fmt: skip
    assert bodies.expected(case) == swung * (6 - swung)
    for method in bodies.METHODS:
        assert not bodies.check(case, backend, method)


# ---------------------------------------------------------------- one instant


def keeping_log(k):
    digit = float(k)
    return lambda t, s, p: (s.x, s.log * 10 + digit)


@both
@pytest.mark.parametrize("direction", [1, 0])
@pytest.mark.parametrize(
    ("priorities", "log"), [((0, 0, 0, 0), 1234), ((0, 1, 2, 3), 4321), ((1, 3, 1, 2), 2413)]
)
def test_guards_clocks_and_instants_go_by_priority(backend, direction, priorities, log):
    """A state, the time, Every and At meet at t = 2."""
    pieces = (
        {"guard": lambda t, s, p: s.x - 2, "direction": direction},
        {"guard": lambda t, s, p: t - 2, "direction": direction},
        {"at": Every(2.0)},
        {"at": At(2.0)},
    )
    system = System(
        "meeting",
        {"x": "", "log": ""},
        {},
        [Mode("only", lambda t, s, p: (1.0, 0.0))],
        [
            Transition("only", "only", priority=q, reset=keeping_log(k + 1), **piece)
            for k, (piece, q) in enumerate(zip(pieces, priorities, strict=True))
        ],
        start={"x": 0.0, "log": 0.0},
    )
    for method in ("RK4", "RK45", "DOP853"):
        assert simulate(system, 3.0, method=method, step=0.125, backend=backend).final["log"] == log


@both
@pytest.mark.parametrize("direction", [1, 0])
def test_one_crossing_of_a_transition_with_two_sources_is_one_event(backend, direction):
    system = System(
        "own source",
        {"x": ""},
        {},
        [Mode("A", lambda t, s, p: (1.0,)), Mode("B", lambda t, s, p: (1.0,))],
        [Transition(("A", "B"), "B", guard=lambda t, s, p: s.x - 1, direction=direction)],
        {"x": 0.0},
    )
    run = simulate(system, 2.0, backend=backend)
    assert [(e.source, e.target) for e in run.events] == [("A", "B")]


@both
def test_an_urgent_loop_counts_down(backend):
    """urgent=True fires again and again while its guard is beyond."""
    system = System(
        "count down",
        {"n": "", "k": ""},
        {},
        [Mode("only", lambda t, s, p: (0.0, 0.0))],
        [
            Transition(
                "only",
                "only",
                guard=lambda t, s, p: s.n - 0.5,
                direction=1,
                urgent=True,
                reset=lambda t, s, p: (s.n - 1, s.k + 1),
            )
        ],
        {"n": 3.0, "k": 0.0},
    )
    assert simulate(system, 5.0, backend=backend).final == {"n": 0.0, "k": 3.0}


@both
def test_a_jump_over_a_threshold(backend):
    """A harvest at t = 5 carries the stock below the threshold of extinction: extinct at 5; as
    it would not be with urgent=False.
    """
    for urgent, mode in ((None, "extinct"), (False, "alive")):
        fish = System(
            "fish",
            {"N": ""},
            {},
            [Mode("alive", lambda t, s, p: (0.1 * s.N,)), Mode("extinct", lambda t, s, p: (0.0,))],
            [
                Transition("alive", "alive", at=At(5.0), reset=lambda t, s, p: (s.N - 160.0,)),
                Transition(
                    "alive",
                    "extinct",
                    guard=lambda t, s, p: s.N - 10.0,
                    direction=-1,
                    urgent=urgent,
                    reset=lambda t, s, p: (0.0,),
                ),
            ],
            {"N": 100.0},
        )
        run = simulate(fish, 20.0, backend=backend)
        assert run.mode[-1] == mode and all(e.t == 5.0 for e in run.events)


@both
def test_a_jump_undoes_a_crossing(backend):
    """x reaches 1 at t = 1, where a dose of higher priority takes it away again: no event
    there.
    """
    system = System(
        "undone",
        {"x": "", "n": ""},
        {},
        [Mode("only", lambda t, s, p: (1.0, 0.0))],
        [
            Transition(
                "only", "only", at=At(1.0), priority=1, reset=lambda t, s, p: (s.x - 0.5, s.n)
            ),
            Transition(
                "only",
                "only",
                guard=lambda t, s, p: s.x - 1,
                direction=1,
                reset=lambda t, s, p: (s.x, s.n + 1),
            ),
        ],
        {"x": 0.0, "n": 0.0},
    )
    run = simulate(system, 2.0, backend=backend)
    assert [e.t for e in run.events] == pytest.approx([1.0, 1.5], abs=1e-12)
    assert run.final["n"] == 1


def reaches_one(t, s, p):
    return s.x - 1


@both
@pytest.mark.parametrize("second", [1, 0])
@pytest.mark.parametrize("first", ["clock", 1, 0])
def test_a_crossing_waits_though_the_mode_after_turns_back(backend, first, second):
    """x reaches 1 at t = 1, where what goes first sends it back: no reset has undone that."""
    go = {"at": At(1.0)} if first == "clock" else {"guard": reaches_one, "direction": first}
    system = System(
        "turned back",
        {"x": ""},
        {},
        [Mode("A", lambda t, s, p: (1.0,)), Mode("B", lambda t, s, p: (-1.0,))],
        [
            Transition("A", "B", priority=1, **go),
            Transition(("A", "B"), "B", guard=lambda t, s, p: 2 * (s.x - 1), direction=second),
        ],
        {"x": 0.0},
    )
    assert [e.index for e in simulate(system, 3.0, backend=backend).events] == [0, 1]


# ---------------------------------------------------------------- no direction, sliding


@both
@pytest.mark.parametrize("directions", [(-1, 1), (0, 0), (-1, 0), (0, 1)])
def test_a_box_that_friction_stops(backend, directions):
    box = System(
        "box",
        {"v": "m/s"},
        {"a": 2.94},
        [Mode("forward", lambda t, s, p: (-p.a,)), Mode("backward", lambda t, s, p: (p.a,))],
        [
            Transition("forward", "backward", guard=lambda t, s, p: s.v, direction=directions[0]),
            Transition("backward", "forward", guard=lambda t, s, p: s.v, direction=directions[1]),
        ],
        {"v": 10.0},
    )
    run = simulate(box, 10.0, backend=backend)
    assert run.stopped == "finished" and abs(run.final["v"]) < 1e-12
    assert all(e.t == pytest.approx(10 / 2.94, abs=1e-11) for e in run.events) and run.events


@both
def test_switches_are_counted_until_the_state_slides(backend):
    """… and the flows on the surface read the count that is in the ledger."""
    count = {"n": lambda t, s, p: s.n + 1}
    system = System(
        "counted switches",
        {"x": "", "z": ""},
        {},
        [Mode("A", lambda t, s, p: (1.0, s.n)), Mode("B", lambda t, s, p: (-2.0, s.n))],
        [
            Transition("A", "B", guard=lambda t, s, p: s.x, direction=1, reset=count),
            Transition("B", "A", guard=lambda t, s, p: s.x, direction=-1, reset=count),
        ],
        {"x": -0.5, "z": 0.0},
        held={"n": ("", 0.0)},
    )
    run = simulate(system, 3.0, backend=backend, max_steps=1000)
    assert run.stopped == "finished" and run.final["n"] == 1
    assert run.final["z"] == pytest.approx(2.5, abs=1e-9)


@pytest.mark.parametrize("method", ["RK45", "DOP853"])
@pytest.mark.parametrize("law", ["constant", "falling"])
def test_no_force_on_the_belt_ends_in_a_loop(law, method):
    system, forces = belt.belt(law, True), np.linspace(0.3, 3, 201)
    runs = simulate_many(
        system, 20.0, F=forces, mode="slower", method=method, rtol=1e-8, atol=1e-10,
        max_events=3000, backend="compiled",
    )  # fmt: skip
    assert {reason.split(" at ")[0] for reason in runs.stopped} == {"finished"}


# ---------------------------------------------------------------- rest


@both
@pytest.mark.parametrize("zeno", ["rest", None])
@pytest.mark.parametrize("H", [-1e3, -1.0, 0.0, 1e-3, 1.0, 3.0, 1e3])
def test_a_ball_over_any_floor(backend, zeno, H):
    for method in ("RK45", "DOP853"):
        for t0 in (0.0, 3e5):
            assert not floors.check(floors.Case(H, 2.0, 1.0, 0.5, t0, zeno), backend, method)


# ---------------------------------------------------------------- scales


@both
def test_a_start_beyond_a_guard_is_refused_beside_a_large_state(backend):
    system = System(
        "past",
        {"N": "", "S": ""},
        {},
        [Mode("only", lambda t, s, p: (0.0, 1.0))],
        [Transition("only", None, guard=lambda t, s, p: s.S - 100.0, direction=1)],
        {"N": 1e9, "S": 100.5},
    )
    with pytest.raises(ModelError, match="already"):
        simulate(system, 1.0, backend=backend)


# ---------------------------------------------------------------- what rounding tears apart


def moving(u, transitions, start=0.0, **held):
    """x' = u in A and in B."""
    modes = [Mode(name, lambda t, s, p: (p.u,)) for name in "AB"]
    held = {name: ("", value) for name, value in held.items()}
    return System("moving", {"x": ""}, {"u": u}, modes, transitions, {"x": start}, held=held)


@both
@pytest.mark.parametrize(("x", "u", "t"), [(10.37, 1.0, 0.5), (9.8, -0.7, 1.1), (10.1, -0.7, 0.5)])
def test_a_guard_and_a_schedule_meet_within_the_rounding_of_the_guard(backend, x, u, t):
    """The guard's zero lies some roundings of x before the schedule, which has the priority."""
    level = x + u * t
    for method in ("RK4", "RK45", "DOP853"):
        system = moving(
            u,
            [
                Transition("A", "B", guard=lambda t, s, p, level=level: s.x - level),
                Transition("A", "B", at=At(t), priority=1),
            ],
            x,
        )
        run = simulate(system, 5.0, method=method, step=0.0625, backend=backend)
        assert [(e.index, e.t) for e in run.events] == [(1, t)]


@both
def test_a_dead_time_and_a_schedule_meet_within_the_rounding_of_the_crossing(backend):
    system = moving(
        -1 / 2500,
        [
            Transition("A", "B", at=At(-300.0)),
            Transition(
                "A", "B", guard=lambda t, s, p: 0.1 * s.x - 0.8 + 0.886, direction=-1, delay=600.0
            ),
        ],
        -0.7,
    )
    run = simulate(system, 1700.0, t0=-1300.0, step=62.5, method="RK4", backend=backend)
    assert [e.index for e in run.events] == [0]


@both
@pytest.mark.parametrize(("one", "two"), [(1000.3, 0.1), (1000.1, 0.7), (777.7, 0.3)])
def test_held_variables_are_terms_of_a_guard(backend, one, two):
    """A schedule puts x on the surface, to rounding; x falls, so nothing has crossed."""
    system = moving(
        -1.0,
        [
            Transition("A", "A", at=At(1.0), reset={"x": two}),
            Transition("A", "B", guard=lambda t, s, p: s.x + s.one - s.sum, direction=1),
        ],
        one=one,
        sum=one + two - 2.0**-43,
    )
    assert len(simulate(system, 2.0, backend=backend).events) == 1


@both
@pytest.mark.parametrize("t", [2 / 3, 4 / 9, 8 / 9])
def test_a_held_variable_that_jumps_leaves_the_clock_as_it_is(backend, t):
    """On the surface within the clock's rounding and moving away: as without the jump."""
    system = moving(
        1.0,
        [
            Transition("A", "A", at=At(1e9 + t), reset={"level": t}),
            Transition("A", "B", guard=lambda t, s, p: s.x - s.level, direction=-1),
        ],
        level=-5.0,
    )
    assert len(simulate(system, 1e9 + 2, t0=1e9, backend=backend).events) == 1


@both
@pytest.mark.parametrize("reset", [None, {"n": lambda t, s, p: s.n + 1}])
def test_a_count_at_a_seam_belongs_to_the_run_that_ends_there(backend, reset):
    """… but a ball that starts on the floor and falls is thrown back."""
    loop = Transition("A", "A", guard=lambda t, s, p: s.x - 1, direction=1, reset=reset)
    system = moving(1.0, [loop], n=0.0)
    one = simulate(system, 1.0, backend=backend)
    two = simulate(system, 3.0, t0=1.0, start=one.final, backend=backend)
    assert len(one.events) == 1 and not two.events

    ball = System(
        "ball",
        {"y": "", "v": ""},
        {},
        [Mode("A", lambda t, s, p: (s.v, -1.0))],
        [
            Transition(
                "A", "A", guard=lambda t, s, p: s.y, direction=-1, reset={"v": lambda t, s, p: -s.v}
            )
        ],
        {"y": 0.0, "v": -1.0},
    )
    assert [e.t for e in simulate(ball, 6.0, t0=5.0, backend=backend).events] == [5.0]


def stopping(transitions, start=0.0, u=0.0):
    """x' = u in A, 0 in B."""
    modes = [Mode("A", lambda t, s, p: (p.u,)), Mode("B", lambda t, s, p: (0.0,))]
    return System(
        "stopping", {"x": ""}, {"u": u, "L": 0.0, "when": 1.0}, modes, transitions, {"x": start}
    )


@both
def test_what_resets_make_small_has_the_rounding_of_what_they_made_it_of(backend):
    """-0.3 + 0.1 + 0.2 is 2.8e-17, and no further above zero than -0.3 is known."""
    found = 0
    for one, two in itertools.product(np.arange(0.1, 1.0, 0.1).round(1), repeat=2):
        start = -round(one + two, 1)
        left = start + one + two
        found += left > 0
        system = stopping(
            [
                Transition("B", "B", at=At(1.0), reset={"x": lambda t, s, p, one=one: s.x + one}),
                Transition("B", "B", at=At(2.0), reset={"x": lambda t, s, p, two=two: s.x + two}),
                Transition("B", "A", guard=lambda t, s, p: s.x, direction=1, urgent=True),
            ],
            start,
        )
        run = simulate(system, 3.0, mode="B", backend="plain" if left == 0 else backend)
        assert [e.t for e in run.events] == [1, 2], (one, two, left)
        if found > 6:
            return
    raise AssertionError("nothing was tried")


@both
@pytest.mark.parametrize("urgent", [None, True])
def test_what_stands_still_is_known_as_well_as_the_clock_was(backend, urgent):
    """x has come to L late on the clock, up to the clock's rounding, and stands there."""
    system = stopping(
        [
            Transition("A", "B", at=At("when")),
            Transition("B", "A", guard=lambda t, s, p: s.x - p.L, direction=1, urgent=urgent),
        ]
    )
    beyond = 0
    for t0, u, time in itertools.product((1e3, 1e5 / 3), (98.1, -0.7, 3.3e5), (0.2, 1.3, 0.7)):
        L = u * time
        run = simulate(system, t0 + 2, t0=t0, u=u, L=L, when=t0 + time, backend=backend)
        assert [e.index for e in run.events] == [0], (t0, u, time, run.final["x"] - L)
        beyond += run.final["x"] > L
    assert beyond > 2


@both
def test_a_mode_of_no_duration_leads_nowhere(backend):
    """x reaches 1 upwards in A, passes through B, where it would fall, and goes on upwards in A: a
    guard without direction that A alone has was not crossed against the arrival.
    """
    modes = [Mode("A", lambda t, s, p: (1.0,)), Mode("B", lambda t, s, p: (-1.0,))]
    system = System(
        "passing", {"x": ""}, {}, modes,
        [
            Transition("A", "A", guard=lambda t, s, p: s.x - 1),
            Transition("A", "B", at=At(1.0), priority=1),
            Transition("B", "A", at=At(1.0, 7.0)),
        ],
        {"x": 0.0},
    )  # fmt: skip
    run = simulate(system, 2.0, backend=backend)
    assert [e.index for e in run.events] == [1, 2]


# ---------------------------------------------------------------- the reference itself

ONE, ZERO = Fraction(1), Fraction(0)
X = Guard(ONE, ZERO, ZERO, ONE)  # x − 1


def told(edges, flows=((ONE, ZERO), (ONE, ZERO)), start=(ZERO, ZERO), t_end=Fraction(3)):
    return [
        (line.t, line.edge, line.target)
        for line in Story(list(flows), edges, 0, start).tell(t_end).lines
    ]


def test_the_reference_counts_and_orders():
    edges = [Edge((0,), 0, X, 1), Edge((0,), 0, X, 0, priority=1), Edge((0,), 0, at=(ONE,))]
    assert told(edges) == [(1, 1, 0), (1, 0, 0), (1, 2, 0)]


def test_the_reference_uses_a_crossing_once():
    assert told([Edge((0, 1), 1, X, 1)]) == [(1, 0, 1)]


def test_the_reference_enters_modes_beyond_their_guards():
    low = Guard(ONE, ZERO, ZERO, Fraction(1, 2))
    for urgent, right in ((None, [(1, 0, 1), (1, 1, None)]), (False, [(1, 0, 1)])):
        assert told([Edge((0,), 1, X, 1), Edge((1,), None, low, 1, urgent=urgent)]) == right


def test_the_reference_carries_and_puts_back():
    """A tick throws x over 1 and the next one back; without direction both ways count, with one
    only up.
    """
    ticks = [
        Edge((0,), 0, at=(ONE,), jump=Jump(hx=Fraction(2))),
        Edge((0,), 0, at=(Fraction(2),), jump=Jump(hx=Fraction(-2))),
    ]
    still = ((ZERO, ZERO),)
    assert told([*ticks, Edge((0,), 0, X, 1)], still) == [(1, 0, 0), (1, 2, 0), (2, 1, 0)]
    assert told([*ticks, Edge((0,), 0, X, 0)], still)[-1] == (2, 2, 0)
    assert len(told([*ticks, Edge((0,), 0, X, 1, urgent=False)], still)) == 2


def test_the_reference_undoes_a_crossing():
    tick = Edge((0,), 0, at=(ONE,), jump=Jump(hx=Fraction(-1, 2)), priority=1)
    assert told([tick, Edge((0,), 0, X, 1)]) == [(1, 0, 0), (Fraction(3, 2), 1, 0)]


def test_the_reference_leaves_sliding_alone():
    edges = [Edge((0,), 1, X, 1), Edge((1,), 0, X, -1)]
    with pytest.raises(Unclear):
        told(edges, ((ONE, ZERO), (-ONE, ZERO)))
