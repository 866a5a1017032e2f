"""`curves`: what one function gives is what stands in the picture, and it follows the run."""

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch

from labkit import Mode, ModelError, System, curves, explore, figure, simulate, time_plot
from labkit.draw.figure import DASHES
from labkit.draw.record import Scene

PLAIN = {"backend": "plain"}


@pytest.fixture
def system():
    return System(
        "oscillator",
        {"x": "m", "v": "m/s"},
        {"k": 2.0, "d": 0.3},
        [Mode("motion", lambda t, s, p: (s.v, -p.k * s.x - p.d * s.v))],
        start={"x": 1.0, "v": 0.0},
    )


@pytest.fixture
def run(system):
    return simulate(system, 10.0, **PLAIN)


def test_a_curve_is_what_the_function_gives_and_follows_the_run(run):
    view = curves(run, lambda run: {"r": (run.t, np.hypot(run["x"], run["v"])), "e": (run.t, 0.5)})
    line = view.drawn["r"]
    assert np.array_equal(line.get_xdata(), run.t)
    assert np.array_equal(line.get_ydata(), np.hypot(run["x"], run["v"]))
    assert np.array_equal(view.drawn["e"].get_ydata(), np.full(len(run.t), 0.5))
    other = run.again(k=9.0, t_end=14.0)
    view.update(other)
    assert view.drawn["r"] is line
    assert np.array_equal(line.get_ydata(), np.hypot(other["x"], other["v"]))
    assert view.axes.get_xlim() == (0.0, 14.0) and view.relimited  # time: as long as the run
    assert view.axes.get_ylim()[1] > np.hypot(other["x"], other["v"]).max()
    assert view.axes.get_xlabel() == "$t$ [s]"


def test_the_legend_names_what_has_a_name(run):
    view = curves(
        run,
        lambda run: {
            "a": (run.t, run["x"]),
            "_b": (run.t, run["v"]),
            "band": (run.t, -1.0, 1.0),
            "says": "words",
        },
        title="both",
    )
    assert [text.get_text() for text in view.axes.get_legend().get_texts()] == ["a", "band"]
    assert view.axes.get_title("left") == "both"
    alone = curves(run, lambda run: {"a": (run.t, run["x"])})
    assert alone.axes.get_legend() is None


def test_bands_lines_and_words(run):
    def what(run):
        return {
            "band": (run.t, run["x"] - 1, run["x"] + 1),
            "no": (None, -np.inf, -1.5),
            "rail": (None, (0.5, 0.7)),
            "bells": ((2.0, 3.0), None),
            "night": ((4.0, 6.0), None, None),
            "says": f"k = {run.p.k:g}",
        }

    view = curves(run, what, ylim=(-2.0, 2.0))
    inside = view.drawn["band"].get_path().contains_points
    t = run.t[100]
    assert inside([(t, run["x"][100] + 0.9), (t, run["x"][100] + 1.1)]).tolist() == [True, False]
    low = view.drawn["no"].get_path().vertices
    assert low[:, 1].max() == -1.5 and low[:, 1].min() < -2.0
    assert set(low[:, 0]) == {0.0, 1.0}  # all over the axes
    rail, bells = view.drawn["rail"], view.drawn["bells"]
    assert set(rail.get_ydata()[[0, 1, 3, 4]]) == {0.5, 0.7}
    assert rail.get_transform() == view.axes.get_yaxis_transform()
    assert set(bells.get_xdata()[[0, 1, 3, 4]]) == {2.0, 3.0}
    assert set(view.drawn["night"].get_path().vertices[:, 0]) == {4.0, 6.0}
    assert view.drawn["says"].get_text() == "k = 2"
    view.update(run.again(k=5.0))
    assert view.drawn["says"].get_text() == "k = 5"


def test_the_edge_of_a_band_without_end_follows_the_limits(run):
    view = curves(run, lambda run: {"no": (None, 0.5, np.inf), "x": (run.t, 3 * run["x"])})
    view.update(run.again(start={"x": 50.0}))
    assert view.drawn["no"].get_path().vertices[:, 1].max() > view.axes.get_ylim()[1] > 100


def test_an_area_is_a_closed_curve(run):
    turn = np.linspace(0, 2 * np.pi, 60)
    view = curves(run, lambda run: {"disc": (np.cos(turn), np.sin(turn))}, styles={"disc": "fill"})
    assert view.drawn["disc"].get_path().contains_points([(0, 0.9), (0.9, 0.9)]).tolist() == [1, 0]


def test_styles(run):
    view = curves(
        run,
        lambda run: {name: (run.t, run["x"]) for name in "abcde"},
        styles={"b": "o", "c": "k--", "d": "steps", "e": {"color": "red", "linewidth": 5}},
    )
    a, b, c, d, e = view.drawn.values()
    assert a.get_linestyle() == "-" and a.get_marker() == "None"
    assert b.get_marker() == "o" and b.get_linestyle() == "None" and b.get_markersize() == 4
    assert c.get_color() == "k" and c.get_linestyle() == "--"
    assert d.get_drawstyle() == "steps-post"
    assert e.get_color() == "red" and e.get_linewidth() == 5
    assert len({line.get_color() for line in (a, b, d)}) == 3
    plain = curves(run, lambda run: {name: (run.t, run["x"]) for name in "ab"})
    looks = [line.get_linestyle() for line in plain.drawn.values()]
    assert looks[0] == DASHES[0] and looks[1] != looks[0]  # also told apart in grey print


def test_logarithmic_axes_follow_by_decades_and_leave_out_what_has_no_logarithm(run):
    def what(run):
        return {"e": (run.t, np.where(run.t < 1, 0.0, np.exp(-run.p.k * run.t)))}

    view = curves(run, what, log="y")
    assert view.axes.get_yscale() == "log"
    low, high = view.axes.get_ylim()
    assert 1e-10 < low < np.exp(-20) and np.exp(-2) < high < 1
    view.update(run.again(k=4.0))
    assert view.axes.get_ylim()[0] < np.exp(-40)


def test_given_limits_stay(run):
    view = curves(run, lambda run: {"a": (run.t, run["x"])}, xlim=(0, 3), ylim=(-1, 1))
    view.update(run.again(start={"x": 50.0}))
    assert view.axes.get_xlim() == (0, 3) and view.axes.get_ylim() == (-1, 1)
    assert not view.relimited


def test_curves_come_and_go(run):
    def what(run):
        more = {"fast": (run.t, run["v"])} if run.p.k > 3 else {}
        return {"x": (run.t, run["x"]), **more}

    view = curves(run, what)
    scene = Scene(view)
    before = scene.picture(everything=True)[0]
    view.update(run.again(k=4.0))
    assert [text.get_text() for text in view.axes.get_legend().get_texts()] == ["x", "fast"]
    after = scene.picture()[0]
    count = [sum(name[0] == "m" for name in message["order"]) for message in (before, after)]
    assert count == [1, 2]
    view.update(run)
    assert len(view.drawn["fast"].get_xdata()) == 0


def test_in_a_panel_beside_a_time_plot(system):
    def draw(run):
        left, right = figure(1, 2).axes
        return [
            time_plot(run, "x", axes=left),
            curves(right, lambda run: {"r": (run.t, np.hypot(run["x"], run["v"]))}, log="y"),
        ]

    panel = explore(system, 10.0, draw, **PLAIN)
    picture = panel.view.views[1]
    panel._set({"values": {"p.k": 3.0}})
    x, v = panel.run["x"], panel.run["v"]
    assert panel.run.p.k == 3.0
    assert np.array_equal(picture.drawn["r"].get_ydata(), np.hypot(x, v))
    panel.check()
    # the time cursor and a held run reach it
    panel._cursor({"t": 5.0})
    show = next(show for show in panel.shows if show.axes is picture.axes)
    k = panel.shows.index(show)
    there = panel.run.at(5.0)
    x, y = panel.overlay.dots[k].get_data()
    assert list(x) == [5.0] and abs(y[0] - np.hypot(there["x"], there["v"])) < 1e-3
    panel._hold({"on": True})
    held = np.hypot(panel.run["x"], panel.run["v"])
    panel._set({"values": {"p.k": 2.0}})
    assert np.array_equal(panel.overlay.ghosts[k][0].get_ydata(), held)


def test_a_panel_of_curves_alone(system):
    def draw(run):
        return curves(figure().axes[0], lambda run: {"x": (run.t, run["x"])})

    panel = explore(system, 10.0, draw, **PLAIN)
    assert len(panel.view.views[0].drawn["x"].get_xdata()) == len(panel.run.t)


def test_a_plane_can_be_clicked(system):
    panel = explore(
        system,
        10.0,
        lambda run: curves(run, lambda run: {"path": (run["x"], run["v"])}, plane=("x", "v")),
        **PLAIN,
    )
    panel._picture()
    panel._start({"axes": 0, "x": 200, "y": 100})
    assert len(panel.begun) == 1 and set(panel.begun[0]) == {"x", "v"}


@pytest.mark.parametrize(
    "value, words",
    [
        (3.0, "curve 'a' is"),
        ((1.0, [1.0, 2.0], [1.0, 2.0, 3.0]), "curve 'a': x and y must be numbers of one length"),
        (([0.0, 1.0], "words"), "curve 'a': x and y must be numbers"),
        ((None, None), "curve 'a' gives None"),
    ],
)
def test_what_is_no_curve_is_refused_by_name(run, value, words):
    with pytest.raises(ModelError, match=words.replace("(", r"\(")):
        curves(run, lambda run: {"a": value})


def test_wrong_input_in_words(run):
    with pytest.raises(ModelError, match="gives name -> "):
        curves(run, lambda run: run.t)
    with pytest.raises(ModelError, match="styles names .b.,.* there are .a."):
        curves(run, lambda run: {"a": (run.t, 0.0)}, styles={"b": "o"})
    with pytest.raises(ModelError, match="the style of 'a', 'huh'"):
        curves(run, lambda run: {"a": (run.t, 0.0)}, styles={"a": "huh"})
    for value in ("words", (run.t, -1.0, 1.0)):
        with pytest.raises(ModelError, match="the style of 'a', .*colour"):
            curves(run, lambda run, value=value: {"a": value}, styles={"a": {"colour": "red"}})
    with pytest.raises(ModelError, match="log is"):
        curves(run, lambda run: {"a": (run.t, 0.0)}, log="z")
    with pytest.raises(ModelError, match="ylim is"):
        curves(run, lambda run: {"a": (run.t, 0.0)}, ylim=(2, 1))
    with pytest.raises(ModelError, match="twice"):
        ax = figure().axes[0]
        curves(ax, lambda run: {"a": (run.t, 0.0)}, axes=ax)
    assert isinstance(curves(run, lambda run: {"a": (run.t, 0)}).drawn["a"], Line2D)


def test_words_stay_words(run):
    def what(run):
        return {"a": "words" if run.p.k == 2.0 else (run.t, run["x"])}

    view = curves(run, what)
    with pytest.raises(ModelError, match="curve 'a' is .* the same kind at each run"):
        view.update(run.again(k=9.0))


def test_a_list_is_as_good_as_a_tuple(run):
    view = curves(run, lambda run: {"a": [run.t, run["x"]], "b": [run.t, run["x"], run["v"]]})
    assert view.axes.get_xlabel() and view.shows[0].names == ("a",)
    assert isinstance(view.drawn["b"], PathPatch)


@pytest.mark.parametrize("name", ["olive", "#009E73", "0.4"])
def test_a_style_may_be_any_name_of_a_colour(run, name):
    line = curves(run, lambda run: {"a": (run.t, run["x"])}, styles={"a": name}).drawn["a"]
    assert same_color(line.get_color(), name)
