"""The panel without a browser: controls from the model, pictures, messages, errors, export."""

import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from labkit import Mode, ModelError, Parameter, System, explore, figure, load_npz, phase_portrait, simulate, time_plot
from labkit.panel import Bitmap, _nice, _span, _symbol, _verdict

from .systems import ball, stick_slip


@pytest.fixture(autouse=True)
def no_check(monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)


def oscillator(limit=math.inf, **more):
    def flow(t, s, p):
        if p.delta > limit:
            raise ZeroDivisionError("no such damping")
        return s.v, -p.omega0**2 * s.x - 2 * p.delta * s.v

    parameters = {"omega0": Parameter(2.0, "rad/s", "natural frequency", 0.5, 6.0), "delta": Parameter(0.15, "1/s", "damping", 0.0, 2.0), **more}
    return System("damped oscillator", {"x": ("m", "elongation"), "v": "m/s"}, parameters, [Mode("motion", flow)], start={"x": 1.0, "v": 0.0})


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
        assert len(self.answers) == self.seq and (answer["seq"], answer["view"]) == (self.seq, "here")  # one answer a message
        return answer, buffers

    def picture(self, sharp=True, **values):
        answer, buffers = self.tell(kind="set", values=values, sharp=sharp)
        assert answer["kind"] == "picture", answer
        return np.asarray(Image.open(io.BytesIO(buffers[0])).convert("RGB")).astype(int)


@pytest.fixture
def browser():
    return Browser(explore(oscillator(), 10.0, curves))


# ---- controls


def test_sliders_come_from_the_model():
    panel = explore(oscillator(), 10.0, curves)
    made = {control.key: control for control in panel.controls}
    assert list(made) == ["p.omega0", "p.delta", "start.x", "start.v", "t_end", "method", "rtol", "step"]
    assert (made["p.omega0"].name, made["p.omega0"].index, made["p.omega0"].unit, made["p.omega0"].meaning) == ("ω", "0", "rad/s", "natural frequency")
    assert (made["p.omega0"].low, made["p.omega0"].high, made["p.omega0"].value) == (0.5, 6.0, 2.0)
    assert made["start.v"].low < 0 < made["start.v"].high and made["start.x"].value == 1.0
    assert made["t_end"].value == 10.0 and made["t_end"].low < 10 < made["t_end"].high


def test_a_state_that_keeps_its_sign_has_a_slider_that_keeps_it():
    made = {control.key: control for control in explore(ball(), 15.0).controls}
    assert made["start.y"].low == 0.0 and made["start.v"].low < 0


def test_a_start_slider_ends_where_the_model_refuses_to_start():
    made = {control.key: control for control in explore(stick_slip(), 10.0).controls}
    assert made["start.x"].high == pytest.approx(2.94, abs=1e-6) and made["start.x"].low == 0.0  # beyond it does not stick


def test_which_sliders_and_ranges():
    def keys(**options):
        return {control.key: (control.low, control.high) for control in explore(oscillator(), 10.0, curves, **options).controls}

    assert keys(sliders={"delta": (0.1, 0.5), "x": False})["p.delta"] == (0.1, 0.5)
    assert "start.x" not in keys(sliders={"delta": (0.1, 0.5), "x": False})
    assert list(keys(sliders=["delta"], method=False)) == ["p.delta"]
    assert list(keys(start=False, method=False)) == ["p.omega0", "p.delta"]
    assert keys(sliders={"t_end": (5, 50)})["t_end"] == (5, 50)
    assert set(keys()) - set(keys(sliders={"t_end": False, "rtol": False})) == {"t_end", "rtol"}
    (control,) = explore(oscillator(), 10.0, curves, sliders={"delta": (0, 1, 0.25)}, start=False, method=False, omega0=3.0).controls[1:]
    assert control.step == 0.25


def test_a_start_value_and_options_are_handed_on():
    panel = explore(oscillator(), 10.0, curves, start={"x": 2.0}, omega0=3.0, points=50, method="RK45", rtol=1e-5)
    assert panel.run.p.omega0 == 3.0 and len(panel.run) == 50 and panel.run.work.method == "RK45"
    assert panel.run.start == {"x": 2.0, "v": 0.0}
    assert [panel.defaults[key] for key in ("p.omega0", "start.x", "method", "rtol")] == [3.0, 2.0, "RK45", 1e-5]


@pytest.mark.parametrize("options, words", [
    ({"sliders": {"omega": (0, 1)}}, "'omega'"),
    ({"sliders": ["w"]}, "'w'"),
    ({"sliders": {"delta": 3}}, "'delta'"),
    ({"sliders": {"delta": (0.15, 0.15)}}, "'delta'"),
    ({"omega": 2.0}, "omega"),
    ({"delta": 7.0}, "outside its range"),
])
def test_bad_requests_are_refused_with_words(options, words):
    with pytest.raises(ModelError, match=words):
        explore(oscillator(), 10.0, curves, **options)


def test_a_horizon_that_is_no_number_is_refused():
    with pytest.raises(ModelError, match="horizon"):
        explore(oscillator(), math.nan, curves)


@given(st.floats(-1e9, 1e9, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-9), st.booleans(), st.booleans())
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


@pytest.mark.parametrize("name, latex, shown", [("omega0", None, ("ω", "0")), ("lam", r"\lambda_0", ("λ", "0")), ("F_max", None, ("F", "max")),
                                                ("q", r"\frac{1}{2}", ("q", "")), ("mu", None, ("μ", "")), ("x", r"\dot x", ("x", ""))])
def test_names_are_shown_as_letters(name, latex, shown):
    assert _symbol(name, latex) == shown


# ---- pictures


def test_the_static_picture_is_the_figure_and_always_the_same():
    first, second = (explore(oscillator(), 10.0, curves) for _ in range(2))
    data, metadata = first._repr_mimebundle_()
    assert data["image/png"] == second._repr_mimebundle_()[0]["image/png"] == curves(first.run).figure.png()
    assert data["text/plain"] == "panel of 'damped oscillator'" and "application/vnd.jupyter.widget-view+json" in data
    assert metadata["image/png"]["width"] == 864


def test_only_the_artists_move_and_the_picture_is_what_matplotlib_draws(browser):
    """Blitting against a full drawing of the same run: the same pixels, but for the edges where a curve lies over a spine."""
    blitted = browser.picture(omega0=0, **{"p.omega0": 3.0})
    view = curves(simulate(oscillator(), 10.0))
    view.update(simulate(oscillator(), 10.0, omega0=3.0))
    full = np.asarray(Image.open(io.BytesIO(view.figure.png(dpi=96))).convert("RGB")).astype(int)
    assert blitted.shape == full.shape
    assert (np.abs(blitted - full).max(axis=2) > 64).mean() < 0.003


def test_a_slider_changes_the_picture_and_back(browser):
    start, other, back = (browser.picture(**{"p.delta": delta}) for delta in (0.15, 0.9, 0.15))
    assert (np.abs(start - other).max(axis=2) > 64).mean() > 0.005
    assert np.array_equal(start, back)


def test_dragging_sends_jpeg_and_letting_go_png_at_the_screens_resolution(browser):
    answer, (drag,) = browser.tell(kind="set", values={"p.delta": 0.3}, sharp=False, ratio=2.0)
    assert answer["mime"] == "image/jpeg" and drag[:2] == b"\xff\xd8"
    answer, (sharp,) = browser.tell(kind="set", values={"p.delta": 0.3}, sharp=True, ratio=2.0)
    assert answer["mime"] == "image/png" and Image.open(io.BytesIO(sharp)).width == 2 * Image.open(io.BytesIO(drag)).width == 1728
    a, b = (np.asarray(Image.open(io.BytesIO(data)).convert("L").resize((864, 10))).astype(float) for data in (drag, sharp))
    assert np.abs(a - b).mean() < 6  # the same picture, but for resolution and compression


def test_new_limits_redraw_the_still_part(browser):
    view = browser.panel.view
    before = view.axes[0].get_ylim()
    picture = browser.picture(**{"start.x": 2.0, "p.omega0": 6.0})
    assert view.axes[0].get_ylim() != before
    fresh = Bitmap(view).encode(1.0)[1]
    assert np.array_equal(picture, np.asarray(Image.open(io.BytesIO(fresh)).convert("RGB")))


def test_limits_that_moved_in_an_update_without_a_picture_are_not_forgotten(browser):
    browser.picture()
    browser.panel.check()  # limits widen at the ends of the sliders; nothing is drawn
    picture = browser.picture()
    fresh = Bitmap(browser.panel.view).encode(1.0)[1]
    assert np.array_equal(picture, np.asarray(Image.open(io.BytesIO(fresh)).convert("RGB")))


def test_several_views_in_one_figure_move_together():
    def both(run):
        fig = figure(1, 2)
        return [time_plot(run, "x", axes=fig.axes[0]), phase_portrait(run, axes=fig.axes[1])]

    browser = Browser(explore(oscillator(), 10.0, both))
    change = np.abs(browser.picture(**{"p.delta": 0.15}) - browser.picture(**{"p.delta": 0.9})).max(axis=2) > 64
    assert change[:, :432].sum() > 300 and change[:, 432:].sum() > 300


# ---- messages


def test_values_add_up_and_ready_tells_them(browser):
    browser.picture(**{"p.delta": 0.5})
    answer, _ = browser.tell(kind="set", values={"method": "RK4", "step": 0.05}, sharp=False)
    assert browser.panel.run.work.steps == pytest.approx(200, abs=1) and "RK4" == browser.panel.run.work.method
    answer, buffers = browser.tell(kind="ready", ratio=1.5)
    assert answer["values"]["p.delta"] == 0.5 and answer["values"]["method"] == "RK4" and len(buffers) == 1


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
    assert text.startswith("finished at 5 s; 2 events (2 \"bounce\"); ") and " steps, " in text


def test_a_models_error_is_shown_as_it_is_and_the_run_stays(browser):
    before = browser.panel.run
    answer, buffers = browser.tell(kind="set", values={"p.delta": 7.0})
    assert answer["kind"] == "error" and answer["text"] == "parameter 'delta' = 7 is outside its range [0, 2] 1/s" and "trace" not in answer and not buffers
    assert browser.panel.run is before and browser.panel.values["p.delta"] == 0.15
    browser.picture(**{"p.delta": 0.2})


def test_any_other_error_is_a_sentence_with_its_traceback():
    def verdict(run):
        return f"{1 / (run.p.delta - 0.5):.3f}"

    browser = Browser(explore(oscillator(), 10.0, curves, verdict=verdict))
    answer, _ = browser.tell(kind="set", values={"p.delta": 0.5})
    assert answer["kind"] == "error" and "division by zero" in answer["text"] and "in verdict" in answer["trace"]


def test_choices_switch_between_variants():
    slow = oscillator()
    panel = explore(oscillator(), 10.0, curves, choices={"variant": {"as printed": {}, "with damping": {"delta": 1.5}, "other model": {"system": slow, "omega0": 0.5}}})
    assert "p.delta" not in panel.defaults and "p.omega0" not in panel.defaults  # what a choice sets has no slider
    browser = Browser(panel)
    browser.picture(**{"choice.variant": "with damping"})
    assert panel.run.p.delta == 1.5
    browser.picture(**{"choice.variant": "other model"})
    assert panel.run.system is slow and panel.run.p == (0.5, 0.15)


# ---- what CI asks for


def test_check_tries_both_ends_of_every_slider(monkeypatch):
    monkeypatch.setenv("LABKIT_CHECK", "1")
    explore(oscillator(), 5.0, curves)
    seen = []
    explore(oscillator(), 5.0, curves, verdict=lambda run: seen.append((run.p.delta, run.work.method)) or "")
    assert {0.0, 2.0} <= {delta for delta, _ in seen} and {"Euler", "LSODA", "BDF"} <= {method for _, method in seen}


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
    texts = [browser.tell(kind="export", what=what)[0]["text"] for what in ("csv", "csv", "npz", "png")]
    assert [text.rsplit("/", 1)[-1].rsplit("\\", 1)[-1] for text in texts] == [f"damped_oscillator{end}" for end in (".csv", "_2.csv", ".npz", ".png")]
    assert load_npz("damped_oscillator.npz")["p.delta"] == 0.4
    assert Image.open("damped_oscillator.png").width >= 1200
    assert len((tmp_path / "damped_oscillator.csv").read_text(encoding="utf-8").splitlines()) == len(browser.panel.run) + 1


def test_an_export_that_cannot_be_written_is_a_sentence(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.NamedTemporaryFile", lambda **_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    for what in ("csv", "npz", "png"):
        answer, _ = browser.tell(kind="export", what=what)
        assert answer["kind"] == "error" and "cannot be written" in answer["text"] and "trace" not in answer
    assert not list(tmp_path.iterdir())
    assert browser.tell(kind="export", what="xls")[0]["kind"] == "error"
