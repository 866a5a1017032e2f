"""Sweeps: every lane of the grid is the run that simulate makes, and what fails says why."""

import csv
import multiprocessing
import os
import pickle
import sys
from _thread import interrupt_main
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from threading import Timer
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest

from labkit import (
    Ended,
    Mode,
    ModelError,
    Parameter,
    System,
    Transition,
    figure,
    progress,
    simulate,
    sweep,
)
from labkit import portions as portions_module
from labkit.progress import Progress

from .helpers import run_cell


def flow(t, s, p):
    return s.v, -2 * p.delta * s.v - p.omega**2 * s.x


def below(t, s, p):
    return s.x + 0.5


def begins(t, s, p):
    return "swings"


oscillator = System(
    "oscillator",
    {"x": "m", "v": "m/s"},
    {
        "delta": Parameter(0.1, "1/s", "damping", 0, 5, symbol=r"\delta"),
        "omega": Parameter(1.0, "1/s", "frequency", 0.1, 10),
    },
    [Mode("swings", flow)],
    [Transition("swings", None, below, -1, label="too low")],
    start={"x": 1.0, "v": 0.0},
    mode=begins,
)
deltas, omegas = np.linspace(0.05, 0.5, 5), np.geomspace(0.8, 3, 4)


def first_zero(run):
    """When x is zero for the first time, by a straight line between samples."""
    k = np.flatnonzero(run["x"] < 0)[0]
    t, x = run.t[k - 1 : k + 1], run["x"][k - 1 : k + 1]
    return t[0] - x[0] * (t[1] - t[0]) / (x[1] - x[0])


def ending(run):
    return "low" if run.ended is Ended.TERMINAL else "stays"


def exact_zero(delta, omega):
    """x = e^(−δt)(cos wt + δ/w sin wt) = 0 at tan wt = −w/δ."""
    w = np.sqrt(omega**2 - delta**2)
    return (np.pi - np.arctan(w / delta)) / w


def test_against_the_closed_form():
    m = sweep(oscillator, 8.0, first_zero, delta=deltas, omega=omegas, points=4001, rtol=1e-9)
    assert m.shape == (5, 4) and list(m.axes) == ["delta", "omega"] and not m.reasons
    np.testing.assert_allclose(m.values, exact_zero(deltas[:, None], omegas), rtol=2e-5)


def test_each_lane_is_the_run_of_simulate():
    m = sweep(oscillator, 5.0, lambda run: run["x"][-1], delta=deltas, x=[0.2, 0.7], v=-0.1)
    for i, delta in enumerate(deltas):
        for j, x in enumerate([0.2, 0.7]):
            one = simulate(
                oscillator, 5.0, delta=delta, start={"x": x, "v": -0.1}, rtol=1e-6, points=300
            )
            assert m.values[i, j] == one["x"][-1]


def test_words_and_several_results():
    def both(run):
        return {"how": ending(run), "last": run.t[-1], "low": run.ended is Ended.TERMINAL}

    m = sweep(oscillator, 6.0, both, delta=deltas, omega=[1.0, 2.0])
    assert m.values is m["how"] and set(m["how"].ravel()) == {"low", "stays"}
    np.testing.assert_array_equal(m["how"] == "low", m["last"] < 6)
    assert m["low"].dtype == bool and m["low"][0, 0] and not m["low"][-1, 0]
    # the first swing goes down to −exp(−δπ/w)
    w = np.sqrt(1 - deltas**2)
    np.testing.assert_array_equal(m["low"][:, 0], np.exp(-deltas * np.pi / w) > 0.5)
    with pytest.raises(ModelError, match="has no result 'high'; there are 'how', 'last', 'low'"):
        m["high"]


def test_a_refused_start_is_a_reason_and_nan():
    # a start that is below the limit already does not fit
    starts = np.array([1.0, -0.2, -0.7, -2.0])
    m = sweep(oscillator, 1.0, ending, x=starts)
    assert (
        m.values.tolist() == ["low" if v == "low" else "stays" for v in m.values[:2]] + [None] * 2
    )
    assert set(m.reasons) == {(2,), (3,)} and m.failed.tolist() == [False, False, True, True]
    assert "too low" in m.reasons[2,] and "2 without a result" in repr(m)
    numbers = sweep(oscillator, 1.0, lambda run: run.t[-1], x=starts).values
    np.testing.assert_array_equal(np.isnan(numbers), m.failed)


def test_many_refused_starts_each_have_their_reason(monkeypatch):
    monkeypatch.setattr(portions_module, "FIRST", 4)
    m = sweep(oscillator, 0.1, lambda run: run.t[-1], x=np.linspace(-2, 1, 31))
    lost = np.linspace(-2, 1, 31) < -0.5
    np.testing.assert_array_equal(m.failed, lost)
    assert all("too low" in why for why in m.reasons.values())


def test_a_measure_that_raises_and_an_end_that_is_not_accepted():
    def odd(run):
        if run.p.delta > 0.3:
            raise ValueError("too much")
        return 1

    m = sweep(oscillator, 1.0, odd, delta=deltas)
    assert m.reasons == {
        (3,): "measure: ValueError: too much",
        (4,): "measure: ValueError: too much",
    }
    m = (
        sweep(oscillator, 1.0, lambda run: [1], delta=deltas[:1], omega=[1.0], accept=Ended)
        if 0
        else m
    )
    short = {"max_steps": 3, "method": "RK4", "step": 0.01}
    with pytest.raises(
        ModelError, match="no run of the sweep gave a result. The first: too many st"
    ):
        sweep(oscillator, 5.0, ending, delta=deltas, **short)
    m = sweep(oscillator, 5.0, lambda run: str(run.ended), delta=deltas, accept=Ended, **short)
    assert set(m.values) == {"too many steps"}
    with pytest.raises(
        ModelError, match="measure must return a number, a text, True or False, not"
    ):
        sweep(oscillator, 5.0, lambda run: [1, 2], delta=deltas)


def test_options_as_axes():
    tolerances = [1e-4, 1e-8]
    m = sweep(
        oscillator,
        9.0,
        lambda run: run.work.steps,
        method=["RK45", "DOP853"],
        rtol=tolerances,
        delta=deltas,
    )
    assert m.shape == (2, 2, 5) and m.axes["method"].tolist() == ["RK45", "DOP853"]
    for i, method in enumerate(["RK45", "DOP853"]):
        for j, rtol in enumerate(tolerances):
            one = simulate(oscillator, 9.0, method=method, rtol=rtol, delta=deltas[2], points=300)
            assert m.values[i, j, 2] == one.work.steps
    alone = sweep(oscillator, 9.0, lambda run: run.work.steps, rtol=tolerances, delta=0.1)
    ones = [simulate(oscillator, 9.0, rtol=rtol, delta=0.1, points=300) for rtol in tolerances]
    assert alone.values.tolist() == [one.work.steps for one in ones]


def test_starts_that_depend_on_the_parameters():
    m = sweep(
        oscillator,
        1.0,
        lambda run: run["v"][0],
        delta=deltas,
        start={"v": lambda p: p.delta * p.omega},
    )
    np.testing.assert_array_equal(m.values, deltas)
    m = sweep(
        oscillator, 1.0, lambda run: run["v"][0], start={"v": [0.1, 0.2]}, omega=[1.0, 2.0, 3.0]
    )
    assert list(m.axes) == ["omega", "v"] and m.values.tolist() == [[0.1, 0.2]] * 3

    def wild(p):
        return 1 / float(p.delta - deltas[1])

    m = sweep(oscillator, 1.0, lambda run: run["v"][0], delta=deltas, start={"v": wild})
    assert m.reasons == {(1,): "start of 'v': ZeroDivisionError: float division by zero"}


@pytest.mark.parametrize("kind", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_an_executor_gives_the_same(kind):
    here = sweep(oscillator, 8.0, first_zero, delta=deltas, omega=omegas, points=2001)
    with kind(2) as executor:
        there = sweep(
            oscillator, 8.0, first_zero, delta=deltas, omega=omegas, points=2001, executor=executor
        )
    np.testing.assert_array_equal(here.values, there.values)


def dies(run):
    """A measure that ends the process it runs in, unless that is the parent's."""
    if os.getpid() != PARENT:
        os._exit(1)
    return run.final["x"]


def dies_once(run):
    """Of three workers the first that comes here ends."""
    try:
        os.close(os.open(os.environ["LABKIT_TEST_MARK"], os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return run.final["x"]
    os._exit(1)


PARENT = os.getpid()


@pytest.mark.skipif(sys.platform == "win32", reason="workers do not know the parent's number")
@pytest.mark.parametrize("measure", [dies, dies_once])
def test_a_lost_worker_loses_no_result(measure, tmp_path, monkeypatch):
    monkeypatch.setenv("LABKIT_TEST_MARK", str(tmp_path / "mark"))
    fork = multiprocessing.get_context("fork")
    with (
        ProcessPoolExecutor(2, mp_context=fork) as executor,
        pytest.warns(UserWarning, match="has lost a worker .*made in this process"),
    ):
        there = sweep(oscillator, 3.0, measure, delta=deltas, omega=omegas, executor=executor)
    here = sweep(oscillator, 3.0, lambda run: run.final["x"], delta=deltas, omega=omegas)
    np.testing.assert_array_equal(here.values, there.values)


@pytest.fixture(scope="module")
def cluster():
    """Two workers of Dask in processes of their own."""
    if os.environ.get("LABKIT_EXTRAS") != "1":  # .ci/run installs it, and then it must be there
        pytest.importorskip("distributed")
    from distributed import Client, LocalCluster

    with (
        LocalCluster(2, threads_per_worker=1, dashboard_address=None, processes=True) as made,
        Client(made) as client,
    ):
        yield client


def test_dask_gives_the_same_numbers_for_a_model_with_lambdas(cluster):
    lambdas = oscillator.variant(
        "lambdas", modes={"swings": lambda t, s, p: (s.v, -2 * p.delta * s.v - p.omega**2 * s.x)}
    )
    options = {"delta": deltas, "omega": omegas, "points": 2001}
    here = sweep(lambdas, 8.0, lambda run: run.final["x"], **options)
    there = sweep(
        lambdas, 8.0, lambda run: run.final["x"], executor=cluster.get_executor(), **options
    )
    np.testing.assert_array_equal(here.values, there.values)


def test_a_model_of_a_notebook_is_compiled_where_it_arrives(cluster):
    """Its cells are in no file there: their text travels with the functions."""
    cell = """
from labkit import Mode, Parameter, System
from math import sin

def push(t, p):
    return p.h * sin(t)

made = System("pushed", {"x": "m"}, {"h": Parameter(1.0, "", "", 0, 2)},
              [Mode("moves", lambda t, s, p: (push(t, p) - s.x,))], start={"x": 0.0})
"""
    names = run_cell(cell, "/nowhere/cell_7f3a.py", {"__name__": "__main__"})
    for _ in range(600):  # once its code is on the disk, every process waits to read it
        here = simulate(names["made"], 2.0).work.backend
        if here != "plain":
            break
        sleep(0.2)

    def backend(run):
        return run.work.backend

    m = sweep(names["made"], 2.0, backend, h=[0.5, 1.0], executor=cluster.get_executor())
    assert m.values.tolist() == [here] * 2


@pytest.mark.skipif(sys.platform == "win32", reason="a worker is killed by a signal")
def test_a_worker_of_dask_that_is_killed_loses_no_result(cluster, tmp_path, monkeypatch):
    mark = str(tmp_path / "mark")

    def once(run):
        try:
            os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return run.final["x"]
        os._exit(1)

    options = {"delta": deltas, "omega": omegas, "progress": False}
    there = sweep(oscillator, 3.0, once, executor=cluster.get_executor(), **options)
    here = sweep(oscillator, 3.0, lambda run: run.final["x"], **options)
    np.testing.assert_array_equal(here.values, there.values)


def test_a_model_that_cannot_travel_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    lambdas = oscillator.variant("lambdas", modes={"swings": lambda t, s, p: (s.v, -s.x)})
    with (
        ProcessPoolExecutor(1) as executor,
        pytest.raises(ModelError, match="cannot be sent to other processes.*with def in a module"),
    ):
        sweep(lambdas, 1.0, ending, delta=deltas, executor=executor)


def test_a_system_travels():
    copy = pickle.loads(pickle.dumps(oscillator))
    assert copy.name == "oscillator" and copy.parameters == oscillator.parameters
    assert copy.start == oscillator.start and copy.transitions == oscillator.transitions


@pytest.mark.parametrize("where", ["here", "threads"])
def test_an_interrupt_keeps_what_there_is(monkeypatch, where):
    monkeypatch.setattr(portions_module, "FIRST", 2)
    monkeypatch.setattr(portions_module, "SECONDS", 0.0)  # one lane at a time
    count = 0

    def add(self, lanes):
        nonlocal count
        count += lanes
        if count >= 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "add", add)
    pool = ThreadPoolExecutor(1) if where == "threads" else None
    m = sweep(oscillator, 1.0, lambda run: 1.0, delta=np.linspace(0, 1, 20), executor=pool)
    done = int(np.nansum(m.values))
    assert 3 <= done < 20 and len(m.reasons) == 20 - done
    assert set(m.reasons.values()) == {"not computed: interrupted"}


def test_an_interrupt_from_the_keyboard_is_heard(monkeypatch):
    monkeypatch.setattr(portions_module, "FIRST", 5)

    def slow(run):
        sleep(0.01)
        return 1.0

    Timer(0.3, interrupt_main).start()
    m = sweep(oscillator, 0.1, slow, delta=np.linspace(0, 1, 2000), rtol=[1e-4])
    assert 0 < np.nansum(m.values) < 1000


def test_portions_keep_the_memory_bounded(monkeypatch):
    monkeypatch.setattr(portions_module, "FIRST", 5)
    monkeypatch.setattr(portions_module, "SAMPLES", 1000)
    sizes = []
    original = portions_module.Task.run

    def spied(self, lanes, columns, options):
        sizes.append(lanes)
        return original(self, lanes, columns, options)

    monkeypatch.setattr(portions_module.Task, "run", spied)
    sweep(oscillator, 1.0, ending, delta=np.linspace(0, 1, 40), points=98)
    assert sum(sizes) == 40 and max(sizes[1:]) <= 10


SWINGING = System(
    "clash", {"rtol": "m"}, {"k": 1.0}, [Mode("m", lambda t, s, p: (0.0,))], start={"rtol": 1.0}
)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (
            {"rho": deltas},
            "'rho' is neither a parameter nor a state of 'oscillator', nor an option",
        ),
        ({"delta": 0.1}, "a sweep has one to three axes, here 0"),
        ({"delta": [1, 2], "omega": [1, 2], "x": [1], "v": [1]}, "one to three axes, here 4"),
        ({"delta": [0.1, 7.0]}, r"parameter 'delta' = 7 is outside its range \[0, 5\]"),
        ({"delta": []}, "axis 'delta' must be a sequence of values, not an array of shape"),
        ({"delta": [[1.0]]}, "axis 'delta' must be a sequence of values"),
        ({"delta": ["a"]}, "parameter 'delta' must be a number, not 'a'"),
        ({"x": ["a"]}, "start of 'x' must be a number, not 'a'"),
        ({"delta": deltas, "rtol": 3.0}, "rtol = 3 must lie between 0 and 1"),
        ({"method": ["RK45", "RK54"]}, "there is no method 'RK54'"),
        ({"delta": deltas, "x": 1.0, "start": {"x": lambda p: 1}}, "'x' stands both in start and"),
        ({"x": [1.0], "start": {"x": [1.0]}}, "'x' stands both in start and among the names"),
        ({"x": [1.0, 2.0], "start": {"x": 5.0}}, "'x' stands both in start and among the names"),
        ({"delta": deltas, "start": {"y": 1.0}}, "start names the unknown state"),
        ({"delta": deltas, "start": {"x": [[1], [1, 2]]}}, "'x' must be numbers in one row"),
    ],
)
def test_bad_input_is_refused(names, words):
    with pytest.raises(ModelError, match=words):
        sweep(oscillator, 1.0, ending, **names)


def test_a_name_that_is_an_option_and_a_state_is_refused():
    with pytest.raises(ModelError, match="'rtol' is both an option and a state of 'clash'"):
        sweep(SWINGING, 1.0, ending, rtol=[1e-3])
    for name in ("executor", "progress", "accept"):
        with pytest.raises(ModelError, match=f"parameter '{name}' has the name of an option"):
            System("x", {"x": ""}, {name: 1.0}, [Mode("m", flow)], start={"x": 1.0})
    with pytest.raises(ModelError, match="must be a System, not 3"):
        sweep(3, 1.0, ending, a=[1])


def test_the_file(tmp_path):
    m = sweep(oscillator, 1.0, ending, x=[1.0, -2.0], method=["RK45"])
    rows = list(csv.reader(m.to_csv(tmp_path / "m.csv").open(encoding="utf-8")))
    assert rows[0] == ["x [m]", "method", "ending", "reason"]
    assert rows[1] == ["1.0", "RK45", "stays", ""]
    assert rows[2][:3] == ["-2.0", "RK45", ""] and "too low" in rows[2][3]


# ---- pictures


def words(axes):
    legend = axes.get_legend()
    return [text.get_text() for text in legend.get_texts()] if legend else []


def test_a_map_of_numbers():
    m = sweep(oscillator, 8.0, first_zero, delta=deltas, omega=omegas, points=2001)
    picture = m.picture(contour=[1.0, 1.5], title="First zero", label="time [s]")
    axes, bar = picture.axes
    assert axes.get_xlabel() == r"$\delta$ [1/s]" and axes.get_ylabel() == r"$\omega$ [1/s]"
    assert axes.get_yscale() == "log" and axes.get_xscale() == "linear"
    assert bar.get_ylabel() == "time [s]" and axes.get_title("left") == "First zero"
    mesh = axes.collections[0]
    np.testing.assert_array_equal(mesh.get_array(), m.values.T)
    swapped = m.picture("omega", "delta").axes[0]
    assert swapped.get_xscale() == "log" and swapped.get_xlabel() == r"$\omega$ [1/s]"
    assert picture.png()[:4] == b"\x89PNG"


def test_a_map_of_words_with_failed_lanes():
    m = sweep(oscillator, 6.0, ending, delta=deltas, x=[-1.0, 0.9, 1.0, 1.2])
    axes = m.picture().axes[0]
    assert words(axes) == ["low", "stays", "no result"]
    hatched = axes.collections[-1]
    assert hatched.get_hatch() and len(hatched.get_paths()) == m.failed.sum() == 5
    numbers = sweep(oscillator, 6.0, lambda run: run.t[-1], delta=deltas, x=[-1.0, 0.9])
    assert words(numbers.picture().axes[0]) == ["no result"]
    with pytest.raises(ModelError, match="contours are lines of equal numbers"):
        m.picture(contour=3)


def test_curves():
    m = sweep(oscillator, 8.0, first_zero, delta=deltas, points=2001)
    axes = m.picture(label="time [s]").axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), np.column_stack([deltas, m.values]))
    assert axes.get_ylabel() == "time [s]"
    assert m.picture().axes[0].get_ylabel() == "first zero"
    family = sweep(oscillator, 8.0, first_zero, delta=deltas, omega=[1.0, 2.0], points=2001)
    axes = family.picture("delta").axes[0]
    assert len(axes.lines) == 2 and words(axes) == [r"$\omega$ = 1 1/s", r"$\omega$ = 2 1/s"]
    lost = sweep(oscillator, 6.0, ending, x=[-1.0, 0.1, 1.0]).picture().axes[0]
    assert words(lost) == ["no result"] and len(lost.patches) == 1
    assert [tick.get_text() for tick in lost.get_yticklabels()] == ["low", "stays"]


def test_three_axes_are_maps_side_by_side():
    m = sweep(
        oscillator,
        6.0,
        lambda run: run.t[-1],
        delta=deltas,
        omega=[1.0, 2.0],
        method=["RK4", "RK45"],
    )
    picture = m.picture("delta", "omega")
    assert [axes.get_title("left") or axes.get_title() for axes in picture.axes[:2]] == [
        "method = RK4",
        "method = RK45",
    ]
    with pytest.raises(ModelError, match="the sweep has no axis 'rho'; it has 'delta', 'omega'"):
        m.picture("rho")
    many = sweep(oscillator, 1.0, ending, delta=[0.1], omega=[1.0], x=np.linspace(0, 1, 7))
    with pytest.raises(ModelError, match="7 values of 'x' would be as many maps"):
        many.picture()


def test_an_axis_at_equal_distances():
    x = np.array([0.9, 0.99, 0.999, 1.001, 1.01, 1.1])
    m = sweep(oscillator, 6.0, ending, x=x, delta=[0.1, 0.2])
    axes = m.picture("x", "delta", even=["x"]).axes[0]
    assert [tick.get_text() for tick in axes.get_xticklabels()][:2] == ["0.9", "0.99"]
    assert axes.get_xlim() == (-0.5, 5.5)
    with pytest.raises(ModelError, match="the sweep has no axis 'y'"):
        m.picture(even=["y"])
    with pytest.raises(ModelError, match="must rise or fall: sort them"):
        sweep(oscillator, 6.0, ending, x=[1.0, 0.5, 0.7], delta=[0.1, 0.2]).picture()


# ---- progress


def test_progress_is_silent_where_nobody_looks(capsys, monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    with Progress(10) as line:
        line.add(5)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with Progress(10) as line:
        line.add(5)
    shown = capsys.readouterr().err
    assert " 50%  5 of 10 runs, " in shown and shown.endswith("\r\033[K")
    with Progress(10, show=False) as line:
        line.add(5)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("answers", [True, False])
def test_progress_in_a_kernel(answers, monkeypatch):
    parent = {"content": {"code": "", "allow_stdin": answers}}
    kernel = SimpleNamespace(get_parent=lambda channel: parent)
    ipython = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=kernel))
    shown = []
    line = SimpleNamespace(update=lambda data, raw: shown.append(data["text/plain"]))

    def display(data, raw, display_id):
        shown.append(data["text/plain"])
        return line

    display_module = SimpleNamespace(display=display)
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display_module)
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    with Progress(10) as bar:
        bar.add(5)
        bar.add(5)
    if answers:
        assert "5 of 10 runs" in shown[0] and "10 of 10" in shown[1] and shown[2] == ""
    else:
        assert shown == []
    assert bar.text(2.0).startswith("█" * 24 + " 100%")


def test_a_map_in_given_axes():
    m = sweep(oscillator, 8.0, first_zero, delta=deltas, omega=omegas, points=2001)
    fig = figure(1, 2)
    assert m.picture("delta", "omega", axes=fig.axes[1], title="First zero") is fig
    assert not fig.axes[0].collections and fig.axes[1].get_title("left") == "First zero"
    np.testing.assert_array_equal(fig.axes[1].collections[0].get_array(), m.values.T)
    assert fig.axes[1].get_ylabel() == r"$\omega$ [1/s]"
    free = fig.add_axes((0.1, 0.1, 0.2, 0.2))
    m.picture("delta", "omega", axes=free)
    assert free.get_ylabel() == r"$\omega$ [1/s]"
    three = sweep(oscillator, 1.0, ending, delta=deltas, omega=omegas, x=[0.9, 1.0])
    with pytest.raises(ModelError, match="three axes are maps side by side"):
        three.picture(axes=fig.axes[0])


def test_a_result_with_the_name_of_an_axis_has_a_column_of_its_own():
    m = sweep(oscillator, 0.1, lambda run: {"delta": 5.0}, delta=[0.1, 0.2], backend="plain")
    columns = m.columns()
    assert (columns["delta"], columns["delta of the run"]) == ([0.1, 0.2], [5.0, 5.0])


def test_maps_at_the_edge():
    """A short logarithmic axis, one value of a third, no result at all, logarithms of nothing."""
    short = np.geomspace(3.1, 4.2, 4)
    m = sweep(oscillator, 1.0, lambda run: run["x"][-1], omega=short, delta=deltas, x=[0.5])
    axes = m.picture("omega", "delta").axes[0]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["3.1", "3.43", "3.796", "4.2"]
    assert axes.get_title("left") == "$x$ = 0.5 m"
    none = sweep(oscillator, 1.0, lambda run: np.nan, x=[0.0, 1.0], delta=[0.1, 0.2])
    assert words(none.picture().axes[0]) == ["no result"]
    with pytest.raises(ModelError, match="axis 'x' cannot be log"):
        none.picture(log=["x"])
