"""A real JupyterLab, started as `python -m labkit` starts it, in a headless browser: run, drag.

Keys, save, reopen.
"""

import io
import json
import os
import re
import socket
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from labkit.__main__ import lab_environment, show_command, warm
from labkit.notebooks import WIDGET, strip

from .bare import Fingers, pixels, shown
from .helpers import FOLDER, NOTEBOOKS, ROOT, read, run_cell
from .lab import (
    CELLS,
    HANDS,
    Lab,
    changed,
    drag,
    failures,
    open_notebook,
    opens_runs_and_slides,
    panels,
    pictures,
    remember,
    run_all,
    settled,
    until,
)

SMALL = "small"  # a notebook of the tests, beside the real ones


@pytest.mark.parametrize("name", [name for name in NOTEBOOKS if not name.startswith("part")])
def test_it_opens_runs_and_slides(desk, lab, name):
    """Those of the parts: test_browser_part1.py, …"""
    opens_runs_and_slides(desk, lab, name)


# ---- the panel itself


def test_the_panel(page, lab):
    """One after the other, since starting costs most: drag, keys, typing, an error, reset, export.

    Save, reopen.
    """
    open_notebook(page, lab, SMALL)
    run_all(page)
    (panel,) = panels(page)
    assert failures(page) == []
    value, verdict = panel.locator(".labkit-value"), panel.locator(".labkit-verdict")
    height = panel.bounding_box()["height"]
    assert (
        all(field.input_value() for field in value.all())
        and float(value.nth(1).input_value()) == 0.1
    )
    assert panel.locator(".labkit-range").nth(1).evaluate(
        "range => [range.valueAsNumber, range.getAttribute('aria-valuetext')]"
    ) == [0.1, "0.1 1/s"]

    # The canvas shows what Matplotlib saves.
    names = run_cell(CELLS[0], "<the lab's first cell>", {})
    figure = names["time_plot"](
        names["simulate"](names["system"], names["horizon"]), "x", height=3
    ).figure
    figure.set_dpi(96)
    figure.canvas.print_png(file := io.BytesIO())
    off = np.abs(shown(panel) - pixels(file.getvalue()))
    assert off.mean() <= 0.7 and (off.max(axis=2) > 32).mean() <= 0.003

    # Dragging: more than one picture on the way, the last one of the last value, and nothing jumps.
    remember(panel)
    first = settled(page, panel)
    last = drag(page, panel, 0.8, slider=1)
    assert last >= first + 2 and changed(panel) > 0.003
    assert float(value.nth(1).input_value()) == pytest.approx(0.8, abs=0.03)
    assert verdict.inner_text().startswith(f"damping {float(value.nth(1).input_value()):.3f}")
    assert panel.bounding_box()["height"] == height

    # Arrow keys move the slider and nothing of JupyterLab; other keys of Lab rest.
    cells = page.locator(".jp-Cell").count()
    before = float(value.nth(1).input_value())
    panel.locator(".labkit-range").nth(1).focus()
    for key in ("ArrowLeft", "ArrowDown", "ArrowLeft", "ArrowRight", "b"):
        page.keyboard.press(key)
    settled(page, panel)
    assert float(value.nth(1).input_value()) < before and page.locator(".jp-Cell").count() == cells
    assert verdict.inner_text().startswith(f"damping {float(value.nth(1).input_value()):.3f}")
    page.keyboard.press("Home")
    settled(page, panel)
    assert value.nth(1).input_value() == "0"

    # A typed value; one out of range and one that breaks the verdict are sentences, and the old
    # picture stays.
    value.nth(1).fill("0,25")
    page.keyboard.press("Enter")
    verdict.filter(has_text="damping 0.250").wait_for()
    settled(page, panel)
    remember(panel)
    value.nth(1).fill("7")
    page.keyboard.press("Enter")
    panel.locator(".labkit-error", has_text="“7” is outside; type one from 0 to 1 1/s").wait_for()
    assert value.nth(1).input_value() == "7"
    value.nth(1).fill("1")
    page.keyboard.press("Enter")
    panel.locator(".labkit-error summary").click()
    assert "in verdict" in panel.locator(".labkit-error pre").inner_text()
    assert changed(panel) == 0

    # A method with a fixed step shows the step instead of the tolerance.
    assert panel.locator(".labkit-control:visible", has_text="size of a step").count() == 0
    panel.get_by_role("button", name="Reset").click()
    verdict.filter(has_text="damping 0.100").wait_for()
    panel.locator("select").select_option("RK4")
    panel.locator(".labkit-control:visible", has_text="size of a step").wait_for()
    assert panel.locator(".labkit-control:visible", has_text="relative tolerance").count() == 0

    tall = panel.bounding_box()["height"]
    panel.get_by_role("button", name="Save CSV").click()
    panel.locator(".labkit-said", has_text="oscillator.csv").wait_for()
    assert panel.bounding_box()["height"] == tall
    assert (lab.folder / "oscillator.csv").read_text(encoding="utf-8").startswith("# {")

    # Ctrl-S saves also while the panel has the focus; the file keeps the picture and nothing of the
    # widget.
    panel.locator(".labkit-range").first.focus()
    page.keyboard.press("Control+s")
    assert until(lambda: lab.saved(SMALL)["cells"][1]["outputs"])
    saved = lab.saved(SMALL)
    (output,) = saved["cells"][1]["outputs"]
    assert set(output["data"]) == {"image/png", "text/plain"} and WIDGET not in json.dumps(saved)
    assert strip(lab.saved(SMALL)) == saved

    # Without a kernel the panel says so as soon as Lab knows, and nothing can be moved.
    lab.end_kernels()
    lost = panel.locator(".labkit-error", has_text="no kernel any more: run the notebook again")
    lost.wait_for(timeout=20_000)
    assert panel.locator(".labkit-range:enabled, select:enabled, button:enabled").count() == 0

    # Without its kernel the saved notebook, which is trusted, shows the picture and no empty
    # widget.
    open_notebook(page, lab, SMALL)
    page.locator(".jp-OutputArea img").first.wait_for()
    assert (
        page.locator(".labkit-panel").count() == 0
        and "not found" not in page.locator(".jp-Notebook").inner_text()
    )
    assert page.problems == []


def test_hands_and_keys(page, lab):
    """Everything that mouse, fingers and keys do on the picture, one after the other."""
    open_notebook(page, lab, "hands")
    run_all(page)
    (panel,) = panels(page)
    canvas, reading = panel.locator("canvas"), panel.locator(".labkit-reading")
    canvas.evaluate("node => node.scrollIntoView({ block: 'start' })")
    settled(page, panel)
    assert canvas.get_attribute("aria-label").startswith(
        "oscillator: "
    ) and "x [m] over t [s]" in canvas.get_attribute("aria-label")
    box = canvas.bounding_box()

    def at(across, down):
        return box["x"] + across * box["width"], box["y"] + down * box["height"]

    def value(name):
        return float(
            panel.locator(f'[aria-label="value of {name}"]').input_value().replace("−", "-")
        )

    def press(*keys):
        for key in keys:
            page.keyboard.press(key)
        settled(page, panel)

    def push(name):
        before = settled(page, panel)
        panel.get_by_role("button", name=name).click()
        pictures(page, panel, before + 1)
        settled(page, panel)

    time_plot, plane, start = at(0.25, 0.25), at(0.9, 0.3), at(0.55 + 0.44 * 0.75, 0.475)

    # The cursor follows the mouse over a time plot and leaves with it; a click pins it; the keys
    # move it.
    page.mouse.move(*time_plot)
    reading.filter(has_text="t = 4").wait_for()
    page.mouse.move(*plane)
    page.mouse.move(box["x"] + 5, box["y"] + box["height"] + 60)
    reading.filter(has_not_text="t =").wait_for()
    page.mouse.click(*time_plot)
    page.mouse.move(*plane)
    reading.filter(has_text="x = ").wait_for()
    before = reading.inner_text()
    press("ArrowRight", "ArrowRight")
    assert until(lambda: reading.inner_text() != before) and reading.inner_text().startswith("t = ")

    # A click in the plane starts a trajectory; it stays while a slider moves; Delete takes it away,
    # "n" starts one from the ring.
    clear = panel.get_by_role("button", name="Clear")
    assert clear.is_disabled()
    remember(panel)
    page.mouse.click(*plane)
    assert until(clear.is_enabled)
    settled(page, panel)
    assert changed(panel) > 0.001
    drag(page, panel, 0.7, slider=1)
    assert clear.is_enabled()
    canvas.focus()
    press("Delete")
    assert clear.is_disabled()
    press("n")
    assert clear.is_enabled()
    clear.click()
    settled(page, panel)

    # The ring is the start: the mouse drags it and the sliders follow; Enter chooses it for the
    # arrow keys.
    panel.get_by_role("button", name="Reset").click()
    settled(page, panel)
    canvas.evaluate("node => node.scrollIntoView({ block: 'start' })")
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] - 40, start[1] - 30, steps=6)
    page.mouse.up()
    settled(page, panel)
    assert value("x") < 0.9 and value("v") > 0.3
    assert verdict_says_nothing_wrong(panel)
    x = value("x")
    press("Escape", "Enter")
    assert panel.locator(".labkit-said").inner_text() == "arrow keys move: the time cursor"
    press("Enter")
    assert panel.locator(".labkit-said").inner_text() == "arrow keys move: start"
    press("ArrowLeft", "ArrowLeft")
    assert value("x") < x

    # The wheel scrolls the page until the picture has the focus, then it zooms; a drag shifts; a
    # double click goes back, and leaves no trajectory.
    remember(panel)
    panel.locator("input").first.focus()
    page.mouse.move(*plane)
    page.mouse.wheel(0, 1)
    settled(page, panel)
    assert changed(panel) == 0
    canvas.focus()
    page.mouse.wheel(0, -300)
    assert until(lambda: changed(panel) > 0.01)
    page.wait_for_timeout(800)  # the labels find their places
    settled(page, panel)
    remember(panel)
    page.mouse.move(*plane)
    page.mouse.down()
    page.mouse.move(plane[0] + 50, plane[1] + 20, steps=5)
    page.mouse.up()
    assert until(lambda: changed(panel) > 0.01) and clear.is_disabled()
    page.wait_for_timeout(800)
    before = settled(page, panel)
    page.mouse.dblclick(*plane)
    pictures(page, panel, before + 1)
    assert until(clear.is_disabled)
    page.wait_for_timeout(800)
    settled(page, panel)
    remember(panel)
    press("a", "+")
    assert until(lambda: changed(panel) > 0.003)
    page.wait_for_timeout(800)
    press("0")
    assert until(lambda: changed(panel) < 0.001)

    # Play runs the cursor through the time and moves the mechanism, alone.
    push("Reset")  # from the run's first instant, whatever the cursor showed
    press("Escape")
    panel.get_by_role("button", name="Play").click()
    assert until(lambda: instant(panel) > 1)
    panel.get_by_role("button", name="Pause").click()
    assert until(lambda: stands(page, panel), 5)  # it would go on for longer
    before = instant(panel)
    assert before < 10
    canvas.focus()
    page.keyboard.press("Space")
    assert until(lambda: instant(panel) != before)
    page.keyboard.press("Space")
    assert until(lambda: stands(page, panel), 5)
    settled(page, panel)

    # A held run, a preset, the classroom; nothing of all this has moved the page.
    push("Hold")
    push("no damping")
    assert value("δ") == 0 and value("x") == 1
    remember(panel)
    push("Hold")
    assert changed(panel) > 0.001  # the ghost has gone
    remember(panel)
    push("Classroom")
    assert changed(panel) > 0.01
    assert verdict_says_nothing_wrong(panel) and page.problems == []


def instant(panel):
    """Where the cursor stands; −1 without one."""
    found = re.match(r"t = ([\d.e−]+)", panel.locator(".labkit-reading").inner_text())
    return float(found[1].replace("−", "-")) if found else -1.0


def stands(page, panel):
    before = instant(panel)
    page.wait_for_timeout(700)
    return instant(panel) == before


def verdict_says_nothing_wrong(panel):
    return panel.locator(".labkit-error").count() == 0


def test_fingers(page, lab, browser):
    """A finger on the ring drags it, two zoom, a tap starts a trajectory or pins the cursor.

    More in test_bare.py.
    """
    context = browser.new_context(
        viewport={"width": 1100, "height": 900}, has_touch=True, device_scale_factor=2
    )
    tablet = context.new_page()
    tablet.set_default_timeout(90_000)
    open_notebook(tablet, lab, "hands")
    run_all(tablet)
    (panel,) = panels(tablet)
    canvas = panel.locator("canvas")
    canvas.evaluate("node => node.scrollIntoView({ block: 'start' })")
    settled(tablet, panel)
    box = canvas.bounding_box()
    tablet.wait_for_function(
        "canvas => Math.abs(canvas.width - 2 * canvas.clientWidth) <= 2",
        arg=canvas.element_handle(),
    )  # sharp on a dense screen
    Fingers(tablet).move(((0.88, 0.475), (0.83, 0.375)))
    settled(tablet, panel)
    x, v = (
        float(panel.locator(f'[aria-label="value of {name}"]').input_value().replace("−", "-"))
        for name in "xv"
    )
    assert x < 0.9 and v > 0.3
    remember(panel)
    Fingers(tablet).move(((0.7, 0.4), (0.62, 0.3)), ((0.8, 0.5), (0.9, 0.6)))
    assert until(lambda: changed(panel) > 0.01)
    tablet.touchscreen.tap(box["x"] + 0.65 * box["width"], box["y"] + 0.7 * box["height"])
    assert until(panel.get_by_role("button", name="Clear").is_enabled)
    tablet.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + 0.25 * box["height"])
    panel.locator(".labkit-reading", has_text="t = 4").wait_for()
    assert panel.locator(".labkit-error").count() == 0
    context.close()


@pytest.mark.parametrize("width", [700, 1300])
def test_it_fits_the_page(page, lab, width):
    page.set_viewport_size({"width": width, "height": 1000})
    open_notebook(page, lab, SMALL)
    run_all(page)
    (panel,) = panels(page)
    settled(page, panel)
    room, canvas = panel.bounding_box(), panel.locator("canvas").bounding_box()
    assert canvas["x"] + canvas["width"] <= room["x"] + room["width"] + 1 and canvas[
        "width"
    ] / canvas["height"] == pytest.approx(864 / 288, rel=0.02)
    for control in panel.locator(".labkit-control:visible").all():
        box = control.bounding_box()
        assert room["x"] <= box["x"] and box["x"] + box["width"] <= room["x"] + room["width"] + 1
    assert page.evaluate(
        "document.querySelector('.labkit-panel').scrollWidth"
        " <= document.querySelector('.labkit-panel').clientWidth"
    )


# ---- without JupyterLab


def watched(browser, own):
    """A page that keeps what went wrong, and which other addresses it asked for (no answer)."""
    page = browser.new_page(viewport={"width": 1300, "height": 1000})
    page.set_default_timeout(90_000)
    page.problems, page.foreign = [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on(
        "console",
        lambda message: page.problems.append(message.text) if message.type == "error" else None,
    )

    def foreign(route):
        page.foreign.append(route.request.url)
        route.abort()

    page.route(lambda url: not url.startswith((own, "data:", "blob:")), foreign)
    return page


@pytest.fixture
def app(tmp_path):
    """The address of Voilà, started as `python -m labkit show` starts it.

    With the small notebook for all hands.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    Lab.write(SimpleNamespace(folder=tmp_path), "hands", [CELLS[0], HANDS])
    command = [
        str(tmp_path / "hands.ipynb") if word.endswith(".ipynb") else word
        for word in show_command(["part3/06", "--no-browser", f"--port={port}"])
    ]
    environment = lab_environment() | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        "LABKIT_CHECK": "0",
    }
    warm()
    with (
        open(tmp_path / "server.log", "w") as log,
        subprocess.Popen(
            command, env=environment, cwd=tmp_path, stdout=log, stderr=subprocess.STDOUT
        ) as server,
    ):

        def answers():
            assert server.poll() is None, (tmp_path / "server.log").read_text()
            with socket.socket() as door:
                return door.connect_ex(("127.0.0.1", port)) == 0

        assert until(answers, 90)
        yield f"http://localhost:{port}/"
        server.terminate()


def test_one_notebook_as_an_app(browser, app):
    """python -m labkit show: the code is hidden, the panel lives.

    And nothing comes from elsewhere.
    """
    page = watched(browser, app)
    page.goto(app)
    panel = page.locator(".labkit-panel")
    panel.wait_for()
    pictures(page, panel, 1)
    settled(page, panel)
    assert page.locator(".jp-InputArea").count() == 0 and "def draw" not in page.content()
    remember(panel)
    before = settled(page, panel)
    assert drag(page, panel, 0.8, slider=1) > before and changed(panel) > 0.003
    canvas, clear = panel.locator("canvas"), panel.get_by_role("button", name="Clear")
    canvas.evaluate("node => node.scrollIntoView({ block: 'start' })")
    box = canvas.bounding_box()
    page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.3 * box["height"])
    assert until(clear.is_enabled)
    panel.get_by_role("button", name="Play").click()
    assert until(lambda: instant(panel) > 0.5)
    panel.get_by_role("button", name="Pause").click()
    assert verdict_says_nothing_wrong(panel) and page.problems == [] and page.foreign == []
    page.close()


def test_an_exported_page_shows_the_saved_pictures(browser, tmp_path):
    name = "part1/00_sample_stable_spiral"
    subprocess.run(
        [
            sys.executable,
            "-m",
            "nbconvert",
            "--to",
            "html",
            "--output-dir",
            tmp_path,
            "--output",
            "page",
            FOLDER / f"{name}.ipynb",
        ],
        check=True,
        capture_output=True,
    )
    outputs = [
        output.get("data", {}) for cell in read(name)["cells"] for output in cell.get("outputs", [])
    ]
    made = sum("image/png" in data for data in outputs)
    assert made > 1 and any("panel of" in "".join(data.get("text/plain", "")) for data in outputs)
    page = watched(browser, "file:")
    page.goto((tmp_path / "page.html").as_uri())
    images = page.locator(".jp-OutputArea img")
    images.nth(made - 1).wait_for(state="attached")
    assert images.count() == made and all(
        images.evaluate_all(
            "images => images.map((image) => image.complete && image.naturalWidth > 300)"
        )
    )
    text = page.locator("body").inner_text()
    assert "not found" not in text and "panel of" not in text and WIDGET not in page.content()
    assert [
        problem for problem in page.problems if "ERR_FAILED" not in problem
    ] == []  # formulas come from the network, and here nothing does
    page.close()
