"""The browser's half of the panel without JupyterLab: the pixels, fingers and keys."""

import time

import numpy as np
import pytest

from labkit import Handle, explore, figure, phase_portrait

from .bare import Fingers, made_by, opened, saved, shown
from .benchmarks.latency import SETUP
from .helpers import run_cell
from .lab import CELLS, HANDS

# ---- fidelity: mean difference ≤ 0.7 of 255, and ≤ 0.3 % of the pixels off by more than 32


def like_what_is_saved(browser, panel, ratio):
    with opened(browser, panel, ratio) as page:
        assert page.problems == []
        mine, theirs = shown(page), saved(panel)
    assert mine.shape == theirs.shape
    off = np.abs(mine - theirs)
    print(
        f"{panel.title}, ratio {ratio}: mean {off.mean():.3f}, "
        f"{100 * (off.max(axis=2) > 32).mean():.3f} % far off"
    )
    assert (theirs < 100).any() and off.mean() <= 0.7 and (off.max(axis=2) > 32).mean() <= 0.003


@pytest.mark.parametrize(
    "name", ["part3/06_dc_dc_converter", "part3/00_sample_dry_friction", "concepts/linear_systems"]
)
def test_the_canvas_shows_what_matplotlib_saves(browser, name):
    panels = made_by(name)
    assert panels
    for panel in panels:
        for ratio in (1, 2):
            like_what_is_saved(browser, panel, ratio)


def test_the_canvas_shows_what_matplotlib_saves_of_the_benchmarks_load(
    browser, tmp_path, monkeypatch
):
    """2 curves, 40 trajectories of 300 points, 400 arrows."""
    monkeypatch.chdir(tmp_path)
    names = run_cell(SETUP, "<the benchmark>", {})
    panel = names["explore"](names["system"], 10.0, names["draw"], start=False, method=False)
    for ratio in (1, 2):
        like_what_is_saved(browser, panel, ratio)


# ---- fingers and keys


@pytest.fixture
def hands():
    """The panel of tests/lab.py that all hands can move."""
    names = run_cell(CELLS[0], "<the lab's first cell>", {})
    return run_cell(HANDS.replace("explore(", "panel = explore("), "<the lab's hands>", names)[
        "panel"
    ]


def until(page, check, seconds=60):
    """Waits until check() is true, while the page goes on."""
    deadline = time.monotonic() + seconds
    while not check() and time.monotonic() < deadline:
        page.wait_for_timeout(50)
    return check()


def kinds(page):
    return [message["kind"] for message in page.asked]


def inside(panel, axes, across, up):
    """A place in axes, in parts of the picture."""
    box = panel.figure.axes[axes].get_position()
    return box.x0 + across * box.width, 1 - box.y0 - up * box.height


def test_two_fingers_zoom_the_axes_they_are_on(browser, hands):
    with opened(browser, hands, 2, has_touch=True) as page:
        plane = hands.figure.axes[2]
        before, top = (plane.get_xlim(), plane.get_ylim()), page.evaluate("scrollY")
        Fingers(page).move(
            (inside(hands, 2, 0.4, 0.6), inside(hands, 2, 0.2, 0.8)),
            (inside(hands, 2, 0.6, 0.4), inside(hands, 2, 0.8, 0.2)),
        )
        assert until(page, lambda: "limits" in kinds(page) and plane.get_xlim()[1] < 1)
        assert np.ptp(plane.get_xlim()) == pytest.approx(
            np.ptp(before[0]) / 3, rel=0.05
        )  # the fingers are three times as far apart
        assert np.mean(plane.get_xlim()) == pytest.approx(0, abs=0.1) and np.ptp(
            plane.get_ylim()
        ) == pytest.approx(np.ptp(before[1]) / 3, rel=0.05)
        assert (
            page.evaluate("scrollY") == top
            and page.evaluate("visualViewport.scale") == 1
            and page.problems == []
        )
        assert not {"start", "drag"} & set(kinds(page))


def test_a_finger_drags_the_ring_also_up_and_down_before_the_picture_has_the_focus(browser, hands):
    with opened(browser, hands, 2, has_touch=True) as page:
        ring, there = (
            inside(hands, 2, 0.75, 0.5),
            inside(hands, 2, 0.7, 0.75),
        )  # (1, 0) in [−2, 2] × [−4, 4]
        Fingers(page).move((ring, there))
        assert until(page, lambda: page.asked[-1]["kind"] == "drag" and page.asked[-1]["settled"])
        assert hands.run.start["x"] == pytest.approx(0.8, abs=0.02) and hands.run.start[
            "v"
        ] == pytest.approx(2, abs=0.04)
        assert page.evaluate("scrollY") == 0 and "start" not in kinds(page) and page.problems == []


def test_a_tap_starts_a_trajectory_and_one_on_a_time_plot_pins_the_cursor(browser, hands):
    with opened(browser, hands, 2, has_touch=True) as page:
        fingers = Fingers(page)
        fingers.tap(inside(hands, 2, 0.9, 0.9))
        assert until(page, lambda: len(hands.begun) == 1)
        assert hands.begun[0] == {
            "x": pytest.approx(1.6, abs=0.02),
            "v": pytest.approx(3.2, abs=0.04),
        }
        fingers.tap(inside(hands, 0, 0.4, 0.5))
        assert (
            until(page, lambda: hands.t is not None)
            and hands.t == pytest.approx(4, abs=0.05)
            and len(hands.begun) == 1
        )


def test_the_page_scrolls_under_a_finger_beside_the_picture_and_over_it(browser, hands):
    with opened(browser, hands, 2, has_touch=True) as page:
        limits = [(axes.get_xlim(), axes.get_ylim()) for axes in hands.figure.axes]
        for begin, over in (
            (-0.2, False),
            (0.8, True),
            (0.8, True),
        ):  # twice over the picture: the first time leaves nothing that catches the second
            fingers, before = Fingers(page), page.evaluate("scrollY")
            assert (
                page.evaluate(
                    "place => document.elementFromPoint(...place).tagName === 'CANVAS'",
                    [fingers.box["x"] + 600, fingers.box["y"] + begin * fingers.box["height"]],
                )
                is over
            )
            fingers.move(((0.75, begin), (0.75, begin - 0.3)))
            assert until(page, lambda before=before: page.evaluate("scrollY") > before + 30), begin
        page.wait_for_timeout(500)
        assert [(axes.get_xlim(), axes.get_ylim()) for axes in hands.figure.axes] == limits
        assert not {"start", "drag", "limits"} & set(kinds(page))
        fingers = Fingers(page)
        fingers.tap((0.75, 0.8))  # now the picture has the focus, and a finger shifts the axes
        fingers.move(((0.75, 0.8), (0.75, 0.6)))
        assert until(page, lambda: hands.figure.axes[2].get_ylim()[0] < -5) and page.problems == []


def test_arrow_keys_move_a_ring_by_the_width_of_its_own_axes(browser, hands):
    def draw(run):
        fig = figure(1, 2, widths=[4, 1])
        plane = phase_portrait(run, "x", "v", limits=((-2, 2), (-4, 4)), axes=fig.axes[0])
        fig.axes[1].set(xlim=(0, 1), ylim=(0, 8))
        return [plane, Handle(fig.axes[1], "delta", "omega")]

    panel = explore(hands.run.system, 10.0, draw)
    with opened(browser, panel) as page:
        page.locator("canvas").focus()
        page.keyboard.press("Enter")
        page.keyboard.press("Shift+ArrowRight")
        page.keyboard.press("Shift+ArrowUp")
        assert until(page, lambda: panel.run.p.omega > 2)
        assert panel.run.p.delta == pytest.approx(0.2, abs=0.01)  # a tenth of 0 … 1
        step = 0.1 * panel.figure.axes[1].bbox.width / panel.figure.axes[1].bbox.height * 8
        assert panel.run.p.omega == pytest.approx(2 + step, abs=0.03) and page.problems == []
