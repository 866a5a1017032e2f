"""The panel without a browser: controls from the model, pictures, messages, errors, export."""

import io
import json
import math
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import labkit
from labkit import (
    Handle,
    Mode,
    ModelError,
    Motion,
    Parameter,
    System,
    Transition,
    explore,
    figure,
    load_npz,
    mode_diagram,
    phase_portrait,
    simulate,
    time_plot,
)
from labkit.controls import _nice, _span, symbol_and_index
from labkit.panel import _verdict

from .systems import ball, stick_slip


@pytest.fixture(autouse=True)
def no_check(monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)


def oscillator(limit=math.inf, **more):
    def flow(t, s, p):
        if p.delta > limit:
            raise ZeroDivisionError("no such damping")
        return s.v, -(p.omega0**2) * s.x - 2 * p.delta * s.v

    parameters = {
        "omega0": Parameter(2.0, "rad/s", "natural frequency", 0.5, 6.0),
        "delta": Parameter(0.15, "1/s", "damping", 0.0, 2.0),
        **more,
    }
    return System(
        "damped oscillator",
        {"x": ("m", "elongation"), "v": "m/s"},
        parameters,
        [Mode("motion", flow)],
        start={"x": 1.0, "v": 0.0},
    )


def curves(run):
    return time_plot(run, ("x", "v"), title="")


class Browser:
    """Stands for panel.js: sends messages to a panel and keeps the answers."""

    def __init__(self, panel):
        self.panel, self.answers, self.seq = panel, [], 0
        panel.send = lambda content, buffers=None: self.answers.append((content, buffers))

    def tell(self, **message):
        self.seq += 1
        self.panel._handle_custom_msg({"seq": self.seq, "view": "here", **message}, [])
        answer, buffers = self.answers[-1]
        assert len(self.answers) == self.seq and (answer["seq"], answer["view"]) == (
            self.seq,
            "here",
        )  # one answer a message
        return answer, buffers

    def picture(self, settled=True, **values):
        """The points of the new picture, by part."""
        answer, (floats, _) = self.tell(kind="set", values=values, settled=settled)
        assert answer["kind"] == "picture", answer
        points, parts, k = np.frombuffer(floats, "<f4").reshape(-1, 2), {}, 0
        for name, ops in answer["ops"].items():
            count = sum(op.get("n", 0) + op.get("at", 0) for op in ops)
            parts[name], k = points[k : k + count], k + count
        assert k == len(points)
        return parts


@pytest.fixture
def browser():
    return Browser(explore(oscillator(), 10.0, curves))


# ---- controls


def test_sliders_come_from_the_model():
    panel = explore(oscillator(), 10.0, curves)
    made = {control.key: control for control in panel.controls}
    assert list(made) == [
        "p.omega0",
        "p.delta",
        "start.x",
        "start.v",
        "t_end",
        "method",
        "rtol",
        "step",
    ]
    assert (
        made["p.omega0"].name,
        made["p.omega0"].index,
        made["p.omega0"].unit,
        made["p.omega0"].meaning,
    ) == ("ω", "0", "rad/s", "natural frequency")
    assert (made["p.omega0"].low, made["p.omega0"].high, made["p.omega0"].value) == (0.5, 6.0, 2.0)
    assert made["start.v"].low < 0 < made["start.v"].high and made["start.x"].value == 1.0
    assert made["t_end"].value == 10.0 and made["t_end"].low < 10 < made["t_end"].high


def test_a_state_that_keeps_its_sign_has_a_slider_that_keeps_it():
    made = {control.key: control for control in explore(ball(), 15.0).controls}
    assert made["start.y"].low == 0.0 and made["start.v"].low < 0


def test_a_start_slider_ends_where_the_model_refuses_to_start():
    made = {control.key: control for control in explore(stick_slip(), 10.0).controls}
    assert (
        made["start.x"].high == pytest.approx(2.94, abs=1e-6) and made["start.x"].low == 0.0
    )  # beyond it does not stick


def test_which_sliders_and_ranges():
    def keys(**options):
        return {
            control.key: (control.low, control.high)
            for control in explore(oscillator(), 10.0, curves, **options).controls
        }

    assert keys(sliders={"delta": (0.1, 0.5), "x": False})["p.delta"] == (0.1, 0.5)
    assert "start.x" not in keys(sliders={"delta": (0.1, 0.5), "x": False})
    assert list(keys(sliders=["delta"], method=False)) == ["p.delta"]
    names = ["v", "delta", "x", "omega0"]  # a list is an order, within parameters and starts
    order = ["p.delta", "p.omega0", "start.v", "start.x"]
    assert list(keys(sliders=names, method=False)) == order
    assert list(keys(sliders=iter(names), method=False)) == order
    assert list(keys(start=False, method=False)) == ["p.omega0", "p.delta"]
    for none in (None, {}):
        assert list(keys(start=none, method=False)) == ["p.omega0", "p.delta"]
    assert keys(method=None) == keys(method=False)
    assert keys(sliders={"delta": (0.5, 0.5)})["p.delta"] == (0.15, 0.5)  # up to the value
    assert keys(sliders={"t_end": (5, 50)})["t_end"] == (5, 50)
    assert set(keys()) - set(keys(sliders={"t_end": False, "rtol": False})) == {"t_end", "rtol"}
    (control,) = explore(
        oscillator(),
        10.0,
        curves,
        sliders={"delta": (0, 1, 0.25)},
        start=False,
        method=False,
        omega0=3.0,
    ).controls[1:]
    assert control.step == 0.25


def test_a_start_value_and_options_are_handed_on():
    panel = explore(
        oscillator(),
        10.0,
        curves,
        start={"x": 2.0},
        omega0=3.0,
        points=50,
        method="RK45",
        rtol=1e-5,
    )
    assert panel.run.p.omega0 == 3.0 and len(panel.run) == 50 and panel.run.work.method == "RK45"
    assert panel.run.start == {"x": 2.0, "v": 0.0}
    assert [panel.defaults[key] for key in ("p.omega0", "start.x", "method", "rtol")] == [
        3.0,
        2.0,
        "RK45",
        1e-5,
    ]


@pytest.mark.parametrize(
    "options, words",
    [
        ({"sliders": {"omega": (0, 1)}}, "'omega'"),
        ({"sliders": ["w"]}, "'w'"),
        ({"sliders": {"delta": 3}}, "'delta'"),
        ({"sliders": {"delta": (0.15, 0.15)}}, "'delta'"),
        ({"sliders": {"delta": (0.5, 0.1)}}, "'delta' cannot run from 0.5 to 0.1: give"),
        ({"sliders": {"delta": (0.1,)}}, r"'delta' must be \(low, high\), .*, not \(0.1,\)"),
        ({"sliders": {"delta": (0, 1, 0.1, 9)}}, r"'delta' must be \(low, high\), .* 9\)"),
        ({"start": [1.0]}, r"start must be a dict .* not \[1.0\]"),
        ({"start": {"x": "far"}}, "start of 'x' must be a number, not 'far'"),
        ({"omega": 2.0}, "omega"),
        ({"delta": 7.0}, "outside its range"),
    ],
)
def test_bad_requests_are_refused_with_words(options, words):
    with pytest.raises(ModelError, match=words):
        explore(oscillator(), 10.0, curves, **options)


def test_a_horizon_that_is_no_number_is_refused():
    with pytest.raises(ModelError, match="horizon"):
        explore(oscillator(), math.nan, curves)


def test_a_run_that_begins_late_has_an_end_after_it():
    panel = explore(oscillator(), 1010.0, curves, t0=1000.0)
    end, step = (one for one in panel.controls if one.key in ("t_end", "step"))
    assert (end.low, end.high) == (1001.0, 1020.0) and step.value == 0.01
    panel.check()


@given(
    st.floats(-1e9, 1e9, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-9),
    st.booleans(),
    st.booleans(),
)
def test_a_range_holds_the_value_and_keeps_what_was_declared(value, has_low, has_high):
    low, high = (value - 1 if has_low else None), (value + 2 if has_high else None)
    made = _span(value, low, high)
    assert made[0] <= value <= made[1] and made[0] < made[1]
    assert (low is None or made[0] == low) and (high is None or made[1] == high)
    if value and not has_low and not has_high:
        assert made[0] * made[1] > 0  # never through zero unasked


@given(st.floats(1e-12, 1e12))
def test_steps_are_round_numbers(value):
    assert 0.39 * value <= _nice(value) <= value * (1 + 1e-9)
    assert f"{_nice(value):e}"[0] in "125"


@pytest.mark.parametrize(
    "name, latex, shown",
    [
        ("omega0", None, ("ω", "0")),
        ("lam", r"\lambda_0", ("λ", "0")),
        ("F_max", None, ("F", "max")),
        ("q", r"\frac{1}{2}", ("q", "")),
        ("mu", None, ("μ", "")),
        ("x", r"\dot x", ("x", "")),
    ],
)
def test_names_are_shown_as_letters(name, latex, shown):
    assert symbol_and_index(name, latex) == shown


# ---- pictures


def test_the_static_picture_is_the_figure_and_always_the_same():
    first, second = (explore(oscillator(), 10.0, curves) for _ in range(2))
    data, metadata = first._repr_mimebundle_()
    assert data["image/png"] == second._repr_mimebundle_()[0]["image/png"]
    assert data["text/plain"] == "panel of 'damped oscillator'"
    assert "application/vnd.jupyter.widget-view+json" in data
    told = metadata["image/png"]
    whole, figure_alone = (Image.open(io.BytesIO(png)) for png in (data["image/png"], first.png))
    assert (told["width"], told["alt"]) == (864, first.spec["alt"])
    assert whole.width == figure_alone.width and whole.height > figure_alone.height + 40
    assert told["height"] == pytest.approx(0.8 * whole.height, abs=1)
    above, below = (np.asarray(one.convert("RGB")).astype(int) for one in (whole, figure_alone))
    assert np.abs(above[: len(below)] - below).mean() < 1
    assert (above[len(below) :] < 100).any()  # words


def test_the_words_beside_the_saved_picture(monkeypatch):
    said = []

    def captioned(png, width, lines):
        said.append(lines)
        return png, 0

    monkeypatch.setattr("labkit.panel._captioned", captioned)
    panel = explore(oscillator(), 10.0, curves)
    panel.values = panel.values | {"p.delta": 0.5}  # what stands there is the default run
    panel._repr_mimebundle_()
    ((values, words, last),) = said
    values = values.replace("\u00a0", " ")
    assert "ω0 = 2 rad/s, δ = 0.15 1/s" in values and "rtol = 1e−08" in values
    assert "t_end = 10 s" in values and "h = " not in values
    assert words.startswith("finished at 10 s; no events; ") and "ms" not in words
    assert last == "Run this cell for sliders."


def test_only_what_has_changed_is_sent(browser):
    full, _ = browser.tell(kind="ready")
    assert (
        full["order"][0] == "s0"
        and set(full["ops"]) == set(full["order"])
        and full["size"] == [864, 364]
    )
    drag = browser.picture(settled=False, **{"p.delta": 0.16})
    assert "order" not in browser.answers[-1][0] and {"m2", "m4"} <= set(drag) <= {
        name for name in full["order"] if name.startswith("m")
    }
    assert all(
        "s0" not in browser.picture(settled=False, **{"p.delta": delta}) for delta in (0.17, 0.18)
    )


def test_a_slider_changes_the_picture_and_back(browser):
    start, other, back = (browser.picture(**{"p.delta": delta}) for delta in (0.15, 0.9, 0.15))
    lines = [name for name in start if name.startswith("m") and len(start[name])]
    assert lines and all(
        not np.array_equal(start[name], other[name])
        and np.array_equal(start[name], back[name], equal_nan=True)
        for name in lines
    )


def test_a_picture_is_of_the_screens_resolution(browser):
    browser.tell(kind="ready")
    one, two = (browser.tell(kind="set", values={}, ratio=ratio)[0]["size"] for ratio in (1.0, 2.0))
    assert (one, two) == ([864, 364], [1728, 729])
    assert browser.tell(kind="set", values={}, ratio=99.0)[0]["size"] == [
        2592,
        1094,
    ]  # no page can ask for a picture without end


def test_new_limits_redraw_the_still_part_and_axes_stay_until_the_hand_rests(browser):
    view, key = browser.panel.figure, {"start.x": 2.0, "p.omega0": 6.0}
    browser.picture()
    before, place = view.axes[0].get_ylim(), view.axes[0].bbox.bounds
    parts = browser.picture(settled=False, **key)
    assert (
        view.axes[0].get_ylim() != before
        and {"s0", "m0"} <= set(parts)
        and view.axes[0].bbox.bounds == place
    )
    assert (
        "s0" in browser.picture(**key) and view.axes[0].bbox.bounds != place
    )  # wider numbers at the ticks
    assert "s0" not in browser.picture(**key)


def test_limits_that_moved_in_an_update_without_a_picture_are_not_forgotten(browser):
    browser.picture()
    browser.panel.check()  # limits widen at the ends of the sliders
    assert "s0" in browser.picture()


def test_a_picture_with_too_many_points_is_a_bitmap_and_then_all_is_sent_again(
    browser, monkeypatch
):
    browser.picture()
    monkeypatch.setattr("labkit.panel.MOST", 100)
    answer, (data,) = browser.tell(kind="set", values={"p.delta": 0.3}, ratio=2.0)
    assert answer["mime"] == "image/jpeg" and list(Image.open(io.BytesIO(data)).size) == answer[
        "size"
    ] == [1728, 729]
    monkeypatch.undo()
    assert "s0" in browser.picture(**{"p.delta": 0.4})


def test_several_views_in_one_figure_move_together():
    def both(run):
        fig = figure(1, 2)
        return [time_plot(run, "x", axes=fig.axes[0]), phase_portrait(run, axes=fig.axes[1])]

    browser = Browser(explore(oscillator(), 10.0, both))
    one, two = browser.picture(**{"p.delta": 0.15}), browser.picture(**{"p.delta": 0.9})
    moved = [name for name in two if not np.array_equal(one[name], two[name], equal_nan=True)]
    assert {
        str(browser.panel.view.artists[int(name[1:])].axes is browser.panel.view.figure.axes[0])
        for name in moved
        if name[0] == "m"
    } == {"True", "False"}


# ---- messages


def test_values_add_up_and_ready_tells_them(browser):
    browser.picture(**{"p.delta": 0.5})
    answer, _ = browser.tell(kind="set", values={"method": "RK4", "step": 0.05}, settled=False)
    assert (
        browser.panel.run.work.steps == pytest.approx(200, abs=1)
        and browser.panel.run.work.method == "RK4"
    )
    answer, buffers = browser.tell(kind="ready", ratio=1.5)
    assert (
        answer["values"]["p.delta"] == 0.5
        and answer["values"]["method"] == "RK4"
        and len(buffers) == 2
    )


def test_a_tolerance_reaches_the_solver(browser):
    steps = []
    for rtol in (1e-4, 1e-11):
        browser.picture(rtol=rtol)
        steps.append(browser.panel.run.work.steps)
    assert steps[0] < steps[1]


def test_the_verdict_is_the_notebooks_or_tells_events_and_work():
    panel = explore(ball(), 15.0, verdict=lambda run: f"{len(run.events)} bounces", method=False)
    assert panel.spec["verdict"].endswith(" bounces")
    text = _verdict(simulate(ball(zeno=None), 5.0))
    assert text.startswith('finished at 5 s; 2 events (2 "bounce"); ') and " steps, " in text


def test_a_models_error_is_shown_as_it_is_and_the_run_stays(browser):
    before = browser.panel.run
    answer, buffers = browser.tell(kind="set", values={"p.delta": 7.0})
    assert (
        answer["kind"] == "error"
        and answer["text"] == "parameter 'delta' = 7 is outside its range [0, 2] 1/s"
        and "trace" not in answer
        and not buffers
    )
    assert browser.panel.run is before and browser.panel.values["p.delta"] == 0.15
    browser.picture(**{"p.delta": 0.2})


def test_any_other_error_is_a_sentence_with_its_traceback():
    def verdict(run):
        return f"{1 / (run.p.delta - 0.5):.3f}"

    browser = Browser(explore(oscillator(), 10.0, curves, verdict=verdict))
    answer, _ = browser.tell(kind="set", values={"p.delta": 0.5})
    assert (
        answer["kind"] == "error"
        and "division by zero" in answer["text"]
        and "in verdict" in answer["trace"]
    )


def test_choices_switch_between_variants():
    slow = oscillator()
    panel = explore(
        oscillator(),
        10.0,
        curves,
        choices={
            "variant": {
                "as printed": {},
                "with damping": {"delta": 1.5},
                "other model": {"system": slow, "omega0": 0.5},
            }
        },
    )
    assert (
        "p.delta" not in panel.defaults and "p.omega0" not in panel.defaults
    )  # what a choice sets has no slider
    browser = Browser(panel)
    browser.picture(**{"choice.variant": "with damping"})
    assert panel.run.p.delta == 1.5
    browser.picture(**{"choice.variant": "other model"})
    assert panel.run.system is slow and panel.run.p == (0.5, 0.15)


def test_choices_and_presets_are_of_what_a_page_can_say():
    """Numbers of NumPy, and options that are no texts: a page gives them back as texts."""
    sizes = {1: {"delta": 0.1}, 2: {"delta": 0.2}}
    presets = {"fast": {"omega0": np.int64(5), "size": 2}}
    panel = explore(oscillator(), 10.0, curves, choices={"size": sizes}, presets=presets)
    told = json.loads(json.dumps(panel.spec))
    Browser(panel).picture(**told["presets"]["fast"])
    assert (panel.run.p.omega0, panel.run.p.delta) == (5.0, 0.2)


# ---- hands


def both(run):
    fig = figure(1, 2)
    return [
        time_plot(run, "x", axes=fig.axes[0]),
        phase_portrait(run, "x", "v", limits=((-2, 2), (-4, 4)), axes=fig.axes[1]),
    ]


@pytest.fixture
def hands():
    browser = Browser(
        explore(
            oscillator(),
            10.0,
            both,
            presets={"no damping": {"delta": 0.0}, "from below": {"x": -1.0, "method": "RK45"}},
        )
    )
    browser.tell(kind="ready")
    return browser


def pixel(browser, axes, x, y):
    """Where a page shows a point: from what the page was told, not from Matplotlib."""
    told = browser.answers[-1][0]["axes"][axes]
    (left, top, width, height), (x0, y0, x1, y1) = told["box"], told["limits"]
    return {"x": left + (x - x0) / (x1 - x0) * width, "y": top + (y1 - y) / (y1 - y0) * height}


def test_a_click_starts_a_trajectory_that_stays_and_follows_the_sliders(hands):
    answer, _ = hands.tell(kind="start", axes=1, **pixel(hands, 1, 1.5, -2.0))
    assert answer["begun"] == 1 and answer["values"]["start.x"] == 1.0
    curve = hands.panel.overlay.curves[1]
    x, v = np.array(curve.get_data())
    exact = simulate(oscillator(), 10.0, start={"x": 1.5, "v": -2.0})
    np.testing.assert_allclose((x[0], v[0]), (1.5, -2.0), atol=1e-9)
    np.testing.assert_allclose(x[:-1], exact["x"], atol=1e-6)
    hands.picture(**{"p.delta": 1.0})
    np.testing.assert_allclose(
        np.array(curve.get_data())[0, :-1],
        simulate(oscillator(), 10.0, start={"x": 1.5, "v": -2.0}, delta=1.0)["x"],
        atol=1e-6,
    )
    hands.tell(kind="start", axes=1, **pixel(hands, 1, -1.0, 1.0))
    assert hands.tell(kind="clear", last=1)[0]["begun"] == 1
    assert hands.tell(kind="clear")[0]["begun"] == 0 and len(curve.get_xdata()) == 0
    assert (
        hands.tell(kind="start", axes=0, x=100, y=100)[0]["kind"] == "error"
    )  # a time plot is no plane


def test_a_place_where_no_run_can_start_is_a_sentence_and_leaves_nothing():
    hands = Browser(explore(stick_slip(), 10.0))
    hands.tell(kind="ready")
    answer, _ = hands.tell(kind="start", axes=1, **pixel(hands, 1, 50.0, 0.0))
    assert (
        answer["kind"] == "error"
        and "trace" not in answer
        and hands.tell(kind="ready")[0]["begun"] == 0
    )


def test_trajectories_that_cannot_start_any_more_do_not_hinder_the_others():
    hands = Browser(explore(stick_slip(), 10.0))
    hands.tell(kind="ready")
    for x in (2.0, 2.5):
        assert hands.tell(kind="start", axes=1, **pixel(hands, 1, x, 0.0))[0]["begun"] > 0
    hands.tell(kind="set", values={"p.k": 3.0})  # now both slip at once
    answer, _ = hands.tell(kind="clear", last=1)
    assert (answer["kind"], answer["begun"]) == ("picture", 1)


def test_dragging_the_start_moves_the_run_and_stays_in_the_sliders_range(hands):
    told = hands.answers[-1][0]
    assert hands.panel.spec["handles"] == ["start"]
    where = pixel(hands, 1, 1.0, 0.0)
    np.testing.assert_allclose(told["grips"], [[where["x"], where["y"]]], atol=1e-6)
    answer, _ = hands.tell(kind="drag", handle=0, settled=False, **pixel(hands, 1, -0.7, 1.2))
    assert answer["values"]["start.x"] == pytest.approx(-0.7, abs=0.006) and answer["values"][
        "start.v"
    ] == pytest.approx(1.2, abs=0.011)
    assert hands.panel.run.start == {
        "x": answer["values"]["start.x"],
        "v": answer["values"]["start.v"],
    }
    answer, _ = hands.tell(kind="drag", handle=0, x=1e6, y=0.0)
    made = {control.key: control for control in hands.panel.controls}
    assert (
        answer["values"]["start.x"] == made["start.x"].high
        and answer["values"]["start.v"] <= made["start.v"].high
    )


def test_a_handle_sets_parameters_by_a_mapping_of_the_notebook():
    def draw(run):
        fig = figure(1, 2)
        fig.axes[1].set(xlim=(-3, 1), ylim=(-7, 7))  # the eigenvalues −δ ± i√(ω² − δ²)
        nonlocal root
        root = Handle(
            fig.axes[1],
            place=lambda run: (-run.p.delta, math.sqrt(run.p.omega0**2 - run.p.delta**2)),
            values=lambda re, im: {"delta": -re, "omega0": math.hypot(re, im)},
            meaning="eigenvalue",
        )
        return [time_plot(run, "x", axes=fig.axes[0]), root]

    root = None
    hands = Browser(explore(oscillator(), 10.0, draw))
    told, _ = hands.tell(kind="ready")
    where = pixel(hands, 1, -0.15, math.sqrt(4 - 0.15**2))
    np.testing.assert_allclose(told["grips"], [[where["x"], where["y"]]], atol=1e-6)
    answer, _ = hands.tell(kind="drag", handle=0, **pixel(hands, 1, -0.6, 3.0))
    assert (answer["values"]["p.delta"], answer["values"]["p.omega0"]) == (
        pytest.approx(0.6),
        pytest.approx(math.hypot(0.6, 3), abs=0.011),
    )
    assert hands.panel.run.p.delta == pytest.approx(0.6)
    root.values = lambda re, im: {"detla": -re}
    assert (
        "'eigenvalue' names 'detla', which" in hands.tell(kind="drag", handle=0, **where)[0]["text"]
    )
    with pytest.raises(ModelError, match="Handle needs"):
        Handle(hands.panel.figure.axes[0], "delta")


def test_a_click_in_a_map_sets_its_sliders():
    """The axes of a Handle with click=True say which handle a click anywhere in them moves."""

    def draw(run):
        fig = figure(1, 2)
        fig.axes[1].set(xlim=(0, 2), ylim=(0.5, 6))
        place = Handle(fig.axes[1], "delta", "omega0", click=True)
        return [time_plot(run, "x", axes=fig.axes[0]), place]

    hands = Browser(explore(oscillator(), 10.0, draw))
    told, _ = hands.tell(kind="ready")
    assert [axes["click"] for axes in told["axes"]] == [-1, 0]
    assert "click in a map" in hands.panel.spec["help"]
    answer, _ = hands.tell(kind="drag", handle=0, **pixel(hands, 1, 1.4, 3.0))
    assert answer["values"]["p.delta"] == pytest.approx(1.4, abs=0.011)
    assert answer["values"]["p.omega0"] == pytest.approx(3.0, abs=0.011)
    assert "click in" not in explore(oscillator(), 10.0, curves).spec["help"]


def test_the_mode_of_the_instant_is_lit():
    def draw(run):
        fig = figure(2, 1, heights=[3, 1])
        return [time_plot(run, "x", axes=fig.axes[0]), mode_diagram(run.system, axes=fig.axes[1])]

    hands = Browser(explore(stick_slip(), 10.0, draw))
    lit = hands.panel.view.views[1]

    def filled():
        return [name for name, box in lit.boxes.items() if box.get_linewidth() > 2]

    assert hands.panel.spec["moves"] and filled() == ["stick"]
    for t in (1.0, 2.0, 5.5):
        hands.tell(kind="cursor", t=t)
        assert filled() == [hands.panel.run.at(t)["mode"]]
    assert {hands.panel.run.at(t)["mode"] for t in (1.0, 2.0)} == {"stick", "slip"}


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize("on", [False, True])
def test_a_modes_name_stays_in_its_box_or_is_alone(scale, on):
    """On a narrow page and in a classroom letters are large, and the axes of a diagram small."""
    names = ["first gear", "second gear", "third gear", "fourth gear"]
    pairs = zip(names, names[1:], strict=False)
    ups = [Transition(a, b, lambda t, s, p: s.x - 9.0, direction=1, label=b) for a, b in pairs]
    modes = [Mode(name, lambda t, s, p: (1.0,)) for name in names]
    system = System("gears", {"x": "m"}, {}, modes, ups, start={"x": 0.0})

    def draw(run):
        fig = figure(2, 2)
        diagram = mode_diagram(run.system, axes=fig.axes[1])
        return [time_plot(run, "x", axes=fig.axes[0]), diagram]

    hands = Browser(explore(system, 1.0, draw))
    lit = hands.panel.view.views[1]
    hands.tell(kind="large", on=on, scale=scale)
    hands.tell(kind="ready", scale=scale)
    shown = [name for name in names if lit.words[name].get_visible()]
    assert shown == (names if (scale, on) == (1.0, False) else ["first gear"])
    for name in shown if shown == names else []:
        word = lit.words[name].get_window_extent()
        box = lit.boxes[name].get_window_extent()
        assert box.x0 < word.x0 and word.x1 < box.x1 and box.y0 < word.y0 and word.y1 < box.y1
    hands.tell(kind="large", on=False, scale=1.0)
    assert all(word.get_visible() for word in lit.words.values())


@pytest.mark.parametrize("square", [False, True])
def test_in_a_classroom_a_low_picture_takes_the_height_of_the_room(square):
    """Shown 870 pixels wide; axes of one scale have an end in their width, and no empty room."""

    def draw(run):
        fig = figure(1, 3, width=13.5, height=4.1)
        for axes in fig.axes:
            axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]", title="the title of it")
        if square:
            fig.axes[1].set_aspect("equal")
        return [time_plot(run, "x", axes=fig.axes[0], title="a title")]

    hands = Browser(explore(oscillator(), 10.0, draw))
    low = hands.tell(kind="ready", scale=870 / 1296)[0]["size"]
    for _ in range(3):
        answer, _ = hands.tell(kind="large", on=True, scale=870 / 1296)
    width, height = answer["size"]
    box = hands.panel.figure.axes[1].bbox
    assert width == low[0]
    if square:
        assert low[1] < height < width / 1.9
        assert box.height == pytest.approx(box.width, rel=0.01)
        given = hands.panel.figure.axes[1].get_position(True)
        assert box.width > 0.94 * given.width * width
    else:
        assert height == pytest.approx(width / 1.9, abs=1) and box.height > 0.7 * height
    assert hands.tell(kind="large", on=False, scale=870 / 1296)[0]["size"] == low


def test_words_made_smaller_for_want_of_room_do_not_make_all_others_larger():
    """In a classroom the smallest word is 20 pixels high, and one that is too long goes below."""
    words = {"words": {"fontsize": 13, "x": 0.0}}

    def draw(run):
        axes = figure(width=9).axes[0]
        return labkit.curves(run, lambda run: {"words": "long " * 30}, axes=axes, styles=words)

    hands = Browser(explore(oscillator(), 10.0, draw))
    zooms = []
    for _ in range(4):
        hands.tell(kind="large", on=True, scale=0.9)
        zooms.append(hands.panel.scene.zoom)
    assert zooms == [zooms[0]] * 4 and zooms[0] < 2


def test_the_cursor_tells_values_at_an_instant_in_all_axes(hands):
    answer, _ = hands.tell(kind="cursor", axes=0, **pixel(hands, 0, 3.0, 0.0))
    values = hands.panel.run.at(answer["t"])
    assert (
        answer["t"] == pytest.approx(3.0)
        and answer["reading"].startswith("t = 3 s: x = ")
        and f"{values['x']:.4g}".replace("-", "−") in answer["reading"]
    )
    (line, _), (dot, place) = hands.panel.overlay.lines, hands.panel.overlay.dots
    np.testing.assert_allclose(line.get_xdata(), answer["t"])
    np.testing.assert_allclose(
        [dot.get_data(), place.get_data()],
        [[[answer["t"]], [values["x"]]], [[values["x"]], [values["v"]]]],
    )
    assert (
        set(answer["ops"]) <= {name for name in answer["ops"] if name.startswith("m")}
        and len(answer["ops"]) <= 4
    )  # nothing else is drawn
    assert hands.tell(kind="cursor", t=99.0)[0]["t"] == 10.0
    answer, _ = hands.tell(kind="set", values={"t_end": 5.0})
    assert answer["t"] == 5.0  # it stays inside the run
    assert hands.tell(kind="cursor", t=None)[0]["reading"] == ""


def test_the_cursor_names_the_mode():
    hands = Browser(explore(stick_slip(), 10.0))
    hands.tell(kind="ready")
    assert hands.tell(kind="cursor", t=0.5)[0]["reading"].endswith("; stick")


def test_zoom_and_back(hands):
    axes = hands.panel.figure.axes[0]
    before = axes.get_xlim(), axes.get_ylim()
    answer, _ = hands.tell(kind="limits", axes=0, limits=[2.0, -0.5, 4.0, 0.5], settled=False)
    assert (
        axes.get_xlim() == (2.0, 4.0)
        and axes.get_ylim() == (-0.5, 0.5)
        and not answer["axes"][0]["home"]
        and "s0" in answer["ops"]
    )
    hands.picture(**{"start.x": 2.0})
    assert axes.get_xlim() == (2.0, 4.0)  # a zoom is the user's
    hands.picture(**{"start.x": 1.0})
    answer, _ = hands.tell(kind="limits", axes=0, limits=None)
    assert (axes.get_xlim(), axes.get_ylim()) == before and answer["axes"][0]["home"]
    assert (
        hands.tell(kind="limits", axes=0, limits=[2.0, 0.0, 2.0, 1.0])[0]["kind"] == "error"
        and axes.get_xlim() == before[0]
    )


def test_a_zoom_that_was_refused_is_none(hands):
    assert hands.tell(kind="limits", axes=0, limits=[2.0, 0.0, 2.0, 1.0])[0]["kind"] == "error"
    assert hands.tell(kind="ready")[0]["axes"][0]["home"]


def test_zoom_of_logarithmic_axes_is_linear_in_pixels():
    def draw(run):
        view = time_plot(run, "x")
        view.axes[0].set(yscale="log", ylim=(1e-4, 1e2))
        return view

    hands = Browser(explore(oscillator(), 10.0, draw))
    told, _ = hands.tell(kind="ready")
    np.testing.assert_allclose(told["axes"][0]["limits"][1::2], [-4, 2])
    hands.tell(kind="limits", axes=0, limits=[0.0, -2.0, 10.0, 1.0])
    np.testing.assert_allclose(hands.panel.figure.axes[0].get_ylim(), (1e-2, 10))


def test_a_held_run_stays_as_a_ghost(hands):
    held = hands.panel.run
    hands.tell(kind="hold", on=True)
    hands.picture(**{"p.delta": 1.5})
    (ghost,), (path,) = hands.panel.overlay.ghosts
    np.testing.assert_array_equal(ghost.get_ydata(), held["x"])
    np.testing.assert_array_equal(path.get_data(), [held["x"], held["v"]])
    assert not np.array_equal(hands.panel.run["x"], held["x"])
    hands.tell(kind="hold", on=False)
    assert len(ghost.get_xdata()) == 0


def test_classroom_makes_letters_larger_in_a_picture_of_the_same_width_and_keeps_the_axes(hands):
    def tallest(answer):
        return max(
            op["image"][3]
            for name, ops in answer["ops"].items()
            if name[0] == "s"
            for op in ops
            if "image" in op
        )

    def letters():
        answer, _ = hands.tell(kind="ready")
        return answer["size"], tallest(answer)

    size, small = letters()
    limits = hands.panel.figure.axes[0].get_ylim()
    assert "order" in hands.tell(kind="large", on=True)[0]
    hands.picture(**{"start.x": 2.0})
    assert hands.panel.figure.axes[0].get_ylim() == limits
    assert letters()[0][0] == size[0] and letters()[1] > 1.25 * small
    hands.tell(kind="large", on=False)
    assert letters() == (size, small)
    narrow, _ = hands.tell(
        kind="ready", ratio=0.5, scale=0.5
    )  # a narrow page: half the size, but not half the letters
    assert narrow["size"] == [side // 2 for side in size] and tallest(narrow) > 0.75 * small
    assert letters() == (size, small)
    hands.picture(**{"start.x": 2.01})
    assert hands.panel.figure.axes[0].get_ylim() != limits


def test_presets(hands, monkeypatch):
    assert hands.panel.spec["presets"] == {
        "no damping": {"p.delta": 0.0},
        "from below": {"start.x": -1.0, "method": "RK45"},
    }
    hands.picture(**{"p.omega0": 5.0})
    answer, _ = hands.tell(kind="set", values={"p.delta": 0.0}, reset=True)
    assert answer["values"]["p.omega0"] == 2.0 and hands.panel.run.p.delta == 0.0
    with pytest.raises(ModelError, match="preset 'a' names 'q'"):
        explore(oscillator(), 10.0, curves, presets={"a": {"q": 1.0}})
    for values, words in [
        ({"delta": 9.0}, "preset 'a': .*outside its range"),
        ({"delta": "abc"}, "'delta' of preset 'a' must be a number"),
        ({"x": math.nan}, "'x' of preset 'a' must be finite"),
        ({"rtol": "fine"}, "'rtol' of preset 'a' must be a number"),
        ({"method": "Euler's"}, "'method' of preset 'a' must be one of"),
    ]:
        with pytest.raises(ModelError, match=words):
            explore(oscillator(), 10.0, curves, presets={"a": values})
    monkeypatch.setenv("LABKIT_CHECK", "1")
    with pytest.raises(ModelError) as caught:
        explore(oscillator(), 10.0, curves, presets={"too fine": {"rtol": -1.0}})
    assert "preset 'too fine'" in caught.value.__notes__[0]


def test_a_mechanism_moves_with_the_cursor_and_redraws_nothing_else():
    seen = []

    def mechanism(sketch, s):
        seen.append((s.t, s.x, s.p.omega0))
        sketch.ground((0, 0.5), (6, 0.5))
        sketch.block((3 + s.x, 1.0), 1.2, 1.0, "m")

    def draw(run):
        fig = figure(2, 1, height=5)
        return [time_plot(run, "x", axes=fig.axes[0]), Motion(fig.axes[1], mechanism, 6, 2)]

    hands = Browser(explore(oscillator(), 10.0, draw))
    hands.tell(kind="ready")
    assert seen[-1] == (0.0, 1.0, 2.0)
    name = f"m{[type(artist).__name__ for artist in hands.panel.scene.artists].index('_Pieces')}"
    blocks = []
    for t in (2.0, 4.0):
        answer, (floats, _) = hands.tell(kind="cursor", t=t)
        assert (
            name in answer["ops"]
            and "order" not in answer
            and seen[-1][:2] == (t, hands.panel.run.at(t)["x"])
        )
        blocks.append(floats)
    assert blocks[0] != blocks[1]
    assert len(hands.panel.figure.axes[1].get_children()) < 20  # nothing piles up


def test_an_alternative_text_says_what_is_shown(hands):
    text = hands.panel.spec["alt"]
    assert text.startswith("damped oscillator: x [m] over t [s]; 0 to 10 across, ")
    assert (
        "v [m/s] over x [m]; −2 to 2 across, −4 to 4 up" in text and "stable spiral point" in text
    )


def test_what_a_panel_cannot_do_is_said(hands):
    assert "cannot" in hands.tell(kind="jump")[0]["text"]
    assert "Error" in hands.tell(kind="drag", handle=9, x=0, y=0)[0]["text"]


# ---- what CI asks for


def test_check_tries_both_ends_of_every_slider(monkeypatch):
    monkeypatch.setenv("LABKIT_CHECK", "1")
    explore(oscillator(), 5.0, curves)
    seen = []
    explore(
        oscillator(),
        5.0,
        curves,
        verdict=lambda run: seen.append((run.p.delta, run.work.method)) or "",
    )
    assert {0.0, 2.0} <= {delta for delta, _ in seen} and {"Euler", "LSODA", "BDF"} <= {
        method for _, method in seen
    }


@pytest.mark.parametrize("error", [ZeroDivisionError, ModelError])
def test_check_lets_errors_out_and_names_the_slider(monkeypatch, error):
    def verdict(run):
        if run.p.delta > 1.9:
            raise error("too much damping")
        return ""

    explore(oscillator(), 5.0, curves, verdict=verdict)  # not asked: no error
    monkeypatch.setenv("LABKIT_CHECK", "1")
    with pytest.raises(error, match="too much") as caught:
        explore(oscillator(), 5.0, curves, verdict=verdict)
    assert any("δ = 2.0" in note for note in caught.value.__notes__)


# ---- export


def test_exports_go_beside_the_notebook_and_write_over_nothing(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    browser.picture(**{"p.delta": 0.4})
    texts = [
        browser.tell(kind="export", what=what)[0]["text"] for what in ("csv", "csv", "npz", "png")
    ]
    assert [text.rsplit("/", 1)[-1].rsplit("\\", 1)[-1] for text in texts] == [
        f"damped_oscillator{end}" for end in (".csv", "_2.csv", ".npz", ".png")
    ]
    assert load_npz("damped_oscillator.npz")["p.delta"] == 0.4
    assert Image.open("damped_oscillator.png").width >= 1200
    assert (
        len((tmp_path / "damped_oscillator.csv").read_text(encoding="utf-8").splitlines())
        == len(browser.panel.run) + 2  # how it was made, and the names of the columns
    )


def test_an_export_that_cannot_be_written_is_a_sentence(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "tempfile.NamedTemporaryFile",
        lambda **_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")),
    )
    for what in ("csv", "npz", "png"):
        answer, _ = browser.tell(kind="export", what=what)
        assert (
            answer["kind"] == "error"
            and "cannot be written" in answer["text"]
            and "trace" not in answer
        )
    assert not list(tmp_path.iterdir())
    assert browser.tell(kind="export", what="xls")[0]["kind"] == "error"


# ---- runs that stop, undo, home, code, downloads, interrupts


def test_a_run_that_did_not_finish_gets_no_verdict_of_the_author():
    def verdict(run):
        assert run.ended in ("finished", "terminal event")
        return f"{len(run.events)} bounces in all"

    hands = Browser(explore(ball(zeno=None), 2.0, verdict=verdict))
    answer, _ = hands.tell(kind="ready")
    assert answer["verdict"].endswith(" bounces in all") and answer["stopped"] == ""
    answer, _ = hands.tell(kind="set", values={"t_end": 40.0})
    run = hands.panel.run
    assert run.ended == "Zeno" and run.stopped in answer["stopped"] and answer["verdict"] == ""
    answer, _ = hands.tell(kind="set", values={"t_end": 2.0})
    assert answer["stopped"] == ""


def test_undo_goes_back_by_settled_steps(browser):
    for delta in (0.2, 0.3, 0.4):
        browser.picture(settled=False, **{"p.delta": delta})
    browser.picture(**{"p.delta": 0.4})
    answer, _ = browser.tell(kind="set", values={"p.omega0": 3.0})
    assert answer["undo"] == 2
    seen = []
    for _ in range(3):
        answer, _ = browser.tell(kind="undo")
        seen.append((answer["values"]["p.omega0"], answer["values"]["p.delta"], answer["undo"]))
    assert seen == [(2.0, 0.4, 1), (2.0, 0.15, 0), (2.0, 0.15, 0)]


def test_reset_brings_home_values_axes_and_cursor(hands):
    limits = [(axes.get_xlim(), axes.get_ylim()) for axes in hands.panel.figure.axes]
    hands.picture(**{"start.x": 2.0, "t_end": 20.0})  # grown
    hands.tell(kind="limits", axes=1, limits=[5.0, 5.0, 6.0, 6.0])
    hands.tell(kind="cursor", t=3.0)
    answer, _ = hands.tell(kind="set", values={}, reset=True, home=True)
    assert answer["values"] == hands.panel.defaults and answer["t"] is None
    assert [(axes.get_xlim(), axes.get_ylim()) for axes in hands.panel.figure.axes] == limits
    assert all(axes["home"] for axes in answer["axes"])
    hands.picture(**{"start.x": 2.0})
    assert hands.panel.figure.axes[0].get_ylim() != limits[0][1]  # they follow the data again


def test_the_settings_as_a_line_of_code(browser):
    assert browser.tell(kind="ready")[0]["code"] == "explore(system, 10.0)"
    values = {"p.delta": 0.3, "start.x": -1.5, "t_end": 12.0, "method": "RK4", "step": 0.02}
    answer, _ = browser.tell(kind="set", values=values)
    line = 'explore(system, 12.0, delta=0.3, start={"x": -1.5}, method="RK4", step=0.02)'
    assert answer["code"] == line
    again = eval(line, {"explore": explore, "system": oscillator()})
    assert again.run.p == browser.panel.run.p and again.run.final == browser.panel.run.final
    answer, _ = browser.tell(kind="set", values={"rtol": 1e-6}, reset=True)
    assert answer["code"] == "explore(system, 10.0, rtol=1e-06)"


def test_the_line_of_code_says_what_no_slider_sets():
    panel = explore(ball(zeno=None), 40.0, method=False, rtol=1e-5)
    assert panel.run.t[-1] < 40 and panel.code() == "explore(system, 40.0, rtol=1e-05)"


def test_the_line_of_code_leaves_to_a_choice_what_it_has_set():
    ways = {"a": {"method": "RK45", "rtol": 1e-4}, "b": {"method": "RK4", "step": 0.1}}
    panel = explore(oscillator(), 2.0, curves, choices={"m": ways})
    assert panel.code() == "explore(system, 2.0)"
    Browser(panel).picture(**{"choice.m": "b"})
    assert panel.run.work.method == "RK4" and panel.code() == "explore(system, 2.0)  # m: b"


@pytest.mark.parametrize("step", [0, -0.1])
def test_a_step_that_leads_nowhere_is_refused(step):
    with pytest.raises(
        ModelError, match="slider of 'delta' has the step .*: a step must be above 0"
    ):
        explore(oscillator(), 10.0, curves, sliders={"delta": (0, 1, step)})


def test_the_grid_of_a_slider():
    def control(*ends, **options):
        sliders = {"delta": ends}
        made = explore(oscillator(), 10.0, curves, sliders=sliders, **options).controls
        return next(one for one in made if one.key == "p.delta")

    odd = control(0.1, 0.9, 0.2)
    assert [odd.nearest(at) for at in (0, 0.19, 0.21, 0.75, 9)] == [0.1, 0.1, 0.3, 0.7, 0.9]
    fine = explore(oscillator(), 9.0, curves, sliders={"rtol": (1e-9, 1e-3, 0.5)}).controls
    rtol = next(one for one in fine if one.key == "rtol")
    assert [rtol.nearest(at) for at in (1e-9, 2.9e-8, 1e-3)] == [1e-9, 3.2e-8, 1e-3]
    assert control(0.0333, 1).nearest(0.5001) == 0.5  # round numbers where no step is given


def test_under_voila_files_go_to_the_browser(monkeypatch, tmp_path):
    monkeypatch.setenv("SERVER_SOFTWARE", "voila/0.5")
    monkeypatch.chdir(tmp_path)
    hands = Browser(explore(oscillator(), 10.0, curves))
    for what, begin in (("csv", b"# {"), ("npz", b"PK"), ("png", b"\x89PNG")):
        answer, (data,) = hands.tell(kind="export", what=what)
        assert answer["name"] == f"damped_oscillator.{what}" and data.startswith(begin)
    assert not list(tmp_path.iterdir())


def test_an_interrupt_ends_a_computation_in_another_thread_and_the_panel_lives_on():
    from labkit.interrupt import _hand_on

    begun = threading.Event()

    def verdict(run):
        if run.p.delta == 1.0:
            begun.set()
            while True:
                pass
        return "done"

    hands = Browser(explore(oscillator(), 10.0, curves, verdict=verdict))
    work = threading.Thread(target=hands.tell, kwargs={"kind": "set", "values": {"p.delta": 1.0}})
    work.start()
    assert begun.wait(30)
    _hand_on(2, None)
    work.join(30)
    assert not work.is_alive()
    answer, _ = hands.answers[-1]
    assert answer["kind"] == "error" and "Interrupted" in answer["text"]
    assert hands.tell(kind="set", values={"p.delta": 0.5})[0]["verdict"] == "done"


def test_a_reading_says_what_the_axis_says():
    hands = Browser(explore(pendulum(), 2.0))
    hands.tell(kind="ready")
    assert hands.tell(kind="cursor", t=0.5)[0]["reading"].startswith("t = 0.5 s: θ = ")


def pendulum():
    def flow(t, s, p):
        return s.omega, -p.g * s.theta

    states = {"theta": "rad", "omega": "rad/s"}
    return System(
        "pendulum", states, {"g": 9.81}, [Mode("swing", flow)], start={"theta": 1, "omega": 0}
    )
