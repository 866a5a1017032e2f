"""The browser's half of the panel without JupyterLab: the pixels, fingers and keys."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from labkit import Handle, explore, figure, phase_portrait
from labkit.draw.view import View

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
        # Nor does a tap, which gives the picture the focus; sideways a finger shifts the axes.
        fingers, before = Fingers(page), page.evaluate("scrollY")
        fingers.tap((0.75, 0.8))
        fingers.move(((0.75, 0.8), (0.75, 0.5)))
        assert until(page, lambda: page.evaluate("scrollY") > before + 30)
        page.wait_for_timeout(500)
        assert [(axes.get_xlim(), axes.get_ylim()) for axes in hands.figure.axes] == limits
        page.evaluate("scrollTo(0, 0)")
        fingers = Fingers(page)
        fingers.move((inside(hands, 2, 0.7, 0.8), inside(hands, 2, 0.4, 0.8)))
        assert until(page, lambda: hands.figure.axes[2].get_xlim()[0] > -1.5)
        assert page.problems == []


def field(page, name):
    return page.get_by_label(f"value of {name}", exact=True)


def test_a_finger_moves_a_slider_sideways_only_and_scrubs_the_time(browser, hands):
    with opened(browser, hands, 1, has_touch=True) as page:
        range_ = page.locator(".labkit-range").first
        box, fingers, before = range_.bounding_box(), Fingers(page), page.evaluate("scrollY")
        fingers.box = box
        fingers.move(((0.8, 0.5), (0.8, -8)))  # up: the page scrolls
        assert until(page, lambda: page.evaluate("scrollY") > before + 30)
        page.wait_for_timeout(500)
        assert hands.run.p.omega == 2.0 and field(page, "ω").input_value() == "2"
        page.evaluate("scrollTo(0, 0)")
        fingers.box = range_.bounding_box()
        fingers.tap((0.8, 0.5))
        page.wait_for_timeout(300)
        assert hands.run.p.omega == 2.0
        fingers.move(((0.2, 0.5), (0.7, 0.5)))
        assert until(page, lambda: hands.run.p.omega == pytest.approx(4.5, abs=0.2))
        page.evaluate("scrollTo(0, 0)")
        fingers = Fingers(page)
        fingers.move((inside(hands, 0, 0.2, 0.5), inside(hands, 0, 0.7, 0.5)))
        assert until(page, lambda: hands.t == pytest.approx(7, abs=0.2))
        assert page.problems == [] and not {"limits", "start"} & set(kinds(page))


def test_typed_values_that_cannot_be_stay_with_a_sentence_over_a_picture_marked_as_old(
    browser, hands
):
    with opened(browser, hands) as page:
        delta, trouble = field(page, "δ"), page.locator(".labkit-error")
        for text, words in [
            ("abc", "δ: “abc” is no number; type one from 0 to 1 1/s."),
            ("", "is no number"),
            ("1e400", "is outside"),
            ("7", "“7” is outside; type one from 0 to 1 1/s. The picture still shows 0.1."),
        ]:
            delta.fill(text)
            page.keyboard.press("Enter")
            trouble.filter(has_text=words).wait_for(timeout=2000)
            assert delta.input_value() == text and delta.get_attribute("aria-invalid")
            assert page.locator(".labkit-old canvas").count() == 1
        field(page, "rtol").fill("1e-15")
        page.keyboard.press("Tab")
        trouble.filter(has_text="rtol: “1e-15” is outside; type one from 1e−12 to 0.01").wait_for()
        assert "set" not in kinds(page)
        delta.fill("0,25")
        page.keyboard.press("Enter")
        assert until(page, lambda: hands.run.p.delta == 0.25)
        assert until(page, lambda: page.locator(".labkit-old").count() == 0)
        assert field(page, "rtol").input_value() == "1e−8" and trouble.count() == 0
        delta.fill("x")
        page.keyboard.press("Escape")
        assert delta.input_value() == "0.25" and page.locator(".labkit-old").count() == 0


def test_a_sliders_grid_begins_at_its_low_end(browser):
    names = run_cell(CELLS[0], "<the lab's first cell>", {})
    panel = explore(names["system"], 10.0, sliders={"omega": (1, 6, 2), "delta": (0, 1)}, omega=3.0)
    with opened(browser, panel) as page:
        page.locator(".labkit-range").first.focus()
        page.keyboard.press("Home")
        seen = []
        for _ in range(4):
            seen.append(field(page, "ω").input_value())
            page.keyboard.press("ArrowRight")
        assert seen == ["1", "3", "5", "6"]
        assert [panel.controls[0].nearest(at) for at in (1.2, 2.1, 4.4, 9)] == [1, 3, 5, 6]


def test_a_field_shows_all_digits_of_its_number_and_reads_what_it_shows(browser):
    names = run_cell(CELLS[0], "<the lab's first cell>", {})
    system = names["system"].variant(
        "small and large",
        parameters={
            "G": names["Parameter"](-6.67415e-11, "", "", -7e-11, -6e-11),
            "M": names["Parameter"](1e20, "", "", 1e19, 1e21),
        },
    )
    panel = explore(system, 10.0)
    with opened(browser, panel) as page:
        shown = {"G": "−6.67415e−11", "M": "1e20"}
        for name, text in shown.items():
            assert field(page, name).input_value() == text
            assert field(page, name).evaluate("node => node.scrollWidth <= node.clientWidth")
        field(page, "G").fill("−6.5e−11")
        page.keyboard.press("Enter")
        assert until(page, lambda: panel.run.p.G == -6.5e-11)


def test_undo_home_reset_and_the_settings_as_code(browser, hands):
    with opened(browser, hands) as page:

        def push(name):
            page.get_by_role("button", name=name, exact=True).click()

        first = [(axes.get_xlim(), axes.get_ylim()) for axes in hands.figure.axes]
        undo, home = (page.get_by_role("button", name=name) for name in ("Undo", "Home"))
        assert undo.is_disabled() and home.is_disabled()
        for text in ("0.3", "0.6"):
            field(page, "δ").fill(text)
            page.keyboard.press("Enter")
            assert until(page, lambda text=text: hands.run.p.delta == float(text))
        page.keyboard.press("Control+z")
        assert until(page, lambda: hands.run.p.delta == 0.3)
        assert until(page, lambda: field(page, "δ").input_value() == "0.3")
        undo.click()
        assert until(page, lambda: hands.run.p.delta == 0.1) and until(page, undo.is_disabled)
        field(page, "x").fill("-1.2")
        page.keyboard.press("Enter")
        page.locator("select").select_option("RK45")
        assert until(page, lambda: hands.run.work.method == "RK45")
        push("Code")
        text = page.locator(".labkit-said")
        words = 'explore(system, 10.0, start={"x": -1.2}, method="RK45")'
        assert until(
            page, lambda: words in (text.inner_text() or "") or text.locator("input").count()
        )
        if text.locator("input").count():
            assert text.locator("input").input_value() == words
        page.locator("canvas").focus()
        page.keyboard.press("+")
        page.keyboard.press("ArrowRight")
        assert until(page, home.is_enabled) and until(page, lambda: hands.t is not None)
        assert home.evaluate("node => getComputedStyle(node).boxShadow") != "none"  # one sees it
        push("Reset")
        assert until(page, lambda: hands.t is None and hands.values == hands.defaults)
        assert until(page, home.is_disabled)
        assert [(axes.get_xlim(), axes.get_ylim()) for axes in hands.figure.axes] == first
        for name in ("Hold", "Classroom"):
            button = page.get_by_role("button", name=name)
            assert button.get_attribute("aria-pressed") == "false"
            button.click()
            assert until(page, lambda b=button: b.get_attribute("aria-pressed") == "true")
        assert page.problems == []


def test_a_panel_that_cannot_reach_its_kernel_says_so_and_what_to_do(browser, hands):
    with opened(browser, hands) as page:
        page.evaluate("void (window.ask = () => { throw new Error('closed'); })")
        page.get_by_role("button", name="Play").click()
        lost = page.locator(".labkit-error", has_text="no kernel any more: run the notebook again")
        lost.wait_for(timeout=1000)
        assert page.locator("input:enabled, select:enabled, button:enabled").count() == 0
        assert page.get_by_role("button", name="Play").inner_text() == "▶ Play"  # it does not run
        assert page.locator("fieldset:disabled canvas").count() == 1 and page.problems == []
    with opened(browser, hands) as page:
        page.evaluate(
            "void (window.ask = () => new Promise(() => {}))"
        )  # it works at something else
        page.get_by_role("button", name="Play").click()
        page.locator(".labkit-verdict[data-late*='the kernel is busy']").wait_for(timeout=2000)
        page.wait_for_timeout(700)
        assert page.get_by_role("button", name="Play").inner_text() == "▶ Play"
        late = page.locator(".labkit-verdict[data-late*='no answer']")
        late.wait_for(timeout=12_000)
        assert "run the notebook again" in late.get_attribute("data-late")


def test_a_panel_promises_only_what_it_can_do(browser):
    names = run_cell(CELLS[0], "<the lab's first cell>", {})

    class Bare(View):
        def __init__(self, run):
            self.figure = figure(1, 1)
            (self.line,) = self.figure.axes[0].plot(run["x"], run["v"])
            self.artists = [self.line]

        def update(self, run):
            self.line.set_data(run["x"], run["v"])

    panel = explore(names["system"], 10.0, Bare)
    with opened(browser, panel) as page:
        help_ = page.locator("canvas").get_attribute("aria-description")
        assert "zoom" in help_ and not [
            word
            for word in ("ring", "cursor", "Space", "trajectory", "axes", "Enter")
            if word in help_.replace("shifts the axes", "")
        ]
        for name in ("Play", "Hold", "Clear"):
            assert page.get_by_role("button", name=name).count() == 0
        page.locator("canvas").focus()
        for key in ("ArrowRight", " ", "Enter", "n"):
            page.keyboard.press(key)
        page.wait_for_timeout(300)
        assert page.locator(".labkit-reading").inner_text().strip() == ""
        assert "cursor" not in kinds(page) and page.problems == []


# ---- room, and eyes that see less


LAPTOP, PROJECTOR = {"width": 1010, "height": 647}, {"width": 1280, "height": 720}


def test_picture_and_sliders_are_in_view_together_and_a_classroom_can_read_them(browser):
    panel = made_by("part3/04_room_heater")[0]
    with opened(browser, panel) as page:
        page.evaluate(
            "[...document.querySelectorAll('body > div')].forEach((d) => (d.style.height = 0))"
        )
        page.set_viewport_size(LAPTOP)
        page.wait_for_timeout(800)
        for part in ("canvas", ".labkit-verdict", ".labkit-side", ".labkit-bar"):
            box = page.locator(part).first.bounding_box()
            assert box["y"] >= 0 and box["y"] + box["height"] <= LAPTOP["height"], part
        small = page.evaluate(SMALL_TARGETS)
        assert small == []
        page.set_viewport_size(PROJECTOR)
        page.get_by_role("button", name="Classroom").click()
        page.wait_for_timeout(1000)
        sizes = page.evaluate(SIZES)
        assert min(sizes) >= 20
        texts = [text for text in panel.figure.findobj(Text) if text.get_text()]
        letters = min(text.get_fontsize() for text in texts if text.get_visible())
        wide = page.locator("canvas").bounding_box()["width"]
        shown_at = panel.figure.dpi / 72 * wide / page.locator("canvas").evaluate("c => c.width")
        assert letters * shown_at >= 19.8
        room = page.locator(".labkit-room").bounding_box()
        assert room["width"] > 0.95 * PROJECTOR["width"] and page.problems == []
        narrow = {**PROJECTOR, "width": 850}  # beside Lab's list of files: the sliders go below
        page.set_viewport_size(narrow)
        page.wait_for_timeout(1000)
        wide = page.locator("canvas").bounding_box()["width"]
        assert wide > 0.8 * narrow["width"]


SIZES = """() => [...document.querySelectorAll('.labkit-panel *')]
    .filter((node) => [...node.childNodes].some((one) => one.nodeType === 3 && one.data.trim())
        || node.matches('input[type=text]'))
    .map((node) => parseFloat(getComputedStyle(node).fontSize))"""
SMALL_TARGETS = """() => [...document.querySelectorAll('button, input, select, summary')]
    .filter((node) => node.checkVisibility())
    .map((node) => [node.textContent || node.ariaLabel, node.offsetWidth, node.offsetHeight])
    .filter(([, width, height]) => Math.min(width, height) < 24)"""


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing(browser, hands, theme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    themes = Path(sys.prefix) / "share/jupyter/lab/themes/@jupyterlab"
    with opened(browser, hands) as page:
        page.add_style_tag(path=themes / f"theme-{theme}-extension/index.css")
        page.evaluate(
            """theme => {
            document.documentElement.lang = 'en';
            document.title = 'panel';
            document.body.dataset.jpThemeLight = theme === 'light';
            document.body.style.background = 'var(--jp-layout-color0)';
        }""",
            theme,
        )
        page.get_by_role("button", name="Hold").click()
        page.get_by_role("button", name="Classroom").click()
        page.get_by_text("mouse and keys").click()
        for text in ("0.3", "abc"):  # a panel at work, and one that says what is wrong
            field(page, "δ").fill(text)
            page.keyboard.press("Enter")
            page.wait_for_timeout(700)
            found = axe.run(page, context=".labkit-panel")
            assert found.violations_count == 0, found.generate_report()


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
