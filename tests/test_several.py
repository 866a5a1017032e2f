"""Several models behind one set of sliders."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from labkit import (
    Mode,
    ModelError,
    Motion,
    Only,
    Parameter,
    System,
    Transition,
    curves,
    explore,
    figure,
    mode_diagram,
    phase_portrait,
    time_plot,
)

PLAIN = {"backend": "plain"}


@pytest.fixture(autouse=True)
def no_check(monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)


def oscillator(name="oscillator", states=("x", "v"), start=1.0, **parameters):
    x, v = states
    made = {"k": Parameter(2.0, "1/s²", "stiffness", 0.5, 6.0), **parameters}

    def flow(t, s, p):
        damping = getattr(p, "d", 0.0)
        return s[1], -p.k * s[0] - damping * s[1]

    return System(name, {x: "m", v: "m/s"}, made, [Mode("motion", flow)], start={x: start, v: 0.0})


@pytest.fixture
def pair():
    return {"plain": oscillator(), "damped": oscillator("damped oscillator", d=0.4)}


def keys(panel):
    return [control.key for control in panel.controls]


def test_one_set_of_sliders_for_the_parameters_of_both(pair):
    panel = explore(pair, 5.0, **PLAIN)
    assert keys(panel) == [
        *("p.k", "p.d", "start.x", "start.v"),
        *("t_end", "method", "rtol", "step"),
    ]
    assert panel.title == "plain, damped" and set(panel.run) == {"plain", "damped"}
    panel._set({"values": {"p.k": 5.0, "p.d": 1.0, "start.x": 0.5, "t_end": 4.0, "rtol": 1e-5}})
    plain, damped = panel.run.values()
    assert (plain.p.k, damped.p.k, damped.p.d) == (5.0, 5.0, 1.0)
    assert plain.start["x"] == damped.start["x"] == 0.5
    assert plain.t[-1] == damped.t[-1] == 4.0 and damped.options["rtol"] == 1e-5
    panel.check()


def test_the_picture_shows_both_and_its_verdict_is_of_each(pair):
    panel = explore(pair, 5.0, **PLAIN)
    view = panel.view.views[0]
    panel._set({"values": {"p.k": 4.0}})
    for panel_curves, name in zip(view._curves, ("x", "v"), strict=True):
        for (curve,), run in zip(panel_curves, panel.run.values(), strict=True):
            assert np.array_equal(curve.line.get_ydata(), run[name])
    assert [t.get_text() for t in view.axes[0].get_legend().get_texts()] == ["plain", "damped"]
    assert panel.words == "plain: finished at 5 s, no events; damped: finished at 5 s, no events"


def test_draw_and_verdict_get_the_runs_by_name(pair):
    def draw(runs):
        left, right = figure(1, 2).axes
        return [
            time_plot(runs, "x", axes=left),
            curves(right, lambda r: {"off": (r["plain"].t, r["damped"]["x"] - r["plain"]["x"])}),
        ]

    panel = explore(
        pair,
        5.0,
        draw,
        verdict=lambda r: f"{r['damped']['x'][-1] - r['plain']['x'][-1]:.3f}",
        **PLAIN,
    )
    off = panel.run["damped"]["x"] - panel.run["plain"]["x"]
    assert panel.words == f"{off[-1]:.3f}"
    assert np.array_equal(panel.view.views[1].drawn["off"].get_ydata(), off)


def test_what_differs_by_default_stays_each_its_own_until_its_slider_is_moved():
    pair = {
        "soft": oscillator(),
        "hard": oscillator(k=Parameter(3.0, "1/s²", "", 0.5, 6.0), start=2.0),
    }
    panel = explore(pair, 5.0, **PLAIN)
    assert [run.p.k for run in panel.run.values()] == [2.0, 3.0]
    assert [run.start["x"] for run in panel.run.values()] == [1.0, 2.0]
    slider = next(control for control in panel.controls if control.key == "p.k")
    assert slider.value == 2.0 and "by default 2, in hard 3" in slider.meaning
    panel._set({"values": {"p.k": 4.0}})
    assert [run.p.k for run in panel.run.values()] == [4.0, 4.0]
    assert [run.start["x"] for run in panel.run.values()] == [1.0, 2.0]
    panel._set({"values": {"p.k": 2.0}})  # moved, to where it began
    assert [run.p.k for run in panel.run.values()] == [2.0, 2.0] and "k=2.0" in panel.code()
    panel._set({"values": {}, "reset": True})
    assert [run.p.k for run in panel.run.values()] == [2.0, 3.0] and "k=" not in panel.code()
    given = explore(pair, 5.0, k=5.0, **PLAIN)
    assert [run.p.k for run in given.run.values()] == [5.0, 5.0]


def test_a_preset_is_for_all_models_also_with_the_default_of_one():
    pair = {"soft": oscillator(), "hard": oscillator(k=Parameter(3.0, "1/s²", "", 0.5, 6.0))}
    panel = explore(pair, 5.0, presets={"both soft": {"k": 2.0}}, **PLAIN)
    message = {"kind": "set", "values": panel.presets["both soft"], "reset": True}
    panel._receive(None, message, [])
    assert [run.p.k for run in panel.run.values()] == [2.0, 2.0]
    panel._receive(None, {"kind": "undo"}, [])
    assert [run.p.k for run in panel.run.values()] == [2.0, 3.0]


@pytest.mark.parametrize(
    "other, words",
    [
        ({"k": Parameter(2.0, "N/m", "", 0.5, 6.0)}, "parameter 'k' .*'1/s²'.*'N/m'"),
        ({"k": Parameter(2.0, "1/s²", "", 0.5, 9.0)}, "parameter 'k' .*6.0.*9.0"),
    ],
)
def test_one_name_for_two_things_is_refused(other, words):
    with pytest.raises(ModelError, match=words):
        explore({"a": oscillator(), "b": oscillator(**other)}, 5.0, **PLAIN)


def test_sliders_stand_in_the_order_of_their_list():
    """Also where the first one belongs to the second model only."""
    pair = {"a": oscillator("a"), "b": oscillator("b", z=Parameter(1.0))}
    made = explore(pair, 5.0, sliders=["z", "k"], **PLAIN)
    keys = [control.key for control in made.controls if control.group == "parameters"]
    assert keys == ["p.z", "p.k"]


def test_wrong_input_in_words(pair):
    with pytest.raises(ModelError, match="a dict of two or more"):
        explore({"a": oscillator()}, 5.0)
    with pytest.raises(ModelError, match="a dict of two or more"):
        explore({"a": oscillator(), "b": 3}, 5.0)
    with pytest.raises(ModelError, match="sliders names 'z', which none of plain, damped has"):
        explore(pair, 5.0, sliders=["z"], **PLAIN)
    with pytest.raises(ModelError, match="start names 'zz', which none of plain, damped has"):
        explore(pair, 5.0, start={"zz": 3.0}, **PLAIN)
    for d, words in [(-1e9, "outside its range"), ("abc", "'d' of preset 'p' must be a number")]:
        ranged = {**pair, "damped": oscillator("o", d=Parameter(0.4, "", "", 0.0, 1.0))}
        with pytest.raises(ModelError, match=words):
            explore(ranged, 5.0, presets={"p": {"d": d}}, **PLAIN)
    with pytest.raises(ModelError, match="cannot choose a system"):
        explore(pair, 5.0, choices={"m": {"a": {"system": oscillator()}}}, **PLAIN)
    both = {"a": oscillator(), "b": oscillator(states=("k2", "v2"), start=0.0, x=1.0)}
    with pytest.raises(ModelError, match="'x' is a parameter of one"):
        explore(both, 5.0, **PLAIN)


def test_sliders_of_one_model_only_and_choices_for_both(pair):
    panel = explore(
        pair,
        5.0,
        sliders={"d": (0.0, 1.0), "k": False, "x": False, "v": False},
        choices={"solver": {"fine": {"rtol": 1e-10}, "coarse": {"rtol": 1e-3}}},
        presets={"much": {"d": 0.9}},
        **PLAIN,
    )
    assert keys(panel)[:2] == ["choice.solver", "p.d"] and "p.k" not in keys(panel)
    panel._set({"values": {"choice.solver": "coarse"}})
    assert [run.options["rtol"] for run in panel.run.values()] == [1e-3, 1e-3]
    panel._set({"values": panel.presets["much"]})
    assert panel.run["damped"].p.d == 0.9


def test_models_without_a_common_state_are_stacked():
    pair = {"a": oscillator(), "b": oscillator("other", states=("y", "w"))}
    panel = explore(pair, 5.0, **PLAIN)
    assert all(isinstance(part, Only) for part in panel.view.views[:2])
    panel._set({"values": {"start.y": 3.0}})
    one, other = (part.view._curves[0][0][0].line.get_ydata()[0] for part in panel.view.views[:2])
    assert (one, other) == (1.0, 3.0)


def test_cursor_held_run_clicks_and_export(pair, tmp_path):
    def draw(runs):
        left, right = figure(1, 2).axes
        return [
            time_plot(runs, "x", axes=left),
            Only("plain", phase_portrait(runs["plain"], axes=right)),
        ]

    panel = explore(pair, 5.0, draw, **PLAIN)
    panel._cursor({"t": 2.0})
    at = {name: run.at(2.0)["x"] for name, run in panel.run.items()}
    assert list(panel.overlay.dots[0].get_ydata()) == list(at.values())
    assert "(plain)" in panel._reading() and "(damped)" in panel._reading()
    panel._hold({"on": True})
    ghost = panel.overlay.ghosts[0][0].get_ydata()
    held = np.concatenate([run["x"] for run in panel.run.values()])
    assert np.array_equal(ghost[np.isfinite(ghost)], held)
    panel.run.to_csv(tmp_path / "both.csv")
    assert {path.name for path in tmp_path.iterdir()} == {"both_plain.csv", "both_damped.csv"}
    assert panel._picture()[0]["span"] == [0.0, 5.0]
    said = [panel.export("csv", tmp_path) for _ in range(2)]  # nothing is written over
    assert all(path.exists() for text in said for path in map(Path, text[6:].split(", ")))
    assert len(set(tmp_path.iterdir())) == 6
    twins = explore(dict(zip(("A/b", "a b"), pair.values(), strict=True)), 5.0, **PLAIN)
    assert len(set(twins.run.files(tmp_path / "run.csv"))) == 2
    slow = explore({"so-called": pair["plain"], "b": pair["damped"]}, 5.0, **PLAIN)
    slow._cursor({"t": 2.0})  # minus signs are of numbers only
    assert "= −0.9" in slow._reading() and "(so-called)" in slow._reading()


def test_under_voila_the_files_of_all_runs_come_in_one(pair, monkeypatch):
    monkeypatch.setenv("SERVER_SOFTWARE", "voila/0.5")
    said, (data,) = explore(pair, 5.0, **PLAIN)._export({"what": "csv"})
    names = ["plain_damped_plain.csv", "plain_damped_damped.csv"]
    assert said["name"] == "runs.zip" and zipfile.ZipFile(io.BytesIO(data)).namelist() == names


def test_one_of_several_that_ends_before_the_others_stays_at_its_end(pair):
    ends = [Transition("motion", None, guard=lambda t, s, p: t - 1.0, direction=+1)]
    models = {**pair, "short": pair["plain"].variant("short", transitions=ends)}

    def draw(runs):
        return [Only("short", mode_diagram(models["short"], axes=figure().axes[0]))]

    panel = explore(models, 5.0, draw, **PLAIN)
    assert panel.run["short"].t[-1] == pytest.approx(1.0)
    panel._cursor({"t": 4.0})  # beyond the end of the one that is shown


def test_a_sketch_moves_with_each_of_several(pair):
    seen = []

    def mechanism(sketch, s):
        seen.append((s["plain"].x, s["damped"].x, s["damped"].p.d, s["plain"].t))
        sketch.ball((1 + s["plain"].x, 1), 0.2)

    def draw(runs):
        fig = figure(2, 1)
        diagram = mode_diagram(pair["plain"], axes=fig.axes[1])
        return [Motion(fig.axes[0], mechanism, 4, 2), Only("plain", diagram)]

    panel = explore(pair, 5.0, draw, **PLAIN)
    panel._cursor({"t": 2.0})
    runs = panel.run
    assert seen[-1] == (runs["plain"].at(2.0)["x"], runs["damped"].at(2.0)["x"], 0.4, 2.0)
