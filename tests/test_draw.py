"""Pictures are tested on the data of their artists, and where it matters on pixels."""

import io
import math
import os
import re
import subprocess
import sys
import threading
import warnings
from collections import namedtuple
from dataclasses import replace
from math import sin
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.text import Text
from PIL import Image

from labkit.draw import (
    COLORS,
    Handle,
    Motion,
    Sketch,
    curves,
    figure,
    mode_colors,
    phase_portrait,
    planes,
    time_plot,
)
from labkit.draw.figure import PNG_BYTES, head, label, style, symbol
from labkit.draw.layers import (
    DirectionField,
    Equilibria,
    GuardLines,
    Nullclines,
    Trajectories,
    stage,
)
from labkit.draw.overlay import Overlay
from labkit.draw.plane import Plane, contour, find_equilibria, over_arrays, separatrices
from labkit.draw.private import Renderer, measure_as, reshape, tick_size, ticks_once
from labkit.draw.sketch import CHARACTERISTICS
from labkit.draw.ticks import Spaced, over_time, said
from labkit.draw.time import SHARED
from labkit.draw.view import Together
from labkit.draw.words import plain
from labkit.linear import classify
from labkit.model import Every, Mode, ModelError, Output, Parameter, System, Transition
from labkit.panel import explore
from labkit.run import Event, Run, Work
from labkit.solve import simulate

from .by_hand import lanes
from .helpers import ROOT

PLAIN = {"backend": "plain"}
BOX = ((-2.0, 2.0), (-2.0, 2.0))
WIDE = ((-1.0, 12.0), (-15.0, 15.0))


def alone(kind, system, *more, limits=BOX, **options):
    """One layer of a portrait over the first two states."""
    plane = Plane(system, **options)
    return kind(stage(plane, None, limits), plane, *more)


def linear(A, b=(0.0, 0.0)):
    (a11, a12), (a21, a22) = A
    return System(
        "linear",
        {"x": "m", "v": "m/s"},
        {"a11": a11, "a12": a12, "a21": a21, "a22": a22},
        [
            Mode(
                "motion",
                lambda t, s, p: (
                    p.a11 * s.x + p.a12 * s.v + b[0],
                    p.a21 * s.x + p.a22 * s.v + b[1],
                ),
            )
        ],
        start={"x": 1.0, "v": 0.0},
    )


@pytest.fixture
def ball():
    return System(
        "ball",
        {"y": "m", "v": "m/s"},
        {"g": Parameter(9.81, "m/s²"), "e": Parameter(0.8, "", "restitution", 0, 1)},
        [Mode("flight", lambda t, s, p: (s.v, -p.g))],
        [
            Transition(
                "flight",
                "flight",
                guard=lambda t, s, p: s.y,
                direction=-1,
                reset=lambda t, s, p: (0.0, -p.e * s.v),
                label="bounce",
            )
        ],
        start={"y": 10.0, "v": 0.0},
    )


@pytest.fixture
def block():
    """Sticks until k x reaches the limit, then slips with a constant force until it stands."""
    return System(
        "block",
        {"x": "m", "V": "m/s"},
        {"k": 2.0, "limit": 5.88, "slide": 4.0},
        [
            Mode("stick", lambda t, s, p: (2.0, 0.0)),
            Mode("slip", lambda t, s, p: (2.0 - s.V, p.k * s.x - p.slide)),
        ],
        [
            Transition(
                "stick",
                "slip",
                guard=lambda t, s, p: p.k * s.x - p.limit,
                direction=1,
                label="lets go",
            ),
            Transition(
                "slip",
                "stick",
                guard=lambda t, s, p: s.V,
                direction=-1,
                reset=lambda t, s, p: (s.x, 0.0),
                label="stands",
            ),
        ],
        start={"x": 0.0, "V": 0.0},
        mode=lambda t, s, p: "stick" if s.V <= 0 and p.k * s.x <= p.limit else "slip",
        outputs={
            "F": Output(
                {"stick": lambda t, s, p: p.k * s.x, "slip": lambda t, s, p: p.slide},
                "N",
                "friction",
            )
        },
    )


def made(system, t, mode_index, values, events=()):
    """A run written down by hand; an instant that stands twice is an event."""
    t = np.array(t, dtype=float)
    j = np.concatenate([[0], np.cumsum(np.diff(t) == 0)])
    ledger = [Event(when, "e", "a", "b", {}, {}, i) for i, when in enumerate(events)]
    return Run(
        system,
        system.values(),
        t,
        j,
        np.array(mode_index),
        np.array(values, dtype=float),
        ledger,
        "finished",
        Work(0, 0, 0, 0, len(ledger), 0.0, "hand", "hand"),
        np.zeros((0, 3)),
    )


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def segments(line):
    """The strokes of a line that is broken by NaN, as a list of arrays (k, 2)."""
    xy = np.column_stack(line.get_data()).astype(float)
    gaps = np.flatnonzero(np.isnan(xy).any(axis=1))
    return [
        part[~np.isnan(part).any(axis=1)]
        for part in np.split(xy, gaps)
        if len(part[~np.isnan(part).any(axis=1)])
    ]


# -- figure ----------------------------------------------------------------------------------------


def test_png_is_small_palette_and_the_same_each_time(ball):
    view = time_plot(simulate(ball, 5.0, **PLAIN), "y", "v")
    first = view.figure.png()
    assert (
        first
        == view.figure.png()
        == view._repr_png_()
        == time_plot(simulate(ball, 5.0, **PLAIN), "y", "v").figure.png()
    )
    assert len(first) <= PNG_BYTES
    assert Image.open(io.BytesIO(first)).mode == "P"
    assert b"tEXt" not in first and b"tIME" not in first and b"pHYs" not in first
    data, meta = view.figure._repr_mimebundle_()
    assert data["image/png"] == first and meta["image/png"] == {
        "width": view.figure.css_size[0],
        "height": view.figure.css_size[1],
        "alt": view.figure.alt,
    }


def test_png_has_the_same_bytes_in_another_process():
    code = (
        "from labkit.draw import figure; import hashlib; f = figure(); "
        "f.axes[0].plot([0, 1, 3], [0, 2, 1]); print(hashlib.sha256(f.png()).hexdigest())"
    )
    seen = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in "12"
    }
    assert len(seen) == 1


def test_png_keeps_backgrounds_and_curve_colours_exactly():
    fig = figure()
    fig.axes[0].plot([0, 1], [0, 1], linewidth=6)
    image = pixels(fig.png())
    assert (image[0, 0] == 255).all()
    colors = {tuple(c) for c in image.reshape(-1, 3)}
    assert tuple(int(COLORS[0][i : i + 2], 16) for i in (1, 3, 5)) in colors


@settings(max_examples=15, deadline=None)
@given(st.floats(1, 12), st.floats(0.5, 8))
def test_any_size_gives_a_picture_of_that_size(width, height):
    got = Image.open(io.BytesIO(figure(0, width=width, height=height).png())).size
    assert abs(got[0] - 120 * width) <= 1 and abs(got[1] - 120 * height) <= 1


def test_a_crowded_picture_still_fits():
    fig = figure(1, 1, width=9, height=6)
    rng = np.random.default_rng(1)
    for _ in range(60):
        fig.axes[0].plot(np.cumsum(rng.normal(size=60)), np.cumsum(rng.normal(size=60)))
    picture = pixels(fig.png())
    exact = np.asarray(Image.open(_saved(fig)).convert("RGB")).astype(int)
    assert np.abs(picture - exact).mean() < 4


def _saved(fig):
    buffer = io.BytesIO()
    fig.savefig(buffer, dpi=120)
    return buffer


def test_the_users_rcparams_are_neither_changed_nor_used(ball):
    before = dict(matplotlib.rcParams)
    run = simulate(ball, 3.0, **PLAIN)
    plain = time_plot(run).figure.png()
    phase_portrait(run).figure.png()
    Sketch().figure.png()
    assert dict(matplotlib.rcParams) == before
    # A panel may answer in a thread of its own while a cell draws.
    inside, tried = threading.Event(), threading.Event()

    def cell():
        with style():
            inside.set()
            tried.wait(0.2)  # the panel gets no further meanwhile

    def panel():
        inside.wait()
        with style():
            tried.set()

    threads = [threading.Thread(target=target) for target in (panel, cell)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert dict(matplotlib.rcParams) == before
    other = {
        "axes.facecolor": "black",
        "figure.facecolor": "black",
        "font.size": 20,
        "lines.linewidth": 9,
        "savefig.bbox": "tight",
        "axes.grid": False,
    }
    with matplotlib.rc_context(other):
        assert time_plot(run).figure.png() == plain


def test_pyplot_is_never_loaded():
    code = (
        "import sys, labkit.draw; from labkit.draw import figure; figure().png(); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_figure_refuses_nonsense(tmp_path):
    sizes = ({"width": 0}, {"height": 1e9}, {"rows": -1}, {"rows": 50, "columns": 50})
    parts = ({"sharex": "x"}, {"rows": 2, "heights": (1, -1)}, {"widths": (0,)})
    for bad in (*sizes, *parts):
        with pytest.raises(ModelError):
            figure(**bad)
    path = figure().save_png(tmp_path / "f.png")
    with Image.open(path) as picture:
        assert picture.size == (1080, 480)
    with pytest.raises(ModelError, match="cannot be written"):
        figure().save_png(tmp_path / "no" / "f.png")


def test_names_and_units_as_labels(block):
    assert (
        symbol("theta1") == r"$\theta_{1}$"
        and symbol("x") == "$x$"
        and symbol("iL") == "$i_{L}$"
        and symbol("omega_max") == r"$\omega_{\mathrm{max}}$"
    )
    assert label(block, "x", "V") == "$x$ [m], $V$ [m/s]" and label(block, "t") == "$t$ [s]"
    same = System(
        "two",
        {"a": "m", "b": "m"},
        modes=[Mode("m", lambda t, s, p: (0, 0))],
        start={"a": 0, "b": 0},
    )
    assert label(same, "a", "b") == "$a$, $b$ [m]"


def test_modes_keep_their_colours(block):
    assert mode_colors(block) == {"stick": COLORS[0], "slip": COLORS[1]}
    assert len(set(COLORS)) == len(COLORS)


# -- time plots ------------------------------------------------------------------------------------


def test_curve_breaks_at_jumps_and_jumps_are_dashed(ball):
    run = simulate(ball, 6.0, **PLAIN)
    view = time_plot(run, "y", "v")
    position, velocity = (panel[0][0] for panel in view._curves)
    assert len(segments(position.line)) == 1  # y goes on through a bounce
    strokes, jumps = segments(velocity.line), segments(velocity.jumps)
    assert len(run.events) == 3 and len(strokes) == 4 and len(jumps) == 3
    for event, jump in zip(run.events, jumps, strict=True):
        np.testing.assert_allclose(
            jump, [[event.t, event.before["v"]], [event.t, event.after["v"]]], rtol=1e-9
        )
    assert velocity.jumps.is_dashed() and not velocity.line.is_dashed()
    xs = np.concatenate([s[:, 0] for s in strokes])
    assert len(xs) == len(run.t)  # nothing lost


def test_pause_where_a_mode_lacks_the_state():
    torn = System(
        "torn",
        {"phi": "rad"},
        modes=[
            Mode("rod", lambda t, s, p: (1.0,)),
            Mode("free", lambda t, s, p: (2.0,), states={"z": "m"}),
        ],
        transitions=[Transition("rod", "free", at=Every(1.0), reset=lambda t, s, p: (s.phi,))],
        start={"phi": 0.0},
    )
    view = time_plot(
        made(
            torn,
            [0, 0.5, 1, 1, 1.5, 2],
            [0, 0, 0, 1, 1, 1],
            [[0], [0.5], [1], [7], [8], [9]],
            events=[1.0],
        ),
        "phi",
        "z",
    )
    phi, z = (panel[0][0] for panel in view._curves)
    np.testing.assert_array_equal(segments(phi.line)[0][:, 1], [0, 0.5, 1])
    np.testing.assert_array_equal(segments(z.line)[0][:, 0], [1, 1.5, 2])
    assert not segments(phi.jumps) and not segments(z.jumps)


def test_modes_colour_the_background(block):
    run = simulate(block, 12.0, **PLAIN)
    view = time_plot(run, "x", "F")
    assert len(run.events) > 3
    where = view._modes[0].patches
    for name, patch in zip(block.modes, where, strict=True):
        boxes = patch.get_path().vertices.reshape(-1, 5, 2)
        total = (boxes[:, 2, 0] - boxes[:, 0, 0]).sum()
        assert total == pytest.approx(np.diff(run.t)[run.mode[:-1] == name].sum(), rel=1e-9)
        assert np.all(boxes[:, 1, 1] == 1.0)
    handles = view.axes[0].get_legend().get_texts()
    assert [text.get_text() for text in handles] == ["stick", "slip"]
    assert (
        view.axes[1].get_ylabel() == "$F$ [N]"
        and view.axes[1].get_xlabel() == "$t$ [s]"
        and view.axes[0].get_xlabel() == ""
    )


def test_a_thousand_events_do_not_blacken_the_plot(block):
    t = np.repeat(np.linspace(0, 1, 1001), 2)[1:-1]
    run = made(
        block,
        t,
        (np.arange(len(t)) // 2) % 2,
        np.column_stack([np.sin(6 * t), np.cos(6 * t)]),
        events=np.linspace(0, 1, 1001)[1:-1],
    )
    view = time_plot(run, "x")
    marks = segments(view._events[0].line)
    assert len(marks) == 999 and all(mark[:, 1].min() > 0.95 for mark in marks)
    # So many modes are a mash of colours: the strip shows their shares of the time, here one half
    low, high = (patch.get_path().vertices[:, 1] for patch in view._modes[0].patches)
    assert low.min() == 0 and high.max() == pytest.approx(SHARED)
    np.testing.assert_allclose([low.max(), high.min()], SHARED / 2, rtol=0.06)
    assert view._modes[0].words.get_text() == "share of the time"
    empty = pixels(view.figure.png())
    assert (empty.min(axis=2) > 200).mean() > 0.85  # most of the picture stays white
    assert len(view.figure.png()) <= PNG_BYTES


def test_few_events_have_full_lines_and_may_be_left_out(ball):
    run = simulate(ball, 6.0, **PLAIN)
    marks = segments(time_plot(run, "y")._events[0].line)
    np.testing.assert_allclose([m[0, 0] for m in marks], [e.t for e in run.events])
    assert all(m[0, 1] == 0 and m[1, 1] == 1 for m in marks)
    assert time_plot(run, "y", events=False)._events == []


def test_update_changes_data_and_keeps_artists(ball):
    one, two = simulate(ball, 6.0, **PLAIN), simulate(ball, 6.0, e=0.5, **PLAIN)
    view = time_plot(one, "y", ("v",))
    artists, limits = list(view.artists), [ax.get_ylim() for ax in view.axes]
    children = [len(ax.get_children()) for ax in view.axes]
    view.update(two)
    assert view.artists == artists and [len(ax.get_children()) for ax in view.axes] == children
    assert not view.relimited and [ax.get_ylim() for ax in view.axes] == limits
    fresh = time_plot(two, "y", ("v",))
    for old, new in zip(view.artists, fresh.artists, strict=True):
        np.testing.assert_array_equal(old.get_xydata(), new.get_xydata())
    view.update(one)
    assert view.figure.png() == time_plot(one, "y", ("v",)).figure.png()


def test_limits_widen_when_data_leave_and_come_back(ball):
    view = time_plot(simulate(ball, 3.0, **PLAIN), "y")
    first = view.axes[0].get_xlim(), view.axes[0].get_ylim()
    view.update(simulate(ball, 9.0, start={"y": 80.0}, **PLAIN))
    assert view.relimited and view.axes[0].get_ylim()[1] > 80 and view.axes[0].get_xlim()[1] >= 9
    view.update(simulate(ball, 9.0, start={"y": 79.0}, **PLAIN))
    assert not view.relimited
    view.update(simulate(ball, 3.0, **PLAIN))
    assert view.relimited and (view.axes[0].get_xlim(), view.axes[0].get_ylim()) == first


def test_a_small_curve_is_followed_and_a_constant_stays_at_home():
    system = linear([[0, 1], [-1, 0]])

    def shown(size):
        view.update(simulate(system, 20.0, start={"x": size, "v": 0.0}))
        low, high = view.axes[0].get_ylim()
        moves.append(view.relimited)
        return low, high

    moves = []
    view = time_plot(simulate(system, 20.0, start={"x": 1.0, "v": 0.0}), "x")
    home = view.axes[0].get_ylim()
    assert all(shown(size) == home for size in (0.6, 0.3, 1.0))  # one sees it shrink and grow
    for size in (0.1, 0.01, 0.1):
        low, high = shown(size)
        assert 0.25 <= 2 * size / (high - low) <= 1, size  # a quarter of the axes at least
    assert shown(1.0) == home
    assert shown(1e-9) == home  # rounding is no curve
    moves.clear()
    for size in np.geomspace(1.0, 0.01, 100):  # a drag, a hundred pictures
        shown(size)
    assert sum(moves) <= 6


def test_a_users_zoom_is_left_alone(ball):
    view = time_plot(simulate(ball, 3.0, **PLAIN), "y")
    view.axes[0].set_ylim(4, 5)
    view.update(simulate(ball, 3.0, start={"y": 80.0}, **PLAIN))
    assert view.axes[0].get_ylim() == (4, 5)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30),
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30),
)
def test_finite_data_are_always_inside_the_limits(first, second):
    system = linear([[0, 1], [-1, 0]])
    runs = [
        made(system, np.arange(len(y)) + 1.0, np.zeros(len(y), dtype=int), np.column_stack([y, y]))
        for y in (first, second)
    ]
    view = time_plot(runs[0], "x")
    for run in runs:
        view.update(run)
        (x0, x1), (y0, y1) = view.axes[0].get_xlim(), view.axes[0].get_ylim()
        slack = 1e-6 * (y1 - y0)
        assert (
            x0 <= run.t.min()
            and run.t.max() <= x1
            and y0 - slack <= run["x"].min()
            and run["x"].max() <= y1 + slack
        )


def test_nothing_finite_is_no_crash(block):
    view = time_plot(made(block, [0, 1], [0, 0], [[np.nan, np.inf], [np.nan, np.inf]]), "x", "V")
    assert all(math.isfinite(v) for ax in view.axes for v in ax.get_ylim())
    view.figure.png()


def test_several_runs_and_labels(ball):
    runs = {f"e = {e}": simulate(ball, 4.0, e=e, **PLAIN) for e in (0.5, 0.9)}
    view = time_plot(runs, ("y", "v"))
    texts = [text.get_text() for text in view.axes[0].get_legend().get_texts()]
    assert texts == ["$y$", "$v$", "e = 0.5", "e = 0.9"]
    colors = [[curve.line.get_color() for curve in curves] for curves in view._curves[0]]
    assert colors == [[COLORS[0]] * 2, [COLORS[1]] * 2]
    view.update(list(runs.values())[::-1])
    np.testing.assert_array_equal(
        view._curves[0][0][0].line.get_ydata(),
        time_plot(runs["e = 0.9"], "y")._curves[0][0][0].line.get_ydata(),
    )
    with pytest.raises(ModelError, match="shows 2 run"):
        view.update(runs["e = 0.5"])


def test_many_lanes_are_one_line_with_gaps():
    system = linear([[0, 1], [-1, 0]])
    runs = lanes(
        system,
        np.array([0, 1, 2.0, 0, 1]),
        np.zeros(5, dtype=int),
        np.arange(10.0).reshape(5, 2),
        [3, 5],
    )
    strokes = segments(time_plot(runs, "x")._curves[0][0][0].line)
    assert [len(stroke) for stroke in strokes] == [3, 2]


def test_time_plot_refuses_nonsense(ball, block):
    run = simulate(ball, 1.0, **PLAIN)
    with pytest.raises(ModelError, match="neither a state nor an output"):
        time_plot(run, "z")
    with pytest.raises(ModelError, match="takes runs"):
        time_plot([1, 2])
    with pytest.raises(ModelError, match="empty"):
        time_plot([])
    with pytest.raises(ModelError, match="2 panel"):
        time_plot(run, "y", "v", axes=figure().axes)
    with pytest.raises(ModelError, match="made for 'ball'"):
        time_plot(run).update(simulate(block, 1.0, **PLAIN))


# -- type of an equilibrium ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("A", "kind"),
    [
        ([[-1, 0], [0, -3]], "stable node"),
        ([[1, 0], [0, 3]], "unstable node"),
        ([[-2, 0], [0, -2]], "stable star"),
        ([[2, 0], [0, 2]], "unstable star"),
        ([[-1, 0], [1, -1]], "stable improper node"),
        ([[1, 5], [0, 1]], "unstable improper node"),
        ([[-2, 1], [-1, -2]], "stable spiral point"),
        ([[0.1, 1], [-1, 0.1]], "unstable spiral point"),
        ([[0, 4], [-1, 0]], "centre"),
        ([[1, 0], [0, -2]], "saddle"),
        ([[1, 2], [2, 4]], "degenerate (line of equilibria)"),
        ([[0, 1], [0, 0]], "degenerate (line of equilibria)"),
        ([[0, 0], [0, 0]], "degenerate (all points)"),
        ([[-1, 0], [0, -1.00002]], "stable node"),
        ([[-1, 1e-4], [-1e-4, -1]], "stable spiral point"),
    ],
)
def test_classify(A, kind):
    assert classify(A) == kind
    for scale in (1e-12, 1e9):
        assert classify(scale * np.array(A, dtype=float)) == kind


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(
        [
            ([[-1, 0], [0, -3]], "stable node"),
            ([[2, 0], [0, 2]], "unstable star"),
            ([[-1, 0], [1, -1]], "stable improper node"),
            ([[-2, 1], [-1, -2]], "stable spiral point"),
            ([[0, 1], [-1, 0]], "centre"),
            ([[1, 0], [0, -2]], "saddle"),
        ]
    ),
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(-math.pi, math.pi),
)
def test_classify_is_unchanged_by_similarity(case, a, b, angle):
    A, kind = case
    G = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    S = G @ (np.eye(2) + np.outer([a, b], [b, -a]))  # det S = 1 for any a, b
    assert classify(S @ np.array(A, dtype=float) @ np.linalg.inv(S), tolerance=1e-8) == kind


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-5, 5), min_size=4, max_size=4))
def test_classify_agrees_with_the_eigenvalues(entries):
    A = np.array(entries).reshape(2, 2)
    values = np.linalg.eigvals(A)
    if (
        np.abs(A).max() < 1e-3
        or np.abs(values).min() < 1e-3
        or abs(values[0] - values[1]) < 1e-3
        or np.abs(values.real).min() < 1e-3
    ):
        return
    kind = (
        "spiral point"
        if abs(values[0].imag) > 0
        else "node"
        if values.real.prod() > 0
        else "saddle"
    )
    assert classify(A) == (
        "saddle"
        if kind == "saddle"
        else f"{'stable' if values.real.max() < 0 else 'unstable'} {kind}"
    )


def test_classify_refuses_nonsense():
    for bad in ([1, 2], np.eye(3), [[1, np.nan], [0, 1]]):
        with pytest.raises(ModelError, match="2 × 2"):
            classify(bad)
    with pytest.raises(ModelError, match="tolerance"):
        classify(np.eye(2), tolerance=-1)


# -- phase portraits -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("A", "kind"),
    [
        ([[1, 0], [0, -2]], "saddle"),
        ([[0, 1], [-4, 0]], "centre"),
        ([[-2, 1], [-1, -2]], "stable spiral point"),
        ([[-1, 0], [1, -1]], "stable improper node"),
        ([[-1.5, 0], [0, -1.5]], "stable star"),
    ],
)
def test_equilibrium_of_a_linear_system(A, kind):
    b = np.array([0.3, -0.7])
    ((x, v, mode, word),) = alone(Equilibria, linear(A, b)).found
    np.testing.assert_allclose([x, v], -np.linalg.solve(np.array(A, dtype=float), b), atol=1e-9)
    assert (mode, word) == ("motion", kind)


def test_equilibria_of_a_pendulum_with_math_functions():
    pendulum = System(
        "pendulum",
        {"phi": "rad", "w": "rad/s"},
        {"d": 0.3},
        [Mode("swing", lambda t, s, p: (s.w, -math.sin(s.phi) - p.d * s.w))],
        start={"phi": 1.0, "w": 0.0},
    )
    found = find_equilibria(Plane(pendulum), ((-7.0, 7.0), (-3.0, 3.0)))
    np.testing.assert_allclose([x for x, *_ in found], np.pi * np.arange(-2, 3), atol=1e-9)
    assert [kind for *_, kind in found] == ["stable spiral point", "saddle"] * 2 + [
        "stable spiral point"
    ]
    assert [
        kind
        for *_, kind in find_equilibria(
            Plane(pendulum, p=pendulum.values({"d": 0.0})), ((-1.0, 1.0), (-1.0, 1.0))
        )
    ] == ["centre"]


def test_no_equilibrium_where_there_is_none(ball):
    assert alone(Equilibria, ball, limits=((0.0, 10.0), (-10.0, 10.0))).found == []


@pytest.mark.parametrize(
    "force, expected",
    [
        (
            lambda x: (x - 0.3) ** 2 * (x + 1),
            [(-1.0, "stable spiral point"), (0.3, "degenerate (line of equilibria)")],
        ),  # where a saddle and a node meet
        (lambda x: x**3, [(0.0, "degenerate (line of equilibria)")]),
        (lambda x: 10 * math.sin(9 * x), None),
        (lambda x: x * x + 1e-3, []),
    ],
)
def test_equilibria_that_are_double_many_or_just_gone(force, expected):
    system = System(
        "spring",
        {"x": "m", "v": "m/s"},
        {},
        [Mode("motion", lambda t, s, p: (s.v, -force(s.x) - s.v))],
        start={"x": 1.0, "v": 0.0},
    )
    found = find_equilibria(Plane(system), ((-3.0, 3.0), (-4.0, 4.1)))
    if expected is None:
        expected = [
            (k * math.pi / 9, "saddle" if k % 2 else "stable spiral point") for k in range(-8, 9)
        ]
    assert [kind for *_, kind in found] == [kind for _, kind in expected]
    assert [x for x, *_ in found] == pytest.approx([x for x, _ in expected], abs=1e-7) and all(
        abs(v) < 1e-9 for _, v, *_ in found
    )


@pytest.mark.parametrize(
    "flow, expected",
    [
        (lambda t, s, p: (s.x**2, s.v**2), [(0.0, 0.0)]),
        (lambda t, s, p: (1 / s.x, s.v), []),
        (lambda t, s, p: (math.exp(3 * s.x) - 1, s.v), [(0.0, 0.0)]),
        (lambda t, s, p: (math.sqrt(s.x - 1) - 1, -s.v), [(2.0, 0.0)]),
        (lambda t, s, p: (s.v, math.copysign(1.0, s.x)), []),
    ],
)
def test_equilibria_of_awkward_flows_come_without_warnings(flow, expected):
    system = System(
        "awkward", {"x": "m", "v": "m/s"}, {}, [Mode("motion", flow)], start={"x": 1.0, "v": 0.0}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [(x, v) for x, v, *_ in find_equilibria(Plane(system), ((-3.0, 3.0), (-4.0, 4.1)))]
    assert np.array(found).ravel() == pytest.approx(np.array(expected).ravel(), abs=1e-6)


@pytest.mark.parametrize(
    "A", [((1, 2), (2, 4)), ((-1, 0.3), (2, -0.6)), ((0, 1), (0, -1)), ((0.1, 0.3), (0.2, 0.6))]
)
def test_a_line_of_equilibria_is_no_heap_of_marks(A):
    assert find_equilibria(Plane(linear(A)), ((-3.0, 3.0), (-4.0, 4.1))) == []


def test_only_the_equilibria_of_the_mode_that_holds(block):
    view = alone(Equilibria, block, limits=((-1.0, 5.0), (0.0, 6.0)))
    ((x, v, mode, kind),) = view.found
    assert (round(x, 9), round(v, 9), mode, kind) == (2.0, 2.0, "slip", "centre")
    view = alone(Equilibria, block, limits=((-1.0, 5.0), (0.0, 6.0)), mode="stick")
    assert view.found == []


def test_nullclines_lie_where_the_rates_vanish():
    system = System(
        "van der Pol",
        {"x": "", "v": ""},
        {"mu": 1.0},
        [Mode("m", lambda t, s, p: (s.v, p.mu * (1 - s.x**2) * s.v - s.x))],
        start={"x": 1, "v": 0},
    )
    layer = alone(Nullclines, system, limits=((-3.0, 3.0), (-4.0, 4.0)))
    flat, steep = (np.concatenate(segments(line)) for line in layer.lines)
    assert np.abs(flat[:, 1]).max() < 1e-12
    x, v = steep.T
    inside = np.abs(1 - x**2) > 0.3
    np.testing.assert_allclose(v[inside], (x / (1 - x**2))[inside], atol=0.05)
    assert len(segments(layer.lines[1])) == 3


def test_a_jump_through_zero_is_no_nullcline():
    plane_function = lambda x, y: np.where(x > 0.313, 1.0, -1.0)  # noqa: E731
    assert contour(plane_function, BOX) == []
    (line,) = contour(lambda x, y: x - 0.313, BOX)
    np.testing.assert_allclose(line[:, 0], 0.313, atol=1e-12)
    assert contour(lambda x, y: 0 * x, BOX) == []
    assert contour(lambda x, y: np.full(np.shape(x), np.nan), BOX) == []


def test_direction_field_points_along_the_flow_on_paper():
    system = linear([[0, 1], [-1, 0]])
    layer = alone(DirectionField, system, limits=((-2.0, 2.0), (-200.0, 200.0)))
    strokes = segments(layer.lines[0])
    assert len(strokes) >= 2 * 15 * 5
    lengths = []
    for (tail, tip), barbs in zip(strokes[::2], strokes[1::2], strict=True):
        np.testing.assert_array_equal(barbs[1], tip)
        x, v = (tail + tip) / 2
        flow, way = np.array([v / 4, -x / 400]), (tip - tail) / [4, 400]
        assert np.cross(np.append(flow, 0), np.append(way, 0))[2] == pytest.approx(
            0, abs=1e-9 * np.hypot(*flow)
        )
        assert flow @ way > 0
        lengths.append(np.hypot(way[0] * layer.shape, way[1]))
    assert np.ptp(lengths) < 1e-9


def test_field_shows_the_mode_that_holds(block):
    layer = alone(DirectionField, block, limits=((-1.0, 5.0), (-1.0, 6.0)))
    stick, slip = (np.concatenate(segments(line)) for line in layer.lines)
    assert (
        stick[:, 1].max() < 0.2 and slip[:, 1].min() > -0.5 and stick[:, 0].max() < 5.88 / 2 + 0.3
    )
    assert [line.get_color() for line in layer.lines] == [COLORS[0], COLORS[1]]


def test_functions_of_math_work_on_grids():
    def helper(x):
        return math.exp(-x * x)

    def smooth(t, s, p):
        return s.y * sin(s.x), helper(s.x) - math.sqrt(1 + s.y**2)

    def branching(t, s, p):
        return s.y, -1.0 if s.x > 0.1 else sin(s.x)

    X, Y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-2, 2, 9))
    wide = over_arrays(smooth)(0.0, SimpleNamespace(x=X, y=Y), None)
    np.testing.assert_allclose(
        wide, [Y * np.sin(X), np.exp(-X * X) - np.sqrt(1 + Y**2)], rtol=1e-14
    )
    for flow in (smooth, branching):
        plane = Plane(
            System("any", {"x": "", "y": ""}, {}, [Mode("m", flow)], start={"x": 0.5, "y": 0.5})
        )
        values = np.array(plane.flow("m", X, Y)).reshape(2, -1).T
        np.testing.assert_allclose(
            values,
            [
                flow(0.0, SimpleNamespace(x=x, y=y), None)
                for x, y in zip(X.flat, Y.flat, strict=True)
            ],
            rtol=1e-13,
        )


def test_vectorised_and_single_evaluation_agree(block):
    plane = Plane(block)
    X, Y = np.meshgrid(np.linspace(-1, 5, 12), np.linspace(-1, 5, 11))
    for mode in block.modes:
        f, g = plane.flow(mode, X, Y)
        one = np.array(
            [
                np.ravel(plane.flow(mode, x, y))
                for x, y in zip(X.ravel().tolist(), Y.ravel().tolist(), strict=True)
            ]
        )
        np.testing.assert_array_equal(np.column_stack([f.ravel(), g.ravel()]), one)
    branching = System(
        "b",
        {"x": "", "v": ""},
        modes=[Mode("m", lambda t, s, p: (math.sqrt(s.x), 1.0 if s.v > 0 else -1.0))],
        start={"x": 1, "v": 0},
    )
    f, g = Plane(branching).flow("m", X, Y)
    np.testing.assert_array_equal(np.isnan(f), X < 0)
    np.testing.assert_array_equal(g[X >= 0], np.where(Y > 0, 1.0, -1.0)[X >= 0])


def test_guard_lines_and_names(block):
    layer = alone(GuardLines, block, limits=((-1.0, 5.0), (-1.0, 6.0)))
    np.testing.assert_allclose(
        np.concatenate(segments(layer.lines["stick"]))[:, 0], 2.94, atol=1e-9
    )
    np.testing.assert_allclose(np.concatenate(segments(layer.lines["slip"]))[:, 1], 0.0, atol=1e-9)
    assert {text.get_text() for text in layer.words.values()} == {"lets go", "stands"}
    assert all(line.is_dashed() for line in layer.lines.values())


def test_trajectories_by_mode_with_dashed_jumps(ball, block):
    run = simulate(ball, 6.0, **PLAIN)
    layer = alone(Trajectories, run.system, run, limits=WIDE)
    assert len(segments(layer.lines[0])) == 4 and len(segments(layer.jumps)) == 3
    np.testing.assert_allclose(np.concatenate(segments(layer.jumps))[:, 0], 0, atol=1e-9)
    run = simulate(block, 12.0, **PLAIN)
    layer = alone(Trajectories, run.system, run, limits=WIDE)
    for name, line in zip(block.modes, layer.lines, strict=True):
        assert sum(map(len, segments(line))) == (run.mode == name).sum()
    assert not segments(layer.jumps)
    np.testing.assert_allclose(np.column_stack(layer.starts.get_data()), [[0, 0]])


def test_arrow_heads_point_along_the_trajectory():
    run = simulate(linear([[0, 1], [-1, 0]]), 6.0, **PLAIN)
    layer = alone(Trajectories, run.system, run)
    heads = layer.heads[0].get_path().vertices.reshape(-1, 4, 2)
    assert len(heads)
    for tip, left, right, *_ in heads:
        way, at = tip - (left + right) / 2, (tip + left + right) / 3
        assert way @ np.array([at[1], -at[0]]) > 0.9 * np.hypot(*way) * np.hypot(*at)  # clockwise


def test_a_run_that_ends_at_its_start_is_a_point():
    """Also where a longer one was shown before it: its heads go."""
    system = linear([[0, 1], [-1, 0]])
    layer = alone(Trajectories, system, simulate(system, 6.0, **PLAIN))
    stuck = simulate(system, 6.0, points=1, max_steps=1, rtol=1e-12, **PLAIN)
    stuck = replace(
        stuck,
        t=stuck.t[:1],
        j=stuck.j[:1],
        mode_index=stuck.mode_index[:1],
        values=stuck.values[:1],
        other=stuck.other[:1],
        part=stuck.part[:1],
    )
    layer.update(stuck)
    assert not len(layer.heads[0].get_path().vertices)
    np.testing.assert_allclose(np.column_stack(layer.starts.get_data()), [[1, 0]])


def test_portrait_of_many_and_update_with_other_parameters():
    system = linear([[-0.2, 1], [-1, -0.2]])
    view = phase_portrait(system, starts=12, horizon=4.0, limits=BOX, **PLAIN)
    assert [type(layer).__name__ for layer in view.layers] == [
        "DirectionField",
        "Nullclines",
        "Trajectories",
        "Separatrices",
        "Equilibria",
    ]
    assert (
        len(view.layers[2].starts.get_xdata()) == 12
        and view.equilibria[0][3] == "stable spiral point"
        and view.notes == []
    )
    children, artists = len(view.axes.get_children()), list(view.artists)
    view.update(simulate(system, 4.0, a11=0.2, a22=0.2, **PLAIN))
    assert view.equilibria[0][3] == "unstable spiral point" and not view.relimited
    assert len(view.axes.get_children()) == children and view.artists == artists
    fresh = phase_portrait(
        system, starts=12, horizon=4.0, limits=BOX, a11=0.2, a22=0.2, rtol=1e-8, **PLAIN
    )  # the tolerance of the run
    for mine, other in zip(
        view.layers[2].lines[0].get_segments(), fresh.layers[2].lines[0].get_segments(), strict=True
    ):
        np.testing.assert_allclose(mine, other, rtol=1e-12)
    assert view.figure.png() == fresh.figure.png()


def test_portrait_of_a_run_widens_and_the_field_follows(ball):
    view = phase_portrait(simulate(ball, 3.0, **PLAIN))
    assert [type(layer).__name__ for layer in view.layers] == [
        "DirectionField",
        "Nullclines",
        "GuardLines",
        "Trajectories",
        "Separatrices",
        "Equilibria",
    ]
    before = view.layers[0].lines[0].get_xydata().copy()
    view.update(simulate(ball, 3.0, start={"y": 9.0}, **PLAIN))
    assert not view.relimited
    np.testing.assert_array_equal(view.layers[0].lines[0].get_xydata(), before)
    view.update(simulate(ball, 6.0, start={"y": 40.0}, **PLAIN))
    assert view.relimited and view.axes.get_xlim()[1] > 40
    assert view.layers[0].lines[0].get_xydata()[:, 0].max() != before[:, 0].max()


def test_time_dependent_flow_is_said_and_has_no_nullclines():
    forced = System(
        "forced",
        {"x": "m", "v": "m/s"},
        {"w": 1.0},
        [Mode("m", lambda t, s, p: (s.v, math.sin(p.w * t) - s.x))],
        start={"x": 1.0, "v": 0.0},
    )
    view = phase_portrait(simulate(forced, 5.0, **PLAIN))
    assert [type(layer).__name__ for layer in view.layers] == ["DirectionField", "Trajectories"]
    assert "depends on time" in view.notes[0] and view.equilibria == []
    assert any("depends on time" in text.get_text() for text in view.axes.texts)


def test_a_larger_system_is_cut_at_its_start():
    three = System(
        "three",
        {"x": "m", "v": "m/s", "z": "N"},
        modes=[Mode("m", lambda t, s, p: (s.v, s.z - s.x, 0.0))],
        start={"x": 1.0, "v": 0.0, "z": 0.5},
    )
    view = phase_portrait(simulate(three, 5.0, **PLAIN))
    assert "other states" in view.notes[0] and view.equilibria == []
    f, g = Plane(three, at={"z": 2.0}).flow("m", np.array([1.0]), np.array([3.0]))
    assert (f[0], g[0]) == (3.0, 1.0)


def test_starts_beyond_a_guard_are_not_made_up(ball):
    view = phase_portrait(ball, starts=20, horizon=0.5, limits=((-5.0, 5.0), (-5.0, 5.0)), **PLAIN)
    runs = next(layer for layer in view.layers if type(layer).__name__ == "Trajectories")
    assert 0 < len(runs.starts.get_xdata()) < 20 and min(runs.starts.get_xdata()) >= 0


def test_a_portraits_trajectories_are_made_as_the_run_beside_them(ball):
    """Its method, tolerance, end time and mode; the portrait's own arguments come first."""
    run = simulate(ball, 3.0, method="Heun", step=0.01, **PLAIN)
    view = phase_portrait(run, starts={"y": [4.0, 8.0], "v": [0.0, 0.0]})
    made = next(part.runs for part in view.layers if part.artists and hasattr(part, "runs"))
    assert made[0].options["method"] == "Heun" and made[0].options["step"] == 0.01
    assert made[0].t[-1] == 3.0
    view.update(run.again(t_end=5.0, method="RK45", rtol=1e-4))
    made = next(part.runs for part in view.layers if hasattr(part, "runs"))
    like = run.again(t_end=5.0, method="RK45", rtol=1e-4, points=300, start={"y": 8.0})
    np.testing.assert_array_equal(made[1]["y"], like["y"])
    kept = phase_portrait(run, starts=[[4.0, 0.0]], horizon=1.0, method="RK4", step=0.1)
    kept.update(run.again(t_end=5.0, method="RK45"))
    made = next(part.runs for part in kept.layers if hasattr(part, "runs"))
    assert made[0].t[-1] == 1.0 and made[0].options["method"] == "RK4"


def test_a_portraits_trajectories_begin_in_the_mode_of_the_run():
    def to(rate):
        return lambda t, s, p: (s.v, rate - s.x)

    two = System(
        "two",
        {"x": "m", "v": "m/s"},
        {},
        [Mode("left", to(-1.0)), Mode("right", to(1.0))],
        start={"x": 0.0, "v": 0.0},
        mode="left",
    )
    run = simulate(two, 1.0, mode="right", **PLAIN)
    view = phase_portrait(run, starts=[[0.0, 0.0]])
    made = next(part.runs for part in view.layers if hasattr(part, "runs"))
    assert made[0].mode[0] == "right"
    np.testing.assert_allclose(made[0]["x"][-1], run["x"][-1], rtol=1e-9)


def test_a_portrait_follows_a_variant_of_its_system():
    def turning(sign):
        return System(
            "turning",
            {"x": "m", "v": "m/s"},
            {},
            [Mode("motion", lambda t, s, p: (s.v, sign * s.x))],
            start={"x": 1.0, "v": 0.0},
        )

    view = phase_portrait(simulate(turning(-1.0), 1.0, **PLAIN), limits=BOX)
    assert view.equilibria[0][3] == "centre"
    view.update(simulate(turning(1.0), 1.0, **PLAIN))
    assert view.equilibria[0][3].startswith("saddle")


def test_separatrices_of_a_pendulum_lie_on_its_energy():
    """Into and out of the upper rest: w²/2 − cos θ = 1, of which both halves are drawn."""
    pendulum = System(
        "pendulum",
        {"theta": "rad", "w": "rad/s"},
        {"d": 0.0},
        [Mode("motion", lambda t, s, p: (s.w, -sin(s.theta) - p.d * s.w))],
        start={"theta": 1.0, "w": 0.0},
    )
    limits = ((-5.0, 5.0), (-3.0, 3.0))
    into, out = separatrices(Plane(pendulum), limits)
    assert len(into) == len(out) == 4
    for curve in into + out:
        theta, w = curve.T
        assert np.abs(w**2 / 2 - np.cos(theta) - 1).max() < 1e-5
        assert abs(abs(theta[0]) - math.pi) < 1e-9 and w[0] == 0  # from a saddle
    assert max(np.ptp(curve[:, 0]) for curve in into) > 6.1  # to the other one
    view = phase_portrait(pendulum, limits=limits, starts=0, horizon=1.0, **PLAIN)
    layer = next(part for part in view.layers if type(part).__name__ == "Separatrices")
    assert [name for _, name in layer.legend()] == ["into the saddle", "out of the saddle"]
    alone = phase_portrait(
        pendulum, limits=((-1.0, 1.0), (-1.0, 1.0)), starts=0, horizon=1.0, **PLAIN
    )
    assert "into the saddle" not in [t.get_text() for t in alone.axes.get_legend().get_texts()]
    off = phase_portrait(pendulum, limits=limits, starts=0, horizon=1, separatrices=False, **PLAIN)
    assert all(type(part).__name__ != "Separatrices" for part in off.layers)


def test_separatrices_with_damping_split_the_ways():
    """A trajectory just below the curve into the saddle stays left of it, one just above passes."""
    pendulum = System(
        "pendulum",
        {"theta": "rad", "w": "rad/s"},
        {"d": 0.2},
        [Mode("motion", lambda t, s, p: (s.w, -sin(s.theta) - p.d * s.w))],
        start={"theta": 0.0, "w": 0.0},
    )
    into, _ = separatrices(Plane(pendulum), ((-1.0, 7.0), (-3.0, 3.0)))
    curve = next(curve for curve in into if curve[-1, 0] < 0)
    w = np.interp(0.0, curve[::-1, 0], curve[::-1, 1])
    for share, passes in ((0.999, False), (1.001, True)):
        run = simulate(pendulum, 30.0, start={"w": share * w}, **PLAIN)
        assert (run["theta"].max() > 4.0) == passes


def test_a_virtual_saddle_has_no_separatrices():
    """Beyond its own guard, where its mode does not hold; inside they end at the guard."""

    def system(rest):
        return System(
            "wall",
            {"x": "m", "v": "m/s"},
            {},
            [Mode("motion", lambda t, s, p: (s.v, s.x - rest))],
            [
                Transition(
                    "motion",
                    "motion",
                    guard=lambda t, s, p: s.x,
                    direction=-1,
                    reset=lambda t, s, p: (0.0, -s.v),
                )
            ],
            start={"x": 1.0, "v": 0.0},
        )

    assert separatrices(Plane(system(-1.0)), BOX) == ([], [])
    into, out = separatrices(Plane(system(1.0)), BOX)
    assert len(into) == len(out) == 2
    for curve in into + out:
        np.testing.assert_allclose(np.abs(curve[:, 0] - 1.0), np.abs(curve[:, 1]), atol=1e-6)
        assert curve[:, 0].min() > -0.1


def test_the_legend_lists_only_nullclines_that_are_there_and_follows():
    view = phase_portrait(linear([[-1, 0], [0, -1]], b=(0.0, 5.0)), starts=0, limits=BOX, horizon=1)
    names = [text.get_text() for text in view.axes.get_legend().get_texts()]
    assert names == ["d$x$/d$t$ = 0"]  # dv/dt = 0 lies outside
    view.update(simulate(view.system, 1.0, a22=-4.0, **PLAIN))
    assert view.relimited
    names = [text.get_text() for text in view.axes.get_legend().get_texts()]
    assert names == ["d$x$/d$t$ = 0", "d$v$/d$t$ = 0"]


def drawn(axes):
    """The boxes of the words on the x axis that are in sight, from left to right."""
    figure = axes.get_figure()
    figure.png()
    renderer, (low, high) = figure.canvas.get_renderer(), sorted(axes.get_xlim())
    labels = [
        text
        for at, text in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
        if low <= at <= high and text.get_text()
    ]
    return [text.get_window_extent(renderer) for text in labels]


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-5, 5),
    st.floats(-9, 5),
    st.floats(1.5, 9),
    st.sampled_from([1.0, 0.5, 0.3]),
    st.booleans(),
)
def test_numbers_on_an_axis_never_run_together(middle, power, width, scale, seconds):
    """Wide and narrow, zoomed in, and with large type: a figure made smaller, as in a classroom."""
    fig = figure(1, 1, width=max(width * scale, 1.5), height=2.0)
    axes = fig.axes[0]
    if seconds:
        over_time(axes, "$t$", "s")
    axes.set_xlim(middle, middle + 10.0**power)
    boxes = drawn(axes)
    assert all(b.x0 - a.x1 > 1 for a, b in zip(boxes, boxes[1:], strict=False))


def test_seconds_have_a_prefix_on_a_short_axis():
    fig = figure()
    axes = fig.axes[0]
    over_time(axes, "$t$", "s")
    for end, unit, last in ((20.0, "s", "20.0"), (0.02, "ms", "20.0"), (3e-5, "µs", "30")):
        axes.set_xlim(0, end)
        fig.png()
        assert axes.get_xlabel() == f"$t$ [{unit}]"
        shown = [text.get_text() for text in axes.get_xticklabels()]
        assert last in shown
    axes.set_xlabel("another")
    axes.set_xlim(0, 5.0)
    fig.png()
    assert axes.get_xlabel() == "another"  # an author's own
    over_time(axes, "$t$", "h")
    assert axes.get_xlabel() == "$t$ [h]"


def test_a_common_factor_is_a_power_of_ten():
    axes = figure().axes[0]
    axes.set_ylim(0, 3e-6)
    axes.get_figure().png()
    assert axes.yaxis.get_offset_text().get_text() == "×10⁻⁶"


def test_numbers_in_words():
    assert said(-1.25e-5) == "−1.25·10⁻⁵" and said(1e-4) == "0.0001" and said(1e6) == "10⁶"
    assert said(0.25) == "0.25" and said(-3) == "−3"


def heading(axes):
    """The title's own artist, which Matplotlib gives no public name on the left."""
    words = axes.get_title("left")
    return next(a for a in axes.get_children() if isinstance(a, Text) and a.get_text() == words)


def test_title_and_legend_never_lie_over_each_other(block):
    run = simulate(block, 12.0, **PLAIN)
    for width in (9.0, 4.0, 2.6):
        view = time_plot(run, ("x", "V", "F"), title="A block that sticks and slips", width=width)
        view.figure.png()
        for scale in (1.0, 1.4, 2.0):  # larger type: the panel makes the figure smaller
            view.figure.set_size_inches(max(width / scale, 1.0), 4.0 / scale)
            view.figure.png()
            renderer, axes = view.figure.canvas.get_renderer(), view.axes[0]
            title = heading(axes).get_window_extent(renderer)
            legend = axes.get_legend().get_window_extent(renderer)
            assert not title.overlaps(legend), (width, scale)


def test_a_title_gives_way_to_an_authors_legend():
    for width in (9.0, 3.0):
        fig = figure(width=width)
        axes = fig.axes[0]
        axes.plot([0, 1], [0, 1], label="a line with a long name")
        axes.set_title("The title of this picture", loc="left")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1))
        for _ in range(2):
            fig.png()
        renderer = fig.canvas.get_renderer()
        box = heading(axes).get_window_extent(renderer)
        assert not box.overlaps(axes.get_legend().get_window_extent(renderer)), width
        assert axes.lifted if width < 4 else not axes.lifted


def test_what_an_author_writes_at_the_head_stays(block):
    """Also when the picture gets another size; what is cleared away does not come back."""
    run = simulate(block, 12.0, **PLAIN)
    fig = figure(1, 2)
    titled, listed = (time_plot(run, "x", axes=axes).axes[0] for axes in fig.axes)
    titled.set_title("mine, of two lines", fontsize=8, color="red")
    listed.legend(listed.lines[:1], ["own"])
    for size in ((9.0, 4.0), (3.0, 3.0), (9.0, 4.0)):
        fig.set_size_inches(size)
        fig.png()
        words = heading(titled)
        assert " ".join(words.get_text().split()) == "mine, of two lines", size
        assert (words.get_fontsize(), words.get_color()) == (8, "red")
        assert [text.get_text() for text in listed.get_legend().get_texts()] == ["own"]
    titled.clear()
    titled.plot([0, 1], [0, 1])
    fig.set_size_inches(4.0, 3.0)
    fig.png()
    assert titled.get_title("left") == "" and titled.get_legend() is None
    assert isinstance(titled.xaxis.get_major_locator(), Spaced)


def test_a_label_has_the_room_that_no_other_label_needs():
    fig = figure(width=8.5)
    axes = fig.axes[0]
    fig.colorbar(axes.imshow([[0, 1]], aspect="auto"), ax=axes, label="$z$")
    words = "the duty of the transistor, as a part of the period of the clock [1]"
    axes.set_xlabel(words)
    fig.png()
    assert axes.get_xlabel() == words


LARGE = 20 / (9.5 * 96 / 72)  # a classroom: the smallest letters, 9.5 points, 20 pixels high


def crowd(fig, count):
    """Curves with a legend of so many entries over the first axes, labels on all."""
    for axes in fig.axes:
        axes.plot([0, 100], [0, 1])
        axes.set(xlabel="$t$ [s]", ylabel="$x$ [m]")
    lines = [(fig.axes[0].plot([0, 100], [0, k])[0], f"long name {k}") for k in range(count)]
    head(fig.axes[0], "the title of it", lines)


def test_a_legend_stays_off_the_head_of_a_lower_neighbour():
    """Axes of one scale end below those beside them, and their heads stand as high as these end."""
    fig = figure(1, 3, width=5.6, height=2.6)
    for axes in fig.axes:
        axes.set(xlim=(-5, 5), ylim=(-5, 5), xlabel="$s_1$ [rad/s]", ylabel="$s_2$ [rad]")
    for axes, names in zip(fig.axes, ["at", "e", "sf"], strict=True):
        named = {
            "a": "angle",
            "t": "at rest",
            "e": "eigenvectors",
            "s": "simulated",
            "f": "forbidden",
        }
        lines = [(axes.plot([0, 1])[0], named[name]) for name in names]
        title = {"a": "door", "e": "z-plane: canonical", "s": "s-plane"}[names[0]]
        if title != "door":
            axes.set_aspect("equal")
        head(axes, title, lines)
    fig.png()
    one, other = fig.axes[:2]
    assert other.bbox.y1 < one.bbox.y1
    words = [heading(other).get_window_extent(), other.get_legend().get_window_extent()]
    assert not any(box.overlaps(one.get_legend().get_window_extent()) for box in words)


def test_axes_of_one_scale_leave_the_words_around_them_in_the_picture():
    """Made smaller they find their place by and by: each layout counts on the empty room before."""
    fig = figure(1, 3, width=11.5, height=4.1)
    for k, axes in enumerate(fig.axes):
        axes.set(xlim=(-3, 3), ylim=(-3, 3), xlabel="$s_1$ [km]", ylabel="$s_2$ [km]")
        axes.set_aspect("equal")
        head(axes, "z-plane: canonical", [(axes.plot([0, 1])[0], "eigenvectors")] * (k > 0))
    fig.png()
    for zoom in (1.57, 1.2, 1.6, 1.0):
        fig.set_size_inches(11.5 / zoom, 4.1 / zoom)
        fig.png()
        for axes in fig.axes:
            box = axes.get_tightbbox()
            assert box.y0 > -1 and box.y1 < fig.bbox.y1 + 1, zoom


@pytest.mark.parametrize("columns, count", [(1, 2), (1, 7), (2, 3)])
def test_in_a_classroom_a_legend_leaves_the_axes_their_height(columns, count):
    """A panel 864 pixels wide on a page of 1280 × 720: 750 × 420 pixels, type twice as large."""
    fig = figure(1, columns, width=9.0, height=5.0)
    crowd(fig, count)
    fig.png()
    fig.set_size_inches(750 / 96 / LARGE, 420 / 96 / LARGE)
    fig.png()
    assert all(axes.get_position().height > 0.6 for axes in fig.axes)
    box = fig.axes[0].get_legend().get_window_extent()
    assert box.x1 <= fig.bbox.x1 and box.y0 >= 0
    assert not any(box.overlaps(axes.bbox.padded(-2)) for axes in fig.axes)
    widths = [axes.get_position().width for axes in fig.axes]
    assert max(widths) < 1.1 * min(widths)  # over its neighbour a legend takes no room from it


def test_a_long_name_in_a_legend_stays_off_its_neighbours():
    fig = figure(1, 2, width=5.0, height=3.0)
    long = "the current reaches zero in each period"
    for axes in fig.axes:
        head(axes, "", [(axes.plot([0, 1], label="_")[0], long)])
    fig.png()
    one, other = (axes.get_legend().get_window_extent() for axes in fig.axes)
    assert not one.overlaps(other) and other.x1 <= fig.bbox.x1
    assert f"curves {long}" in fig.alt


def test_words_stay_in_a_small_picture_and_apart():
    """Four axes on a telephone: titles and labels break, and low axes share the numbers below."""
    fig = figure(2, 2, width=9.0, height=5.0)
    for axes in fig.axes:
        axes.plot([0, 100], [0, 1])
        axes.set_title("distance of the second body")
        axes.set(xlabel="time since the first blow [ms]", ylabel="speed of the body [m/s]")
    fig.png()
    before = [axes.get_title("left") for axes in fig.axes]
    for side in (400, 900, 400):
        scale = min(1.0, 0.85 / (side / 864))
        fig.set_size_inches(9.0 / max(1 / scale, 1.6 if side == 400 else 1.0), 5.0 / 1.6)
        fig.png()
        boxes = []
        for axes in fig.axes:
            words = [heading(axes), axes.yaxis.label, axes.xaxis.label]
            boxes += [w.get_window_extent() for w in words if w.get_visible()]
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k]), side
        for box in boxes:
            assert box.x0 > -1 and box.y0 > -1 and box.x1 < fig.bbox.x1 + 1, side
    fig.set_size_inches(9.0, 5.0)
    fig.png()
    assert [axes.get_title("left") for axes in fig.axes] == before
    assert all(axes.xaxis.label.get_visible() for axes in fig.axes)


def test_a_label_without_numbers_is_left_to_the_axes_below():
    fig = figure(2, 1, sharex=True)
    for axes in fig.axes:
        axes.plot([0, 1], [0, 1])
        over_time(axes, "$t$", "s")
    fig.png()
    assert [axes.xaxis.label.get_visible() for axes in fig.axes] == [False, True]


def test_a_phase_portraits_legend_stays_beside_it(block):
    view = phase_portrait(simulate(block, 12.0, **PLAIN))
    view.figure.png()
    view.figure.png()
    legend = view.axes.get_legend()
    assert legend.get_window_extent().x0 >= view.axes.bbox.x1
    view.figure.set_size_inches(4.0, 3.0)
    view.figure.png()
    assert view.axes.get_legend().get_window_extent().y0 >= view.axes.bbox.y1 - 1


def test_words_of_a_sketch_give_way_to_each_other():
    """In large type a sketch is smaller, and its words would lie over each other."""
    fig = figure(1, 2, width=9.0, height=4.0)

    def two(sketch, s):
        sketch.text((2, 1.0), "force kept")
        sketch.text((2, 0.7), "torque kept")

    moving = Motion(fig.axes[0], two, 4, 2)
    moving.update(simulate(linear([[0, 1], [-1, 0]]), 1.0, **PLAIN))
    for scale in (1.0, 2.4, 1.0):
        fig.set_size_inches(9.0 / scale, 4.0 / scale)
        fig.png()
        one, other = moving.pieces.all
        assert not one.get_window_extent().overlaps(other.get_window_extent()), scale
        assert (one.get_fontsize() == 12.0) == (scale == 1.0)


def test_between_powers_of_ten_numbers_have_room():
    fig = figure(width=4.0, height=2.0)
    axes = fig.axes[0]
    axes.set_xscale("log")
    for low, high, shown in (
        (0.018, 0.43, {"2·10-2", "5·10-2", "2·10-1"}),
        (3.2, 7.9, {"4", "5", "6", "7"}),
        (3.2, 3.47, {"3.2", "3.25", "3.3", "3.35", "3.4", "3.45"}),
        (1.0, 1e3, set()),
    ):
        axes.set_xlim(low, high)
        fig.png()
        ticks = [t for t in axes.xaxis.get_minorticklabels() if t.get_text()]
        ticks = [t for t in ticks if axes.bbox.x0 <= t.get_window_extent().x1 <= axes.bbox.x1 + 30]
        inside = [t for t in ticks if low <= t.get_position()[0] <= high]
        assert {plain(t.get_text()).replace("×", "·") for t in inside} == shown
        boxes = [t.get_window_extent() for t in inside]
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_the_legend_has_the_colours_of_the_bands_and_of_the_strip(block):
    """In the saved picture too, with its few colours."""
    view = time_plot(simulate(block, 12.0, **PLAIN), "x")

    def samples():
        return view.axes[0].get_legend().legend_handles

    image = pixels(view.figure.png()).reshape(-1, 3)
    colors, counts = np.unique(image, axis=0, return_counts=True)
    for patch, sample in zip(view._modes[0].patches, samples(), strict=True):
        r, g, b, alpha = patch.get_facecolor()
        over_white = 1 - alpha * (1 - np.array([r, g, b]))
        np.testing.assert_allclose(sample.get_facecolor()[:3], over_white, atol=1e-9)
        assert counts[np.abs(colors - 255 * over_white).max(axis=1) < 1.5].sum() > 1000
    before = [sample.get_facecolor() for sample in samples()]
    view.update(simulate(block, 400.0, **PLAIN))  # now a strip
    assert view.relimited
    for color, old, sample in zip(mode_colors(block).values(), before, samples(), strict=True):
        np.testing.assert_allclose(
            sample.get_facecolor()[:3], 1 - 0.8 * (1 - np.array(to_rgb(color)))
        )
        assert sample.get_facecolor() != old


def test_names_of_guards_lie_on_no_other_line():
    relay = System(
        "relay",
        {"x": "m", "v": "m/s"},
        {"a": 0.3},
        [
            Mode("up", lambda t, s, p: (s.v, 1.0 - s.v)),
            Mode("down", lambda t, s, p: (s.v, -1.0 - s.v)),
        ],
        [
            Transition("up", "down", lambda t, s, p: s.x - p.a, direction=1, label="switch up"),
            Transition("down", "up", lambda t, s, p: s.x + p.a, direction=-1, label="switch down"),
        ],
        start={"x": 0.0, "v": 0.0},
        mode=lambda t, s, p: "up" if s.x < 0 else "down",
    )
    for a in (0.3, 0.05, 1.0):
        run = simulate(relay, 12.0, a=a, **PLAIN)
        view = phase_portrait(run, direction_field=False)
        view.figure.png()
        renderer = view.figure.canvas.get_renderer()
        guards = next(part for part in view.layers if type(part).__name__ == "GuardLines")
        boxes = [text.get_window_extent(renderer) for text in guards.words.values()]
        assert len(boxes) == 2 and not boxes[0].overlaps(boxes[1])
        path = view.axes.transData.transform(np.column_stack([run["x"], run["v"]]))
        for box in boxes:
            assert not ((path > box.min) & (path < box.max)).all(axis=1).any()
            for edge in (-a, a):
                at = view.axes.transData.transform((edge, 0))[0]
                assert not box.x0 < at < box.x1, (a, edge)


def test_a_picture_says_in_words_what_it_shows(ball, block):
    run = simulate(ball, 3.0, **PLAIN)
    view = time_plot(run, "y")
    assert view.figure.alt == (
        f"ball: y [m] over t [s]; 0 to 3 across, {said(view.axes[0].get_ylim()[0], 3)} to "
        f"{said(view.axes[0].get_ylim()[1], 3)} up; 1 event"
    )
    assert view._repr_mimebundle_()[1]["image/png"]["alt"] == view.figure.alt
    text = time_plot(simulate(block, 5.0, **PLAIN), ("x", "V")).figure.alt
    assert "x [m], V [m/s] over t [s]; " in text and "curves x, V; modes stick, slip; " in text
    portrait = phase_portrait(simulate(block, 5.0, **PLAIN))
    assert (
        portrait.figure.alt.startswith("block: V [m/s] over x [m]; ")
        and "lets go" in portrait.figure.alt
    )
    sketch = Sketch(4, 2)
    sketch.block((2, 1), 1, 1, "$m_{1}$")
    assert sketch.figure.alt == "in words: m1"
    distance = curves(run, lambda run: {"r": (run.t, np.abs(run["v"]) + 1.0)}, log="y")
    assert "logarithmic in y" in distance.figure.alt
    panel = explore(ball, 3.0, lambda run: time_plot(run, "y"), **PLAIN)
    assert panel.spec["alt"].startswith("ball: y [m] over t [s]; ")
    short = time_plot(simulate(ball, 0.02, **PLAIN), "y")
    short.figure.png()
    assert "over t [ms]; 0 to 20 across" in short.figure.alt


def test_formulas_in_plain_words():
    assert plain(r"$\theta_{1}$ [rad/s]") == "θ1 [rad/s]"
    assert plain(r"d$x$/d$t$ = 0") == "dx/dt = 0"
    assert plain(r"$\mathrm{mass} \leq \frac{a}{b}$") == "mass ≤ a/b"


# -- what is private in Matplotlib: each name that labkit/draw/private.py uses


def test_set_path_still_needs_to_be_told():
    """When this fails, Matplotlib has mended it, and `reshape` may go."""
    patch = PathPatch(Path([(0, 0), (1, 1)]))
    patch.stale = False
    reshape(patch, Path([(0, 0), (2, 2)]))
    assert patch.stale and patch.get_path().vertices.max() == 2


def test_the_size_of_numbers_is_that_of_the_labels():
    axes = figure().axes[0]
    axes.tick_params(labelsize=13)
    assert tick_size(axes.xaxis) == 13 == axes.get_xticklabels()[0].get_size()


def test_words_and_lines_are_measured_as_matplotlib_does():
    ours, theirs = Renderer(100, 100, 120), RendererAgg(100, 100, 120)
    prop = FontProperties(size=11)
    for words, formula in (("many words", False), (r"$\frac{a}{b}$", True)):
        for _ in range(2):  # the second time from memory
            got = ours.get_text_width_height_descent(words, prop, formula)
            assert got == theirs.get_text_width_height_descent(words, prop, formula)
    fig = figure()
    many = fig.text(0.5, 0.5, "two\nlines", fontproperties=prop)
    assert many.get_window_extent(ours).bounds == many.get_window_extent(theirs).bounds
    other = SimpleNamespace()
    measure_as(other, ours)
    assert other.get_text_width_height_descent("many words", prop, False)[0] > 0


def test_ticks_are_found_once_in_a_drawing_and_are_those_of_matplotlib(monkeypatch):
    def made():
        fig = figure(2, 1, sharex=True, title="two")
        for k, axes in enumerate(fig.axes):
            axes.plot([0, 1], [0, 1e6 * k + 1])
            axes.set(title="a title", xlabel="$t$", ylabel="$x$", aspect="auto" if k else 0.5)
        first = fig.png()
        fig.axes[0].set_ylim(0, 7)  # what is new is seen
        return fig, [first, fig.png(), fig.axes[0].get_tightbbox().bounds]

    fig, ours = made()
    found, find = [], Axis._update_ticks
    monkeypatch.setattr(Axis, "_update_ticks", lambda axis: found.append(axis) or find(axis))
    for axes in fig.axes:
        axes.draw(fig.canvas.get_renderer())
    assert len(found) == len(set(found)) == 4
    for name in ("draw", "get_tightbbox"):
        monkeypatch.setattr(type(fig.axes[0]), name, getattr(Axes, name))
    theirs = made()[1]
    assert [one == other for one, other in zip(ours, theirs, strict=True)] == [True] * 3
    assert ours[0] != ours[1]


def test_a_canvas_keeps_its_renderer_until_its_size_changes():
    fig = figure()
    first = fig.canvas.get_renderer()
    assert isinstance(first, Renderer) and fig.canvas.get_renderer() is first
    fig.set_size_inches(3, 2)
    second = fig.canvas.get_renderer()
    assert second is not first and (second.width, second.height) == (360, 240)


def test_private_names_of_matplotlib_stand_in_one_file():
    folder = ROOT / "labkit"
    names = (
        "_get_font_height",
        "_lastKey",
        "_get_tick_label_size",
        "_update_ticks",
        "_unscaled_dash",
        "_left_title",
        "_set_title_offset_trans",
    )
    for file in folder.rglob("*.py"):
        if file != folder / "draw" / "private.py":
            text = file.read_text(encoding="utf-8")
            assert not [name for name in names if name in text], file
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for package in ("matplotlib", "numba"):
        assert re.search(rf'"{package}>=[\d.]+,<[\d.]+', project), package


def test_a_name_that_is_both_option_and_parameter_is_refused():
    tank = System(
        "tank",
        {"x": "m", "v": "m/s"},
        {"height": 2.0, "width": 1.0, "limits": 0.0, "at": 1.0, "verdict": 3.0, "sliders": 1.0},
        [Mode("m", lambda t, s, p: (s.v, -p.height * s.x))],
        start={"x": 1.0, "v": 0.0},
    )
    run = simulate(tank, 1.0, height=3.0, **PLAIN)
    assert phase_portrait(run).plane.p.height == 3.0
    for call in (
        lambda: phase_portrait(tank, horizon=1.0, height=3.0),
        lambda: phase_portrait(run, at=3.0),
        lambda: time_plot(run, "x", width=3.0),
        lambda: curves(run, lambda run: {}, height=3.0),
        lambda: planes(run, None, height=2.0),
        lambda: explore(tank, 1.0, sliders=0.3),
        lambda: explore(system=tank, horizon=1.0, verdict=0.3),
    ):
        with pytest.raises(ModelError, match="is an option of .* and a parameter of 'tank'"):
            call()


def test_views_in_two_figures_are_refused(ball):
    run = simulate(ball, 1.0, **PLAIN)
    with pytest.raises(ModelError, match="view 2 of 2, TimePlot, was drawn into another figure"):
        Together(time_plot(run, "y"), time_plot(run, "v"))


def test_portrait_refuses_nonsense(ball):
    with pytest.raises(ModelError, match="not a state"):
        phase_portrait(ball, "y", "w", horizon=1.0)
    with pytest.raises(ModelError, match="horizon"):
        phase_portrait(ball)
    with pytest.raises(ModelError, match="not a parameter"):
        phase_portrait(ball, horizon=1.0, zz=3.0)
    with pytest.raises(ModelError, match="limits"):
        phase_portrait(ball, horizon=1.0, limits=((1.0, 0.0), (0.0, 1.0)))
    with pytest.raises(ModelError, match="mode 'x'"):
        phase_portrait(ball, horizon=1.0, mode="x")
    with pytest.raises(ModelError, match="'v'"):
        phase_portrait(ball, horizon=1.0, starts={"y": [1.0]})
    with pytest.raises(ModelError, match="shape"):
        phase_portrait(ball, horizon=1.0, starts=np.zeros((3, 3)))
    with pytest.raises(ModelError, match="starts needs arrays of one length"):
        phase_portrait(ball, horizon=1.0, starts={"y": [1.0, 2.0, 3.0], "v": [0.0, 1.0]})
    with pytest.raises(ModelError, match="two states"):
        phase_portrait(ball, "y", "y", horizon=1.0)
    one = System("one", {"x": "m"}, modes=[Mode("m", lambda t, s, p: (0.0,))], start={"x": 0.0})
    with pytest.raises(ModelError, match="two states"):
        phase_portrait(one, horizon=1.0)


def test_the_portrait_of_a_run_keeps_its_parameters_beside_those_that_are_given(ball):
    view = phase_portrait(simulate(ball, 2.0, e=0.5, **PLAIN), g=1.6)
    assert view.plane.p == ball.values({"e": 0.5, "g": 1.6})


def test_an_error_of_the_model_is_not_blamed_on_an_option():
    broken = [Mode("m", lambda t, s, p: (s.v, {}["k"]) if s.x > 2 else (s.v, -s.x))]
    system = System("broken", {"x": "m", "v": "m/s"}, {}, broken, start={"x": 1.0, "v": 0.0})
    with pytest.raises(KeyError):
        phase_portrait(system, starts=9, horizon=1.0, limits=((-4, 4), (-4, 4)), **PLAIN)


def test_a_handle_names_what_the_model_has(ball):
    with pytest.raises(ModelError, match="names 'h', no parameter or state of 'ball'; .*'e'"):
        Handle(figure().axes[0], "y", "h").update(simulate(ball, 1.0, **PLAIN))


def test_a_click_starts_trajectories_of_the_models_that_have_the_plane(ball):
    other = linear([[0, 1], [-1, 0]])
    runs = {"ball": simulate(ball, 1.0, **PLAIN), "other": simulate(other, 1.0, **PLAIN)}
    view = phase_portrait(runs["ball"])
    overlay = Overlay(view.shows)
    overlay.add([runs])
    assert len(overlay.starts[0].get_xdata()) == 1


# -- sketches --------------------------------------------------------------------------------------


def test_sketch_pieces_meet_at_their_points():
    s = Sketch(8, 3)
    m = s.block((2.5, 1.1), 1.4, 1.0, "$m$")
    np.testing.assert_allclose(
        [m.right, m.top, m.bottom, m.left], [(3.2, 1.1), (2.5, 1.6), (2.5, 0.6), (1.8, 1.1)]
    )
    k = s.spring(m.right, (6.0, 1.1), "$k$")
    assert k.start == m.right and k.end == (6.0, 1.1)
    np.testing.assert_allclose(k.middle, (4.6, 1.1))
    line = s.axes.lines[-1]
    np.testing.assert_allclose([line.get_xydata()[0], line.get_xydata()[-1]], [m.right, (6.0, 1.1)])
    bob = s.pendulum((3, 2.6), 1.0, 30)
    np.testing.assert_allclose(bob.center, (3 + 0.5, 2.6 - math.sqrt(3) / 2))
    up = s.pendulum((3, 0.5), 1.0, 180)
    np.testing.assert_allclose(up.center, (3, 1.5))


def test_every_piece_draws_inside_and_leaves_ink():
    s = Sketch(8, 4)
    before = (pixels(s.figure.png()) < 250).sum()
    s.ground((0.5, 0.5), (7.5, 0.5))
    s.wall((0.5, 0.5), 3.0)
    s.block((2, 1), 1, 1, "$m$")
    s.spring((0.5, 1.2), (1.5, 1.2), "$c$")
    s.damper((0.5, 0.8), (1.5, 0.8), "$r$", side="below")
    s.arrow((2.5, 1), (3.2, 1), "$F$")
    s.axis((2, 1.8), (3, 1.8), "$x$")
    s.dimension((4, 1), (5, 1), "$L$", offset=0.3)
    s.dimension((4, 2), (4, 3), "$H$")
    s.rod((5, 3), (6, 2), "$l$")
    s.pendulum((6.5, 3.5), 1.5, -25, "$\\varphi$", bob="$m$")
    s.sum((1, 3))
    s.integrator((2, 3))
    s.connect((1.16, 3), (1.65, 3), label="$e$")
    s.switch((3, 3.2), (4, 3.2), "$S$")
    s.text((5, 3.7), "words")
    for i, kind in enumerate(CHARACTERISTICS):
        s.characteristic((0.8 + i, 2.2), kind, 0.8, 0.6)
    image = pixels(s._repr_png_())
    assert (image < 250).sum() > before + 20_000
    edge = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert (edge == 255).all()  # nothing is cut off


def test_connection_turns_at_right_angles():
    s = Sketch()
    s.connect((1, 1), (3, 2), dot=True)
    points = s.axes.lines[-1].get_xydata()
    np.testing.assert_allclose(points, [(1, 1), (3, 1)])
    np.testing.assert_allclose(s.axes.patches[0].get_path().vertices[0], (3, 1), atol=1e-6)


def test_sketch_refuses_nonsense():
    s = Sketch()
    with pytest.raises(ModelError, match="pair"):
        s.block((1, float("nan")), 1, 1)
    with pytest.raises(ModelError, match="two different points"):
        s.spring((1, 1), (1, 1))
    with pytest.raises(ModelError, match="hysteresis"):
        s.characteristic((1, 1), "relais")
    with pytest.raises(ModelError, match="nothing to update"):
        s.update(None)
    with pytest.raises(ModelError, match="side of a label is 'end', 'above' or 'below'"):
        s.arrow((1, 1), (2, 1), "$F$", side="left")
    with pytest.raises(ModelError, match="side of wall must be 'left' or 'right'"):
        s.wall((1, 1), 2.0, side="up")
    with pytest.raises(ModelError, match="label of text must be a text, not 5"):
        s.text([1, 1], 5)
    with pytest.raises(ModelError, match="width of block must be a number"):
        s.block((1, 1), "wide", 1.0)
    for piece in (s.line, s.connect):
        with pytest.raises(ModelError, match="needs 2 points, not 1"):
            piece((1, 1))
    with pytest.raises(ModelError, match="draw of Motion must be a function of a sketch and s"):
        Motion(figure().axes[0], lambda sketch: None)


def test_a_point_from_a_named_tuple_or_array_is_fine():
    P = namedtuple("P", "x y")
    assert Sketch().spring(P(1, 1), np.array([2.0, 1.0])).start == (1, 1)


def test_later_titles_and_legends_have_the_house_style():
    fig = figure()
    axes = fig.axes[0]
    axes.plot([0, 1], label="curve")
    axes.set(title="late")
    assert axes.get_title(loc="left") == "late" and not axes.legend().get_frame_on()
    polar = fig.add_subplot(projection="polar")
    assert polar.name == "polar" and polar.plot([0, 1], [0, 1])[0].get_color() == "#0072B2"


def test_png_leaves_the_figure_as_it_was(ball):
    fig = time_plot(simulate(ball, 2.0), "y").figure
    engine, first = fig.get_layout_engine(), fig.png()
    assert Image.open(io.BytesIO(fig.png(200.0))).size == tuple(
        200 * side for side in fig.get_size_inches()
    )
    assert (
        fig.get_layout_engine() is engine is not None
        and fig.dpi == 120
        and not fig.frozen
        and fig.png() == first
    )
    place = fig.axes[0].bbox.bounds
    fig.axes[0].set_ylabel("two\nlines")
    assert fig.png() != first and fig.axes[0].bbox.bounds[0] > place[0]  # laid out anew


# ---- colours


# Full loss of one kind of cone, on linear RGB: Machado, Oliveira and Fernandes (2009), severity 1.
EYES = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}


def cielab(color, eyes):
    """CIE L*, a*, b* (D65) of a colour as those eyes see it."""
    rgb = np.array(to_rgb(color))
    linear_rgb = np.clip(
        eyes @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), 0, 1
    )
    xyz = (
        np.array([[0.4125, 0.3576, 0.1804], [0.2127, 0.7152, 0.0722], [0.0193, 0.1192, 0.9503]])
        @ linear_rgb
        / [0.9505, 1, 1.0888]
    )
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("eyes", EYES)
def test_colours_are_told_apart_by_all_common_kinds_of_colour_vision(eyes):
    seen = [cielab(color, EYES[eyes]) for color in (*COLORS, "white")]
    away = [[np.linalg.norm(one - other) for other in seen] for one in seen]
    pairs = [(away[i][j], i, j) for i in range(len(seen)) for j in range(i)]
    assert (
        min(pairs)[0] > 9
    )  # of all, and what is used first is further apart; 2.3 is just noticeable
    assert min(pair for pair in pairs if pair[1] < 6)[0] > 15


def test_modes_are_told_apart_in_grey_print(block):
    run = simulate(block, 6.0)
    bands = [
        cielab(1 - patch.get_facecolor()[3] * (1 - np.array(patch.get_facecolor()[:3])), np.eye(3))[
            0
        ]
        for patch in time_plot(run, "x").artists[:2]
    ]
    assert abs(bands[0] - bands[1]) > 4
    lines = [part for part in phase_portrait(run).layers if type(part).__name__ == "Trajectories"][
        0
    ].lines
    assert [line.is_dashed() for line in lines] == [False, True]


def test_curves_and_runs_are_told_apart_in_grey_print():
    run = simulate(linear([[0, 1], [-1, 0]]), 5.0)
    view = time_plot(run, ("x", "v"))
    looks = {
        line.get_linestyle() if line.get_linestyle() == "-" else str(line._unscaled_dash_pattern)
        for line in view.figure.axes[0].lines
        if len(line.get_xdata()) > 10
    }
    assert len(looks) == 2


def test_the_time_axis_follows_the_end_of_the_run_both_ways():
    system = linear([[0, 1], [-1, 0]])
    view = time_plot(simulate(system, 10.0), "x")
    for end, shown in ((20.0, 20.0), (10.0, 10.0), (15.0, 15.0), (10.0, 10.0), (4.0, 10.0)):
        view.update(simulate(system, end))
        assert view.axes[0].get_xlim() == (0.0, shown)


def test_a_mode_at_rest_has_no_guard_lines_in_the_plane():
    from labkit import characteristic

    relay = characteristic("relay")
    system = System(
        "second",
        {"x": "", "v": ""},
        {"K": 1.0},
        **relay.modes(lambda t, s, p, F: (s.v, -F - s.x)),
        start={"x": 1.0, "v": 0.0},
    )
    portrait = phase_portrait(system, "x", "v", starts=0, horizon=1.0, limits=((-2, 2), (-2, 2)))
    said = [text.get_text() for text in portrait.axes.texts if text.get_visible()]
    assert any("through 0" in words for words in said)
    assert not any("leaves" in words for words in said)


def test_a_small_patch_keeps_its_colour_among_thousands_of_shades():
    from labkit.draw.figure import _palette_png

    picture = np.random.default_rng(1).integers(0, 256, (300, 400, 3)).astype(np.uint8)
    picture[:200] = 255
    picture[20:28, 30:50] = (211, 238, 229)
    made = np.asarray(Image.open(io.BytesIO(_palette_png(Image.fromarray(picture)))).convert("RGB"))
    assert np.all(made[20:28, 30:50] == (211, 238, 229))


def test_ticks_once_in_two_threads():
    """Both find the axes untouched, and each puts them back: the second finds that done."""
    axes = figure().axes[0]
    with ticks_once(axes):
        for axis in (axes.xaxis, axes.yaxis):
            del axis._update_ticks, axis._get_ticklabel_bboxes
    assert not {"_update_ticks", "_get_ticklabel_bboxes"} & vars(axes.xaxis).keys()


def test_a_plane_of_one_state_twice_is_refused():
    with pytest.raises(ModelError, match="two states, and both are 'x'; 'linear' has 'x', 'v'"):
        phase_portrait(linear(((0, 1), (-1, 0))), "x", "x")
