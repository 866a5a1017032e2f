"""Results that code can test: why a run ended, how it was made, its ledger as arrays.

Many runs as a sequence of runs.
"""

import dataclasses
import math
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from labkit import Ended, Mode, ModelError, Output, System, Transition, simulate, simulate_many
from labkit import ledger as ledgers
from labkit.model import OPTIONS, At, Every
from labkit.run import Run, Work
from labkit.solve import layout
from labkit.solve.options import Options
from labkit.solve.pool import Pool
from labkit.solve.settings import Settings

from . import systems

BOTH = ("plain", "compiled")


def only(flow, transitions=(), start=1.0, **parameters):
    return System("one", {"x": "m"}, parameters, [Mode("m", flow)], transitions, start={"x": start})


# ---------------------------------------------------------------- why a run ended

ONCE = Transition("m", None, guard=lambda t, s, p: s.x - 2, direction=1, label="over")
ENDS = {
    Ended.FINISHED: (only(lambda t, s, p: (1.0,)), {}),
    Ended.TERMINAL: (only(lambda t, s, p: (2.0,), ONCE), {}),
    Ended.TOO_MANY_STEPS: (only(lambda t, s, p: (-s.x,)), {"max_steps": 3, "max_step": 0.1}),
    Ended.DIVERGED: (only(lambda t, s, p: (s.x * s.x,)), {"t_end": 2.0}),
    Ended.NOT_A_NUMBER: (only(lambda t, s, p: (math.sqrt(0.5 - t),)), {}),
    Ended.TOO_MANY_EVENTS: (
        only(lambda t, s, p: (1.0,), Transition("m", "m", at=Every(0.1), label="tick")),
        {"max_events": 5},
    ),
}


@pytest.mark.parametrize("backend", BOTH)
@pytest.mark.parametrize("ended", ENDS)
def test_why_a_run_ended(ended, backend):
    system, options = ENDS[ended]
    run = simulate(system, **{"t_end": 1.0, **options}, backend=backend)
    assert run.ended is ended and isinstance(run.stopped, str)
    assert (run.stopped == "finished") is (ended is Ended.FINISHED)
    many = simulate_many(system, **{"t_end": 1.0, **options}, backend=backend, rtol=1e-8)
    assert many.ended == [ended] and many.stopped == [run.stopped]


def test_ended_reads_as_its_word():
    assert Ended.FINISHED == "finished" and f"{Ended.ZENO}" == "Zeno" and len(set(Ended)) == 14


def test_notes_are_told():
    run = simulate(only(lambda t, s, p: (1.0,)), 1.0)
    assert run.notes == [] and "note" not in repr(run) + run.ledger()
    run.notes.append("the flow of mode 'm' jumps near t = 0.5: make it an event")
    assert "jumps near t = 0.5" in repr(run)
    assert run.ledger().splitlines()[-1].strip().startswith("note  the flow of mode 'm' jumps")


# ---------------------------------------------------------------- how it was made


def test_options_say_how_it_was_made():
    run = simulate(systems.ball(), 3.0, e=0.5, start={"y": 2.0}, method="RK45", rtol=1e-5)
    assert run.options == {
        "t_end": 3.0,
        "t0": 0.0,
        "start": {"y": 2.0, "v": 0.0},
        "mode": None,
        "method": "RK45",
        "rtol": 1e-5,
        "atol": None,
        "step": None,
        "max_step": None,
        "points": 500,
        "locate": True,
        "backend": "auto",
        "max_events": 100_000,
        "max_steps": 1_000_000,
    }
    with pytest.raises(TypeError):
        run.options["rtol"] = 1.0
    assert set(run.options) <= OPTIONS
    assert vars(run).keys() == {each.name for each in dataclasses.fields(Run)}
    assert "given" not in run.options and "dense" not in run.options


def test_again_is_the_same_run_with_changes():
    run = simulate(systems.ball(), 3.0, e=0.5, start={"y": 2.0, "v": 1.0}, method="RK45", points=9)
    same, other = run.again(), run.again(start={"y": 3.0}, rtol=1e-4, e=0.7)
    assert same.final == run.final and np.array_equal(same["y"], run["y"])
    assert other.start == {"y": 3.0, "v": 1.0} and other.p.e == 0.7 and other.p.g == run.p.g
    assert other.options["method"] == "RK45" and other.options["rtol"] == 1e-4 and len(other.t) > 8
    straight = simulate(
        systems.ball(), 3.0, e=0.7, start={"y": 3.0, "v": 1.0}, method="RK45", points=9, rtol=1e-4
    )
    assert np.array_equal(other.t, straight.t) and np.array_equal(other["v"], straight["v"])
    for wrong, words in (
        ({"E": 0.7}, "'E'; there are 'g', 'e', 't_end'"),
        ({"e": 2.0}, "range"),
        ({"start": (1, 2)}, "start of simulate must be"),
    ):
        with pytest.raises(ModelError, match=words):
            run.again(**wrong)


def test_sample_times_are_kept_as_they_were():
    times = np.array([0.0, 0.5, 1.0])
    run = simulate(only(lambda t, s, p: (1.0,)), 1.0, points=times)
    times[1] = 0.7
    assert run.options["points"].tolist() == [0.0, 0.5, 1.0] and run.again().t.tolist() == [
        0.0,
        0.5,
        1.0,
    ]


def test_a_run_made_by_hand_cannot_be_made_again():
    with pytest.raises(ModelError, match="not made by simulate"):
        by_hand().again()


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("points", "many", "points must be a number of samples, or times .* not 'many'"),
        ("points", None, "not None"),
        ("points", math.inf, "not inf"),
        ("points", np.ones((2, 3)), r"not an array of shape \(2, 3\)"),
        ("points", [0.5, math.nan], "points must be"),
        ("points", [[0.1], [0.2, 0.3]], "points must be"),
        ("points", [0.5, 0.4], r"rising order between t0 = 0 and t_end = 1, not \[0.5 0.4\]"),
        ("points", [], "points must be"),
        ("start", (1.0, 0.0), r"start of simulate.* must be a dict .* not \(1.0, 0.0\)"),
        ("start", [1.0], "must be a dict"),
        ("max_events", math.inf, "max_events must be a whole number of at least 1, not inf"),
        ("max_steps", "all", "max_steps must be a whole number of at least 1, not 'all'"),
        ("atol", "fine", "atol must be a number, not 'fine'"),
        ("atol", {"q": 1e-9}, "atol names the unknown state.* 'q'; there are 'x'"),
        ("atol", {"x": -1.0}, "atol of 'x' must not be negative"),
        ("step", 0, "step = 0 must be positive"),
        ("max_step", "x", "max_step must be a number"),
        ("t_end", "ten", "t_end must be a number, not 'ten'"),
    ],
)
@pytest.mark.parametrize("call", [simulate, simulate_many])
def test_nonsense_is_named(option, value, words, call):
    with pytest.raises(ModelError, match=words):
        call(only(lambda t, s, p: (1.0,)), **{"t_end": 1.0, option: value})


@pytest.mark.parametrize("call", [simulate, simulate_many])
@pytest.mark.parametrize("what", ["fall", None, [1.0]])
def test_what_is_simulated_is_a_system(what, call):
    with pytest.raises(ModelError, match="must be a System, not"):
        call(what, 1.0)


def settings(system, **changed):
    given = {
        "t_end": 1.0,
        "t0": 0.0,
        "method": "RK45",
        "rtol": 1e-6,
        "atol": None,
        "step": None,
        "max_step": None,
        "points": 2,
        "locate": True,
        "backend": "auto",
        "max_events": 9,
        "max_steps": 9,
        "dense": True,
    }
    return Settings(Options(system, **(given | changed)))


def test_tolerances_for_the_core():
    system = System(
        "two",
        {"x": "", "v": ""},
        {},
        [Mode("m", lambda t, s, p: (s.v, 0.0)), Mode("own", lambda t, s, p: (1.0,), {"v": ""})],
        start={"x": 0, "v": 0},
    )
    assert settings(system).absolute.tolist() == [[-1, -1], [-1, -1]]
    assert settings(system, atol=1e-9).absolute.tolist() == [[1e-9, 1e-9], [1e-9, -1]]
    assert settings(system, atol={"v": 1e-3}).absolute.tolist() == [[-1, 1e-3], [1e-3, -1]]
    assert settings(system, atol={"v": 0}).absolute.tolist() == [[-1, 0], [0, -1]]


def test_nothing_goes_round_in_a_circle():
    """Settings know no memory: what is shared by threads is not changed by them."""
    st = settings(systems.ball())
    kept = {name: value.copy() for name, value in st.fixed.items()}
    pool = Pool(st)
    assert not hasattr(st, "free") and pool.take(None, 1) is not pool.take(None, 1)
    assert all(np.array_equal(kept[name], st.fixed[name]) for name in kept)


# ---------------------------------------------------------------- the ledger as arrays


@pytest.mark.parametrize("backend", BOTH)
def test_ledger_by_name(backend):
    run = simulate(systems.ball(), 6.0, e=0.5, backend=backend)
    bounce = run.events["bounce"]
    assert len(bounce) == len([x for x in run.events if x.transition == "bounce"]) > 3
    np.testing.assert_array_equal(bounce.t, [x.t for x in run.events if x.transition == "bounce"])
    np.testing.assert_array_equal(
        bounce.after["v"], [x.after["v"] for x in run.events if x.transition == "bounce"]
    )
    np.testing.assert_allclose(bounce.after["v"][:3], -0.5 * bounce.before["v"][:3])
    assert bounce.source[0] == bounce.target[0] == "flight"
    with pytest.raises(
        ModelError, match="no transition of .* is called 'rebound'; there are 'bounce'"
    ):
        run.events["rebound"]
    assert (
        run.events[0] == list(run.events)[0] and run.events[-1] is run.events[len(run.events) - 1]
    )
    assert [x.t for x in run.events[1:3]] == bounce.t[1:3].tolist()


def test_a_transition_that_never_fired_is_empty():
    run = simulate(systems.ball(), 0.1)
    bounce = run.events["bounce"]
    assert len(bounce) == 0 and bounce.t.shape == bounce.after[
        "v"
    ].shape == bounce.source.shape == (0,)


def test_ledger_of_modes_with_other_states():
    swing = Mode("swing", lambda t, s, p: (1.0,), {"phi": ""})
    system = System(
        "torn",
        {"x": "m", "v": "m/s"},
        {},
        [Mode("fly", lambda t, s, p: (s.v, 0.0)), swing],
        [
            Transition(
                "fly",
                "swing",
                guard=lambda t, s, p: s.x - 1,
                direction=1,
                reset=lambda t, s, p: (0.25,),
                label="caught",
            ),
            Transition(
                "swing",
                "fly",
                guard=lambda t, s, p: s.phi - 1,
                direction=1,
                reset=lambda t, s, p: (0.0, 2.0),
                label="let go",
            ),
            Transition("fly", None, at=At(9.0), label="end"),
        ],
        start={"x": 0.0, "v": 1.0},
    )
    run = simulate(system, 4.0)
    caught, free = run.events["caught"], run.events["let go"]
    np.testing.assert_allclose(caught.before["x"], 1.0)
    np.testing.assert_allclose(caught.after["phi"], 0.25)
    assert np.isnan(caught.after["x"]).all() and np.isnan(caught.before["phi"]).all()
    np.testing.assert_allclose(free.after["v"], 2.0)
    assert set(caught.source) == {"fly"} and set(caught.target) == {"swing"}
    ends = simulate(system, 10.0, start={"v": 1e-3}).events["end"]
    assert ends.target.tolist() == [None] and ends.after["v"].tolist() == [1e-3]


def test_the_ledger_stays_cheap():
    """Nothing is made of its rows before somebody looks."""
    run = simulate(systems.ball(), 6.0)
    assert len(run.events) > 2 and not vars(run.events).get("_events")
    run.events["bounce"]
    assert "_events" not in vars(run.events)
    assert (ledgers.END, ledgers.SLIDING) == (-1, layout.SLIDE)


# ---------------------------------------------------------------- sliding


def by_hand():
    """Friction 1 or −1 in two modes of x' = F.

    From the second sample on both at once, a quarter of the second.
    """
    push, pull = Mode("push", lambda t, s, p: (1.0,)), Mode("pull", lambda t, s, p: (-1.0,))
    law = {"push": lambda t, s, p: p.F + s.x, "pull": lambda t, s, p: -p.F}
    system = System(
        "belt",
        {"x": "m"},
        {"F": 2.0},
        [push, pull],
        start={"x": 0.0},
        outputs={"F_": Output(law), "half": Output({"push": lambda t, s, p: 1.0})},
    )
    return Run(
        system,
        system.values(),
        np.array([0.0, 1.0, 2.0]),
        np.array([0, 1, 1]),
        np.array([0, 0, 1]),
        np.array([[0.0], [1.0], [1.5]]),
        [],
        "finished",
        Work(0, 0, 0, 0, 0, 0.0, "", ""),
        np.array([[0.0, 1.0, 0, -1, 0.0, 1.0], [1.0, 1.0, 0, 1, 1.0, 0.5]]),
        other=np.array([-1, 1, 0]),
        part=np.array([0.0, 0.25, 0.25]),
    )


def test_outputs_while_sliding_are_the_mixture():
    run = by_hand()
    np.testing.assert_allclose(run["F_"], [2.0, 0.75 * 3.0 - 0.25 * 2.0, -0.75 * 2.0 + 0.25 * 3.5])
    np.testing.assert_array_equal(run["x"], [0.0, 1.0, 1.5])
    assert run["half"][0] == 1.0 and np.isnan(run["half"][1:]).all()  # the other mode has none
    # between samples the mixture follows from the slope of the piece: x' = 0.5 = 0.75·1 − 0.25·1
    assert run.at(1.5)["F_"] == pytest.approx(0.75 * 3.25 - 0.25 * 2.0)
    assert run.at(0.5)["F_"] == 2.5 and run.at(1.5)["x"] == 1.25


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda t, s, p: 1 / s.x, "output 'E' fails at t = 0, x = 0: .*zero.* return math.nan"),
        (lambda t, s, p: math.log(s.x), "output 'E' fails at t = 0, x = 0: .*log|math domain"),
        (lambda t, s, p: s.q, "output 'E' asks for an unknown name: .*'q'"),
        (lambda t, s, p: None, r"output 'E' at t = 0, x = 0 returns None: it must be a number"),
        (lambda t, s, p: (s.x, t), r"output 'E' at t = 0, x = 0 returns \(0.0, 0.0\): it must be"),
        (lambda t, s, p: "high", "output 'E' at t = 0, x = 0 returns 'high': it must be a number"),
        (lambda t, s, p: (-1 - s.x) ** 0.5, "output 'E' is a complex number at t = 0, x = 0"),
    ],
)
def test_an_output_without_a_number_is_said(function, words):
    system = only(lambda t, s, p: (1.0,), start=0.0).variant("o", outputs={"E": Output(function)})
    run = simulate(system, 1.0, points=3)
    for ask in (lambda: run["E"], lambda: run.at(0.0), run.columns):
        with pytest.raises(ModelError, match=words):
            ask()


def test_outputs_of_other_kinds_are_numbers():
    made = {
        "above": Output(lambda t, s, p: s.x > 0.75),
        "whole": Output(lambda t, s, p: 2),
        "gap": Output(lambda t, s, p: np.array([s.x]) if s.x > 0.25 else math.nan),
    }
    run = simulate(
        only(lambda t, s, p: (1.0,), start=0.0).variant("o", outputs=made), 1.0, points=3
    )
    assert run["above"].tolist() == [0, 0, 1] and run["whole"].tolist() == [2, 2, 2]
    np.testing.assert_allclose(run["gap"], [np.nan, 0.5, 1.0])


def test_a_name_that_is_not_there_is_said():
    run = simulate(systems.ball(), 2.0, points=3)
    hits = run.events["bounce"]
    for found in (run.start, run.final, run.at(0.5), run.events[0].before, hits.before, hits.after):
        with pytest.raises(ModelError, match="no value is called 'z'; there are 'y', 'v'"):
            found["z"]
        assert found.get("z") is None and "z" not in found


# ---------------------------------------------------------------- many runs


def fates():
    """Lanes that bounce, end, diverge, have a negative dead time or start beyond a guard."""
    return System(
        "fates",
        {"y": "m", "v": "m/s"},
        {"g": 10.0, "x": 0.0, "Td": 0.1},
        [
            Mode("fall", lambda t, s, p: (s.v, p.x * s.y * s.y - p.g)),
            Mode("cut", lambda t, s, p: (0.0, 0.0)),
        ],
        [
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
            Transition(
                "fall",
                "cut",
                guard=lambda t, s, p: t - 1.2,
                direction=1,
                delay=lambda p: math.sqrt(p.Td),
                label="cut",
            ),
        ],
        start={"y": 1.0, "v": 0.0},
        outputs={"E": Output(lambda t, s, p: p.g * s.y + s.v**2 / 2)},
    )


OPTION = {"points": 7, "rtol": 1e-8, "atol": 1e-10}
START = {"y": np.tile([0.2, 1.0, -1.0, 5.0], 5), "v": np.linspace(-1, 5, 20)}
X = np.where(np.arange(20) % 5 == 0, 2.0, 0.0)
TD = np.where(np.arange(20) == 7, -1.0, 0.1)


@pytest.mark.parametrize("backend", BOTH)
def test_a_lane_is_the_run_alone(backend):
    system = fates()
    runs = simulate_many(system, 1.5, start=START, x=X, Td=TD, **OPTION, backend=backend, workers=3)
    refused = [2, 6, 7, 10, 14, 18]
    assert [k for k, run in enumerate(runs) if run.ended is Ended.REFUSED] == refused
    assert set(runs.ended) == {Ended.FINISHED, Ended.TERMINAL, Ended.DIVERGED, Ended.REFUSED}
    for lane, run in enumerate(runs):
        assert run.options["start"]["y"] == START["y"][lane] and run.p.x == X[lane]
        how = dict(start={k: v[lane] for k, v in START.items()}, x=X[lane], Td=TD[lane], **OPTION)
        if lane in refused:
            with pytest.raises(ModelError) as error:
                simulate(system, 1.5, **how, backend=backend)
            assert run.stopped == runs.stopped[lane] == str(error.value)
            assert run.start == run.final == {"y": START["y"][lane], "v": START["v"][lane]}
            assert len(run) == 1 and run.at(0.0)["v"] == run.final["v"] and not run.events
            continue
        alone = simulate(system, 1.5, **how, max_events=10_000, backend=backend)
        for name in ("t", "j", "mode_index"):
            assert np.array_equal(getattr(run, name), getattr(alone, name))
        for name in ("y", "v", "E"):
            assert np.array_equal(run[name], alone[name], equal_nan=True)
            assert np.array_equal(runs[name][lane][: len(run)], run[name], equal_nan=True)
        assert (run.ended, run.stopped, run.final) == (alone.ended, alone.stopped, alone.final)
        assert run.events == alone.events and runs.events[lane] == len(alone.events)
        assert run.touches == alone.touches and run.notes == alone.notes
        assert run.work.steps == alone.work.steps and run.work.evaluations == alone.work.evaluations
        middle = alone.t[-1] / 3
        assert run.at(middle) == alone.at(middle) and dict(run.options) == dict(alone.options)
        assert (
            np.isnan(runs.t[lane][len(run) :]).all()
            and (runs.mode_index[lane][len(run) :] == -1).all()
        )
        assert runs.final["v"][lane] == alone.final["v"]


def test_runs_are_a_sequence():
    runs = simulate_many(systems.ball(), 2.0, start={"y": np.linspace(1, 3, 4)}, points=5)
    assert len(runs) == 4 and runs[-1].start == {"y": 3.0, "v": 0.0} and len(runs[1:3]) == 2
    assert [run.start["y"] for run in reversed(runs)] == runs["y"][::-1, 0].tolist()
    assert runs.t.shape == runs["y"].shape == runs.mode_index.shape == runs.values.shape[:2]
    assert runs[np.int64(2)].p == runs.p[2] and runs[0].again(e=0.1).p.e == 0.1
    for wrong in (4, -5):
        with pytest.raises(IndexError):
            runs[wrong]
    with pytest.raises(ModelError, match="neither a state nor an output"):
        runs["z"]


@pytest.mark.parametrize("backend", BOTH)
def test_all_refused_is_an_error(backend):
    with pytest.raises(ModelError, match="does not fit mode 'flight'"):
        simulate_many(
            systems.ball(), 1.0, start={"y": np.array([-1.0, -2.0, -3.0])}, backend=backend
        )
    with pytest.raises(ModelError, match="the delay of 'cut'"):
        simulate_many(fates(), 1.0, Td=np.array([-1.0, -2.0]), backend=backend)
    with pytest.raises(ModelError, match="returns 3 values"):
        simulate_many(
            only(lambda t, s, p: (1.0, 2.0, 3.0)), 1.0, start={"x": np.ones(3)}, backend=backend
        )


def test_the_first_lane_may_be_refused():
    """The model's functions are tried where a lane can start, not where the first one cannot."""
    runs = simulate_many(
        only(lambda t, s, p: (math.sqrt(s.x),)),
        1.0,
        start={"x": np.array([-1.0, -2.0, 1.0])},
        backend="plain",
    )
    assert [run.ended for run in runs] == [Ended.REFUSED] * 2 + [Ended.FINISHED]
    assert "fails at the start" in runs.stopped[0]


def test_a_chosen_mode_that_fails_is_one_lanes_reason():
    modes = [Mode("a", lambda t, s, p: (1.0,)), Mode("b", lambda t, s, p: (-1.0,))]
    system = System(
        "choice",
        {"x": ""},
        {"k": 1.0},
        modes,
        start={"x": 1.0},
        mode=lambda t, s, p: "a" if 1 / p.k > 0 else "c",
    )
    runs = simulate_many(system, 1.0, k=np.array([1.0, 0.0, -1.0, 2.0]), backend="plain")
    assert [run.ended is Ended.REFUSED for run in runs] == [False, True, True, False]
    assert "ZeroDivisionError" in runs.stopped[1] and "'c' is not a mode" in runs.stopped[2]
    np.testing.assert_allclose(runs.final["x"], [2.0, 1.0, 1.0, 2.0])


PEAK = """
    import sys, numpy as np
    try:
        import resource
    except ImportError:  # Windows
        sys.exit(77)
    from labkit import At, Every, Mode, System, Transition, simulate_many
    lanes, events, points, backend = *map(int, sys.argv[1:4]), sys.argv[4]
    flow = Mode("m", lambda t, s, p: (s.v, -s.x))
    tick = Transition("m", "m", at=Every("T"), label="tick")
    system = System("clock", {"x": "", "v": ""}, {"T": 100.0}, [flow], [tick], {"x": 1.0, "v": 0.0})
    T = np.full(lanes, 100.0)
    T[lanes // 2] = 9.9999 / events
    runs = simulate_many(system, 10.0, T=T, points=points, backend=backend)
    assert runs.events.max() == len(runs[lanes // 2].events["tick"]) == events
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(peak / (2**20 if sys.platform == "darwin" else 2**10))
"""


def python(text, *arguments, **options):
    command = [sys.executable, "-c", textwrap.dedent(text), *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options
    )


@pytest.mark.parametrize(
    ("backend", "lanes", "points"), [("compiled", 2000, 100), ("plain", 300, 10)]
)
def test_memory_follows_the_samples(backend, lanes, points):
    """One lane with 4,000 events costs its own 8,000 samples, not those of every lane.

    Padded it would be 500 MiB.
    """
    peaks = []
    for events in (1, 4000):
        made = python(PEAK, lanes, events, points, backend)
        said = made.communicate(timeout=300)[0]
        if made.returncode == 77:
            pytest.skip("this system does not tell the peak of memory")
        assert made.returncode == 0, said
        peaks.append(float(said.split()[-1]))
    assert peaks[1] - peaks[0] < 40, peaks


ENDLESS = """
    import _thread, sys, threading, time
    import numpy as np
    from labkit import Mode, System, simulate, simulate_many
    flow = Mode("m", lambda t, s, p: (s.v, -p.w * s.x))
    system = System("spin", {"x": "", "v": ""}, {"w": 1.0}, [flow], start={"x": 1.0, "v": 0.0})
    w, few = np.linspace(900.0, 1000.0, 400), {"points": 2, "rtol": 1e-10, "max_steps": 10**8}
    def short():
        runs = simulate_many(system, 1.0, w=w, backend="compiled", workers=4, **few)
        return runs.final["x"]
    def send():
        time.sleep(2.0)
        sent.append(time.perf_counter())
        SEND()
    right, sent = short(), []
    threading.Thread(target=send, daemon=True).start()
    try:
        START()
        print("it ended by itself")
    except KeyboardInterrupt:
        print("heard after", time.perf_counter() - sent[0])
    time.sleep(0.1)
    assert threading.active_count() == 1, threading.enumerate()
    assert np.array_equal(short(), right)
    print("and goes on")
"""
LONG = {
    "threads": 'simulate_many(system, 1e4, w=w, backend="compiled", workers=4, **few)',
    "alone": 'simulate(system, 1e5, w=1e3, backend="compiled", **few)',
    "plain": 'simulate_many(system, 1e4, w=w, backend="plain", **few)',
}


@pytest.mark.parametrize("kind", LONG)
@pytest.mark.parametrize("send", ["signal", "interrupt_main"])
def test_an_interrupt_is_heard(kind, send):
    """Minutes of work end a second after the interrupt (a wide limit: the machine may be busy).

    The engine goes on.
    """
    sending = (
        f"signal.raise_signal({int(signal.SIGINT)})"
        if send == "signal"
        else "_thread.interrupt_main()"
    )
    text = (
        ENDLESS.replace("SEND()", sending)
        .replace("START()", LONG[kind])
        .replace("import _thread,", "import _thread, signal,")
    )
    made = python(text)
    try:
        said = made.communicate(timeout=120)[0]
    finally:
        made.kill()
    assert (
        made.returncode == 0
        and said.split()[:2] == ["heard", "after"]
        and said.endswith("goes on\n")
    ), said
    assert float(said.split()[2]) < 10
