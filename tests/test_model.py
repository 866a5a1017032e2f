"""The model object refuses what makes no sense, in words.

A Run gives back what was computed, bit for bit, also from a file.
"""

import csv
import importlib.util
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit import run as run_module
from labkit.model import OPTIONS, At, Every, Mode, ModelError, Output, Parameter, System, Transition
from labkit.run import Ended, Event, Run, Work, load_npz
from labkit.solve import simulate

from .by_hand import lanes


def flow(t, s, p):
    return (1.0,)


def guard(t, s, p):
    return s.x


def system(**changed):
    """A small right system with one or two things changed."""
    return System(
        **(
            {
                "name": "cart",
                "states": {"x": "m"},
                "parameters": {"k": Parameter(2.0, "N/m", "stiffness", 0, 5)},
                "modes": [Mode("a", flow), Mode("b", flow)],
                "start": {"x": 1.0},
            }
            | changed
        )
    )


def leaving(source="a", target="b", **options):
    return lambda: system(transitions=[Transition(source, target, **options)])


TWO = [Mode("a", flow), Mode("b", flow, states={"y": "m", "v": "m/s"})]
NAN = float("nan")

REFUSED = {
    "no states": (
        lambda: system(states={}),
        "system 'cart' has no states: give states={'x': 'm', …}",
    ),
    "state is no name": (
        lambda: system(states={"2x": "m"}),
        "state of the system '2x' must be a plain Python name",
    ),
    "state is a keyword": (
        lambda: system(states={"lambda": ""}),
        "so that s.lambda or p.lambda can be written",
    ),
    "state with an underscore": (
        lambda: system(states={"_x": ""}),
        "'_x' must be a plain Python name",
    ),
    "state is a number": (
        lambda: system(states={1: ""}),
        "state of the system 1 must be a plain Python name",
    ),
    "state t": (
        lambda: system(states={"t": "s"}),
        "state of the system 't' has the name of the time, the first argument of every function",
    ),
    "one state in two units": (
        lambda: system(modes=[Mode("a", flow), Mode("b", flow, states={"x": "cm"})]),
        "state 'x' has the unit 'cm' in mode 'b' and 'm' elsewhere",
    ),
    "parameter is no name": (
        lambda: system(parameters={"k 1": 2}),
        "parameter 'k 1' must be a plain Python name",
    ),
    "parameter is an option": (
        lambda: system(parameters={"rtol": 1}),
        "parameter 'rtol' has the name of an option of simulate: give it another, rtol_ for",
    ),
    "parameter is a word": (
        lambda: system(parameters={"k": "stiff"}),
        "parameter 'k' must be a number, not 'stiff'",
    ),
    "parameter is None": (
        lambda: system(parameters={"k": None}),
        "parameter 'k' must be a number, not None",
    ),
    "parameter is nan": (
        lambda: system(parameters={"k": NAN}),
        "parameter 'k' must be finite, not nan",
    ),
    "parameter is infinite": (
        lambda: system(parameters={"k": Parameter(math.inf)}),
        "parameter 'k' must be finite, not inf",
    ),
    "parameter too large": (
        lambda: system(parameters={"k": Parameter(6, "N/m", low=0, high=5)}),
        r"parameter 'k' = 6 is outside its range \[0, 5\] N/m",
    ),
    "parameter too small": (
        lambda: system(parameters={"k": Parameter(-1, low=0)}),
        r"parameter 'k' = -1 is outside its range \[0, ∞\]$",
    ),
    "parameter above its only bound": (
        lambda: system(parameters={"k": Parameter(2, high=1)}),
        r"outside its range \[-∞, 1\]",
    ),
    "states are a list": (
        lambda: system(states=["x"]),
        r"states of the system must be a dict \{'x': 'm', …\}, not \['x'\]",
    ),
    "state without unit": (
        lambda: system(states={"x": None}),
        r"state 'x' of the system needs a unit, or \(unit, meaning\), not None",
    ),
    "state with half a pair": (lambda: system(states={"x": ("m",)}), "needs a unit, or"),
    "state mode": (
        lambda: system(states={"mode": ""}),
        "state of the system 'mode' has the name of a column of every run",
    ),
    "parameters are a list": (
        lambda: system(parameters=["k"]),
        "parameters of 'cart' must be a dict",
    ),
    "parameter like a state": (
        lambda: system(parameters={"x": 1}),
        "parameter 'x' has the name of a state: .*; a formula could not tell them apart",
    ),
    "parameter like a mode's own state": (
        lambda: system(parameters={"v": 1}, modes=TWO),
        "state of mode 'b' 'v' has the name of a parameter",
    ),
    "parameter t": (lambda: system(parameters={"t": 1}), "parameter 't' has the name of the time"),
    "empty range": (
        lambda: system(parameters={"k": Parameter(1.5, low=2, high=1)}),
        r"parameter 'k' has the range \[2, 1\]: its lower bound is above",
    ),
    "range of nan": (
        lambda: system(parameters={"k": Parameter(1.5, low=NAN)}),
        "a bound of parameter 'k' must be finite",
    ),
    "start is a list": (lambda: system(start=[1.0]), r"start must be a dict \{'x': 1.0, …\}, not"),
    "output is a function": (
        lambda: system(outputs={"F": guard}),
        r"output 'F' must be Output\(function",
    ),
    "output of no function": (
        lambda: system(outputs={"F": Output({"a": 3.0})}),
        r"output 'F' must be Output\(function",
    ),
    "output like a parameter": (
        lambda: system(outputs={"k": Output(guard)}),
        "output 'k' has the name of a parameter",
    ),
    "output called mode": (
        lambda: system(outputs={"mode": Output(guard)}),
        "output 'mode' has the name of a column of every run",
    ),
    "mode is a function": (
        lambda: system(modes=[flow]),
        r"modes of 'cart' must be Mode\(name, flow\), not <function",
    ),
    "mode without name": (lambda: system(modes=[Mode("", flow)]), r"must be Mode\(name, flow\)"),
    "transition is a word": (
        lambda: system(transitions=["a"]),
        "transitions of 'cart' must be Transition",
    ),
    "source is None": (leaving(None, guard=guard), r"must be Transition\(source mode"),
    "priority is a word": (
        leaving(guard=guard, priority="high"),
        "priority of transition 'a → b' must be a number, not 'high'",
    ),
    "no modes": (
        lambda: system(modes=[]),
        r"system 'cart' has no mode: give modes=\[Mode\('motion', flow\)\]",
    ),
    "two modes of one name": (
        lambda: system(modes=[Mode("a", flow), Mode("a", flow)]),
        "two modes are called 'a': give each its own name",
    ),
    "flow is no function": (
        lambda: system(modes=[Mode("a", 3.0)]),
        r"the flow of mode 'a' must be a function f\(t, s, p\), not 3.0",
    ),
    "unknown start mode": (
        lambda: system(mode="c"),
        "start mode 'c' is not a mode of 'cart'; there are 'a', 'b'",
    ),
    "unknown start state": (
        lambda: system(start={"x": 1, "z": 0}),
        "start names the unknown state\\(s\\) 'z'; there are 'x'",
    ),
    "missing start state": (
        lambda: system(start={}),
        "start gives no value for 'x': mode 'a' has the states 'x'",
    ),
    "missing state of the start mode": (
        lambda: system(modes=TWO, mode="b"),
        "start gives no value for 'y', 'v': mode 'b' has the states 'y', 'v'",
    ),
    "start is a word": (
        lambda: system(start={"x": "far"}),
        "start of 'x' must be a number, not 'far'",
    ),
    "start is nan": (lambda: system(start={"x": NAN}), "start of 'x' must be finite, not nan"),
    "output is no name": (
        lambda: system(outputs={"F!": Output(guard)}),
        "output 'F!' must be a plain Python name",
    ),
    "output like a state": (
        lambda: system(outputs={"x": Output(guard)}),
        "output 'x' has the name of a state: give it another",
    ),
    "output called t": (
        lambda: system(outputs={"t": Output(guard)}),
        "output 't' has the name of the time",
    ),
    "output of an unknown mode": (
        lambda: system(outputs={"F": Output({"c": guard, "a": guard})}),
        "output 'F' names the unknown mode\\(s\\) 'c'; there are 'a', 'b'",
    ),
    "unknown source": (
        leaving("c", guard=guard),
        "transition 'c → b' names the unknown mode 'c'; there are 'a', 'b'",
    ),
    "unknown source among several": (
        leaving(("a", "c"), guard=guard),
        "transition 'a | c → b' names the unknown mode 'c'",
    ),
    "unknown target": (
        leaving("a", "c", guard=guard, label="jump"),
        "transition 'jump' names the unknown mode 'c'",
    ),
    "unknown zeno mode": (leaving(guard=guard, zeno="rest"), "names the unknown mode 'rest'"),
    "no source": (leaving((), guard=guard), "has no source mode"),
    "neither guard nor schedule": (
        leaving(),
        r"transition 'a → b' needs either a guard \(a function\) or at= \(a schedule\), and not "
        r"both",
    ),
    "guard and schedule": (leaving(guard=guard, at=At(1.0)), "needs either a guard"),
    "guard is no function": (
        leaving(guard=1.0),
        r"the guard of transition 'a → b' must be a function f\(t, s, p\), not 1.0",
    ),
    "guard takes two": (
        leaving(guard=lambda t, s: s.x),
        r"the guard of transition 'a → b' must be a function f\(t, s, p\), not f\(",
    ),
    "reset takes one": (
        leaving(guard=guard, reset=lambda s: s),
        r"the reset of transition 'a → b' must be a function f\(t, s, p\), not f\(",
    ),
    "a part of a reset takes one": (
        leaving(guard=guard, reset={"x": lambda s: 0.0}),
        "the reset of transition 'a → b' for 'x' must be a function f",
    ),
    "reset is no function": (
        leaving(guard=guard, reset=(0.0,)),
        r"the reset of transition 'a → b' must be a function f\(t, s, p\), not \(0.0,\)",
    ),
    "direction": (
        leaving(guard=guard, direction=2),
        r"has direction 2: it is -1 \(falling\), \+1 \(rising\) or 0 \(both\)",
    ),
    "schedule is a number": (
        leaving(at=5.0),
        r"at= takes Every\(period\) or At\(instant, …\), not 5.0",
    ),
    "direction of two": (
        leaving(guard=guard, direction=np.array([1, -1])),
        r"has direction array\(\[ 1, -1\]\): it is -1",
    ),
    "urgent of two": (
        leaving(guard=guard, urgent=np.array([True, False])),
        "urgent of transition 'a → b' is True, False or None, not array",
    ),
    "label is no text": (
        leaving(guard=guard, label=3),
        "the label of transition 3 must be a text, not 3",
    ),
    "urgent without direction": (
        leaving(guard=guard, urgent=True),
        "is urgent, so it needs a direction: \\+1 fires while the guard is > 0",
    ),
    "negative tolerance": (
        leaving(guard=guard, direction=1, tolerance=-1e-3),
        "tolerance must be ≥ 0, and needs a direction of \\+1 or -1",
    ),
    "tolerance without direction": (
        leaving(guard=guard, tolerance=1e-3),
        "tolerance must be ≥ 0, and needs a direction",
    ),
    "tolerance is a word": (
        leaving(guard=guard, direction=1, tolerance="small"),
        "tolerance of transition 'a → b' must be a number, not 'small'",
    ),
    "other states need a reset": (
        lambda: system(modes=TWO, transitions=[Transition("a", "b", guard=guard)]),
        "transition 'a → b' needs a reset: mode 'a' has the states 'x', mode 'b' has 'y', 'v'",
    ),
    "other states of the zeno mode need a reset": (
        lambda: system(modes=TWO, transitions=[Transition("a", "a", guard=guard, zeno="b")]),
        "needs a reset: mode 'a' has the states 'x', mode 'b'",
    ),
    "the zeno mode has other states than the target": (
        lambda: system(
            modes=TWO, transitions=[Transition("a", "a", guard=guard, reset=flow, zeno="b")]
        ),
        "'a → a' cannot pile up: mode 'a' has the states 'x', mode 'b' has 'y', 'v': its zeno mode "
        "keeps the first of them",
    ),
    "unknown parameter as delay": (
        leaving(guard=guard, delay="Td"),
        "transition 'a → b' names the unknown parameter 'Td'; there are 'k'",
    ),
    "unknown parameter as period": (leaving(at=Every("T")), "names the unknown parameter 'T'"),
    "unknown parameter as first instant": (
        leaving(at=Every("k", "T0")),
        "names the unknown parameter 'T0'",
    ),
    "unknown parameter as instant": (leaving(at=At(1.0, "t1")), "names the unknown parameter 't1'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    make, words = REFUSED[case]
    with pytest.raises(ModelError, match=words):
        make()


def still(t, s, p):
    return (0.0,)


def resting(states):
    bounce = Transition(
        "flight",
        "flight",
        guard=lambda t, s, p: s.y,
        direction=-1,
        reset=lambda t, s, p: (0.0, -0.5 * s.v),
        zeno="rest",
    )
    modes = [Mode("flight", lambda t, s, p: (s.v, -9.81)), Mode("rest", still, states=states)]
    start = {"y": 1.0, "v": 0.0}
    return System("ball", {"y": "m", "v": "m/s"}, {}, modes, [bounce], start=start)


@pytest.mark.parametrize("backend", ["plain", "compiled"])
def test_a_mode_of_rest_may_have_the_first_states_alone(backend):
    run = simulate(resting({"y": "m"}), 3.0, backend=backend)
    assert run.ended is Ended.FINISHED and run.final == {"y": pytest.approx(0.0, abs=1e-12)}
    assert math.isnan(run["v"][-1])
    with pytest.raises(ModelError, match="keeps the first of them"):  # s.v would be y
        resting({"v": "m/s"})


def test_parameters_are_floats():
    values = system(parameters={"k": Parameter("2.5"), "m": 3}).values()
    assert values == (2.5, 3.0) and all(type(value) is float for value in values)


def test_numbers_of_a_transition_and_bounds_may_be_written_as_text():
    transition = Transition("a", "b", guard, 1, priority="3", tolerance="1e-3")
    (made,) = system(transitions=[transition]).transitions
    assert (made.priority, made.tolerance) == (3.0, 1e-3)
    assert system(parameters={"k": Parameter(1.0, low="0", high="2")}).values({"k": 2}) == (2.0,)


def test_one_transition_needs_no_list():
    assert len(system(transitions=Transition("a", "b", at=At(1.0))).transitions) == 1


def test_refused_later():
    cart = system()
    for ask, words in (
        (lambda: cart.values({"q": 1}), "'q' is not a parameter of 'cart'; there are 'k'"),
        (lambda: cart.values({"k": 9}), r"parameter 'k' = 9 is outside its range \[0, 5\] N/m"),
        (lambda: cart.values({"k": "x"}), "parameter 'k' must be a number"),
        (
            lambda: cart.unit("q"),
            "'q' is neither a state, an output nor a parameter of 'cart'; there are 'x', 'k'",
        ),
        (lambda: cart.check_start({"y": 1.0}, "a"), r"unknown state\(s\) 'y' \(mode 'a' has 'x'\)"),
        (lambda: cart.check_start({}, "a"), "no value for 'x'"),
        (
            lambda: cart.resolve(lambda p: None, cart.values(), "the delay of 'jump'"),
            "the delay of 'jump' must be a number, not None",
        ),
        (lambda: cart.resolve(NAN, cart.values(), "the period"), "the period must be finite"),
    ):
        with pytest.raises(ModelError, match=words):
            ask()


def test_every_option_is_refused_as_a_parameter():
    for name in OPTIONS:
        with pytest.raises(ModelError, match="the name of an option"):
            system(parameters={name: 1.0})


def test_what_a_system_knows():
    made = system(
        states={"x": ("m", "place"), "v": "m/s"},
        start={"x": 1, "v": 0},
        modes=TWO,
        parameters={"k": Parameter(2.0, "N/m", "stiffness", 0, 5), "m": 3},
        outputs={"F": Output(lambda t, s, p: p.k * s.x, "N")},
        transitions=[
            Transition("a", "a", guard=guard),
            Transition("a", None, guard=guard, priority=2, label="destroyed"),
            Transition(("a", "b"), "a", at=At(1), reset=lambda t, s, p: (0, 0)),
        ],
    )
    assert made.states_of("a") == ("x", "v") and made.states_of("b") == ("y", "v")
    assert [made.unit(n) for n in ("t", "x", "y", "v", "F", "k", "m")] == [
        "s",
        "m",
        "m",
        "m/s",
        "N",
        "N/m",
        "",
    ]
    assert made.meanings["x"] == "place" and made.mode == "a"
    assert made.values()._asdict() == {"k": 2.0, "m": 3} and made.values({"k": 1}).k == 1.0
    assert made.leaving == {"a": [1, 0, 2], "b": [2]}  # highest priority first, then as given
    assert [tr.name for tr in made.transitions] == ["a → a", "destroyed", "a | b → a"]
    assert (
        made.resolve("m", made.values({"m": 4}), "") == 4.0
        and made.resolve(lambda p: 2 * p.k, made.values(), "") == 4.0
    )
    assert repr(made) == "System('cart': states x, v, y; modes a, b; 3 transitions)"
    assert (
        system(mode=lambda t, s, p: "b", start={}).start == {}
    )  # the start is checked when the mode is known


# ---- Run


def parabola(jump=True):
    """x = t² to t = 2, there two events at once to x = 10 and on to x = 20 in mode b, then x' = 1
    to t = 3.
    """
    made = System(
        "parabola",
        states={"x": "m"},
        parameters={"k": 0.1},
        modes=[Mode("a", flow), Mode("b", flow, states={"y": "m", "z": ""})],
        start={"x": 0.0},
        transitions=[],
        outputs={
            "double": Output({"a": lambda t, s, p: 2 * s.x}, "m"),
            "all": Output(lambda t, s, p: p.k * t),
        },
    )
    t = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0])
    values = np.array([[0.0, NAN], [1.0, NAN], [4.0, NAN], [10.0, NAN], [20.0, 0.5], [21.0, 0.5]])
    pieces = np.array(
        [
            [0.0, 1.0, 0, -1, 0, 0, 0, 0, 1, 0],
            [1.0, 1.0, 0, -1, 1, 0, 2, 0, 1, 0],
            [2.0, 1.0, 1, -1, 20, 0.5, 1, 0, 0, 0],
        ]
    )
    events = [
        Event(2.0, "jump", "a", "a", {"x": 4.0}, {"x": 10.0}, 0),
        Event(2.0, "change", "a", "b", {"x": 10.0}, {"y": 20.0, "z": 0.5}, 1),
    ]
    return Run(
        made,
        made.values(),
        t,
        np.array([0, 0, 0, 1, 2, 2]),
        np.array([0, 0, 0, 0, 1, 1]),
        values,
        events,
        "finished",
        Work(3, 0, 18, 9, 2, 0.0, "RK45", "plain"),
        pieces,
    )


def test_run_samples():
    run = parabola()
    assert len(run) == 6 and run.start == {"x": 0.0} and run.final == {"y": 21.0, "z": 0.5}
    assert run.mode.tolist() == ["a", "a", "a", "a", "b", "b"]
    np.testing.assert_array_equal(run["x"], [0, 1, 4, 10, NAN, NAN])
    np.testing.assert_array_equal(run["z"], [NAN] * 4 + [0.5] * 2)
    np.testing.assert_array_equal(run["double"], [0, 2, 8, 20, NAN, NAN])
    np.testing.assert_allclose(run["all"], 0.1 * run.t)
    with pytest.raises(
        ModelError,
        match="'speed' is neither a state nor an output of 'parabola'; "
        "there are 'x', 'y', 'z', 'double', 'all'",
    ):
        run["speed"]
    assert "6 samples, 2 events, finished" in repr(run)
    assert run.ledger().splitlines() == [
        "    2.000000  jump: a → a  (x 4 → 10)",
        "    2.000000  change: a → b",
        "    3.000000  finished",
    ]


@given(t=st.floats(0, 3))
def test_run_between_samples(t):
    run = parabola()
    after, before = run.at(t), run.at(t, side="before")
    for found, jumped in ((after, t >= 2), (before, t > 2)):
        assert found["mode"] == ("b" if jumped else "a")
        if jumped:
            assert (
                found["y"] == pytest.approx(20 + (t - 2))
                and found["z"] == 0.5
                and math.isnan(found["x"])
                and math.isnan(found["double"])
            )
        else:
            assert (
                found["x"] == pytest.approx(t**2)
                and found["double"] == pytest.approx(2 * t**2)
                and math.isnan(found["y"])
            )


def test_run_at_many_times():
    run = parabola()
    found = run.at([0.5, 2.0, 3.0])
    assert found["mode"].tolist() == ["a", "b", "b"]
    np.testing.assert_allclose(found["y"], [NAN, 20, 21])
    assert run.at(np.array([]))["x"].shape == (0,)
    assert run.at([[0.5], [2.0]])["mode"].tolist() == [["a"], ["b"]]
    for wrong, words in (
        (3.01, "t = 3.01 lies outside the run, 0 … 3"),
        ([0, -1], "t = -1 lies outside"),
        (NAN, "t = nan lies outside"),
    ):
        with pytest.raises(ModelError, match=words):
            run.at(wrong)
    with pytest.raises(ModelError, match="side is 'before' or 'after', not 'left'"):
        run.at(1.0, side="left")


def test_runs_are_padded_lanes():
    made = system(outputs={})
    runs = lanes(
        made,
        np.array([0, 1, 2, 0, 1.0]),
        np.array([0, 0, 1, 0, 0]),
        np.array([[0.0], [1], [2], [5], [6]]),
        [3, 5],
    )
    np.testing.assert_array_equal(runs["x"], [[0, 1, 2], [5, 6, NAN]])
    np.testing.assert_array_equal(runs.t, [[0, 1, 2], [0, 1, NAN]])
    np.testing.assert_array_equal(runs.mode_index, [[0, 0, 1], [0, 0, -1]])
    np.testing.assert_array_equal(runs.final["x"], [2, 6])
    assert (
        [lane.t.tolist() for lane in runs] == [[0, 1, 2], [0, 1]]
        and len(runs) == 2
        and "2 runs" in repr(runs)
    )


# ---- export


def with_values(values, stopped="finished"):
    run = parabola()
    m = len(values)
    return Run(
        run.system,
        run.p,
        np.arange(m) / 3,
        np.arange(m),
        np.zeros(m, dtype=int),
        np.column_stack([values, np.full(m, NAN)]),
        [],
        stopped,
        run.work,
        np.empty((0, 10)),
    )


@settings(max_examples=40)
@given(st.lists(st.floats(), min_size=1, max_size=20))
def test_files_give_back_the_same_bits(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("export")
    run = with_values(np.array(values))
    np.testing.assert_array_equal(load_npz(run.to_npz(folder / "run.npz"))["x"], run["x"])
    with open(run.to_csv(folder / "run.csv"), encoding="utf-8", newline="") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    assert rows[0] == ["t [s]", "j", "mode", "x [m]", "y [m]", "z", "double [m]", "all"]
    for k, column in ((0, run.t), (3, run["x"]), (6, run["double"])):
        np.testing.assert_array_equal(np.array([float(row[k]) for row in rows[1:]]), column)
    assert [row[1:3] for row in rows[1:]] == [[str(j), "a"] for j in run.j]


def test_npz_holds_all(tmp_path):
    run = parabola()
    data = load_npz(str(run.to_npz(str(tmp_path / "é run.npz"))))
    assert set(data) == {
        "t",
        "j",
        "mode",
        "x",
        "y",
        "z",
        "double",
        "all",
        "how",
        "p.k",
        "event.t",
        "event.transition",
        "stopped",
    }
    assert data["event.transition"].tolist() == ["jump", "change"] and data["event.t"].tolist() == [
        2.0,
        2.0,
    ]
    assert (
        data["mode"].tolist() == run.mode.tolist()
        and data["p.k"] == 0.1
        and data["stopped"] == "finished"
    )
    for name in ("t", "x", "y", "z", "double", "all"):
        np.testing.assert_array_equal(data[name], run[name] if name != "t" else run.t)


def test_frame(monkeypatch):
    run = parabola()
    if importlib.util.find_spec("pandas"):
        assert list(run.to_frame().columns) == list(run.columns())
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModelError, match="a data frame needs pandas: pip install pandas"):
        run.to_frame()


def test_load_what_is_no_file_of_ours(tmp_path):
    (tmp_path / "text.npz").write_text("hello")
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "empty.npz").touch()
    np.savez_compressed(tmp_path / "whole.npz", t=np.arange(1000.0))
    whole = (tmp_path / "whole.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "torn.npz").write_bytes(whole[:60] + bytes(30) + whole[90:])
    for name in ("text.npz", "array.npy", "missing.npz", "empty.npz", "half.npz", "torn.npz"):
        with pytest.raises(
            ModelError, match=f"{name}.*cannot be read.*a file that run.to_npz wrote"
        ):
            load_npz(tmp_path / name)


@pytest.mark.parametrize("write", ["to_csv", "to_npz"])
class TestWrittenWholeOrNotAtAll:
    def test_overwrites(self, write, tmp_path):
        goal = tmp_path / "run.dat"
        goal.write_text("old")
        assert getattr(parabola(), write)(goal) == goal
        assert goal.stat().st_size > 100 and [p.name for p in tmp_path.iterdir()] == ["run.dat"]

    @pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such permissions")
    def test_others_may_read_what_the_umask_allows(self, write, tmp_path):
        (tmp_path / "plain").touch()
        (tmp_path / "old").touch()
        (tmp_path / "old").chmod(0o640)
        for name, like in (("new", "plain"), ("old", "old")):
            mode = (tmp_path / like).stat().st_mode
            assert getattr(parabola(), write)(tmp_path / name).stat().st_mode == mode

    def test_a_name_that_no_file_can_have(self, write, tmp_path):
        with pytest.raises(ModelError, match="cannot be written"):
            getattr(parabola(), write)(tmp_path / "a\0b")

    def test_interrupted(self, write, tmp_path, monkeypatch):
        def interrupt(*args):
            raise KeyboardInterrupt

        monkeypatch.setattr(run_module.os, "replace", interrupt)
        with pytest.raises(KeyboardInterrupt):
            getattr(parabola(), write)(tmp_path / "run.dat")
        assert not list(tmp_path.iterdir())

    def test_no_such_folder(self, write, tmp_path):
        goal = tmp_path / "nowhere" / "run.dat"
        with pytest.raises(
            ModelError, match="nowhere.*cannot be written.*choose a folder that exists"
        ):
            getattr(parabola(), write)(goal)
        assert not list(tmp_path.iterdir())

    def test_goal_is_a_folder(self, write, tmp_path):
        (tmp_path / "run.dat").mkdir()
        with pytest.raises(ModelError, match="cannot be written"):
            getattr(parabola(), write)(tmp_path / "run.dat")
        assert [p.name for p in tmp_path.iterdir()] == ["run.dat"] and (
            tmp_path / "run.dat"
        ).is_dir()

    @pytest.mark.parametrize("at", ["write", "rename"])
    def test_full_disk(self, write, at, tmp_path, monkeypatch):
        goal = tmp_path / "run.dat"
        goal.write_text("old")

        def fail(*args, **kwargs):
            raise OSError(28, "No space left on device")

        if at == "rename":
            monkeypatch.setattr(run_module.os, "replace", fail)
        else:
            real = run_module.tempfile.NamedTemporaryFile

            def half(*args, **kwargs):
                file = real(*args, **kwargs)
                file.write(b"half")
                monkeypatch.setattr(file, "write", fail, raising=False)
                return file

            monkeypatch.setattr(run_module.tempfile, "NamedTemporaryFile", half)
        with pytest.raises(ModelError, match=r"cannot be written \(No space left on device\)"):
            getattr(parabola(), write)(goal)
        assert goal.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["run.dat"]


def test_a_schedule_without_instants_is_refused():
    with pytest.raises(ModelError, match="names no instant"):
        At()
