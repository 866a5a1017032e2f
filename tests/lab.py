"""A JupyterLab over a folder of notebooks, started as `python -m labkit` starts it, and a browser:
for tests and benchmarks.

with running_lab(folder) as lab, open_browser() as browser: …  # the notebooks: folder/notebooks
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

from labkit.__main__ import lab_command, lab_environment
from labkit.browser import FLAGS, find_browser

from .helpers import ROOT

KERNEL = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    # As a saved notebook has it: Lab marks one without as changed when its kernel says what it is
    "language_info": {
        "codemirror_mode": {"name": "ipython", "version": 3},
        "file_extension": ".py",
        "mimetype": "text/x-python",
        "name": "python",
        "nbconvert_exporter": "python",
        "pygments_lexer": "ipython3",
    },
}
# Two small notebooks: a panel, and all that hands can do.
CELLS = [
    """\
from labkit import Mode, Parameter, System, explore, simulate, time_plot

def flow(t, s, p):
    return s.v, -p.omega**2 * s.x - 2 * p.delta * s.v

parameters = {
    "omega": Parameter(2.0, "rad/s", "frequency", 1.0, 6.0),
    "delta": Parameter(0.1, "1/s", "damping", 0.0, 1.0),
}
system = System("oscillator", {"x": "m", "v": "m/s"}, parameters, [Mode("motion", flow)],
                start={"x": 1.0, "v": 0.0})
horizon = 10.0

def verdict(run):
    return f"damping {run.p.delta:.3f}, {1 / (1 - run.p.delta):.3f}"
""",
    'explore(system, horizon, lambda run: time_plot(run, "x", height=3), verdict=verdict)',
]

HANDS = """\
from labkit import Motion, figure, phase_portrait

def mechanism(sketch, s):
    sketch.block((3 + s.x, 0.6), 1.0, 0.8, "m")

def draw(run):
    fig = figure(0, width=9, height=4)
    grid = fig.add_gridspec(2, 2)
    axes = [fig.add_subplot(grid[place]) for place in ((0, 0), (1, 0), (slice(None), 1))]
    plane = phase_portrait(run, "x", "v", limits=((-2, 2), (-4, 4)), axes=axes[2])
    moving = Motion(axes[1], mechanism, 6, 1.5)
    return [time_plot(run, "x", axes=axes[0], title=""), moving, plane]

explore(system, horizon, draw, presets={"no damping": {"delta": 0.0}})
"""


class Lab:
    def __init__(self, address: str, token: str, folder: Path, server: subprocess.Popen):
        self.address, self.token, self.folder, self.server = address, token, folder, server
        begin = time.monotonic()
        while True:
            try:
                self.ask("api/status")
                return
            except OSError:
                if server.poll() is not None or time.monotonic() - begin > 90:
                    raise AssertionError(
                        "JupyterLab did not start:\n" + (folder.parent / "server.log").read_text()
                    ) from None
                time.sleep(0.2)

    def ask(self, path: str, method: str = "GET"):
        request = urllib.request.Request(
            f"{self.address}/{path}",
            method=method,
            headers={"Authorization": f"token {self.token}"},
        )
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.loads(answer.read() or "null")

    def end_kernels(self) -> None:
        for session in self.ask("api/sessions"):
            self.ask(f"api/sessions/{session['id']}", "DELETE")

    def saved(self, name: str) -> dict:
        return json.loads((self.folder / f"{name}.ipynb").read_text(encoding="utf-8"))

    def write(self, name: str, cells: list[str]) -> None:
        made = [
            {
                "cell_type": "code",
                "id": f"c{k}",
                "metadata": {},
                "execution_count": None,
                "outputs": [],
                "source": text,
            }
            for k, text in enumerate(cells)
        ]
        (self.folder / f"{name}.ipynb").write_text(
            json.dumps({"cells": made, "metadata": KERNEL, "nbformat": 4, "nbformat_minor": 5}),
            encoding="utf-8",
        )


@contextlib.contextmanager
def running_lab(folder: Path) -> Iterator[Lab]:
    """Address, token and folder of a JupyterLab with settings of its own, not the user's."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    token = secrets.token_hex(16)
    own = {
        f"JUPYTER{key}": str(folder / "settings" / key.lower())
        for key in ("_CONFIG_DIR", "_DATA_DIR", "LAB_WORKSPACES_DIR", "LAB_SETTINGS_DIR")
    }
    environment = (
        lab_environment()
        | own
        | {
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
            "LABKIT_CHECK": "0",
        }
    )
    command = lab_command(
        "--no-browser",
        f"--ServerApp.port={port}",
        "--ServerApp.port_retries=0",
        f"--IdentityProvider.token={token}",
        folder=folder,
    )
    with (
        open(folder / "server.log", "w") as log,
        subprocess.Popen(
            command, env=environment, cwd=folder, stdout=log, stderr=subprocess.STDOUT
        ) as server,
    ):
        try:
            yield Lab(f"http://127.0.0.1:{port}", token, folder / "notebooks", server)
        finally:
            server.terminate()


@contextlib.contextmanager
def open_browser(*more: str) -> Iterator:
    """A headless browser of this computer, with more flags if need be.

    Raises LookupError when there is none.
    """
    path = find_browser()
    if path is None:
        raise LookupError(
            "no Chrome, Chromium or Edge found: install one, or say where it is by LABKIT_BROWSER"
        )
    from playwright.sync_api import sync_playwright

    flags = [*FLAGS, *more]
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=flags)
        yield opened
        opened.close()


def opened_page(browser):
    """A page with room for a picture of 9 inches; page.problems: errors that nobody caught."""
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    page.set_default_timeout(90_000)
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    return page


def open_notebook(page, lab: Lab, name: str) -> None:
    """Opens it by its address, or in the Lab that the page shows already, if nothing is open."""
    if page.locator(".jp-LabShell").count() and not page.locator(".jp-NotebookPanel").count():
        choose(page, "File", "Open from Path…")
        page.locator(".jp-Dialog input").fill(f"notebooks/{name}.ipynb")
        page.keyboard.press("Enter")
    else:  # labkit's Lab opens on the start page
        place = "" if name == "start" else f"lab/tree/notebooks/{name}.ipynb"
        page.goto(f"{lab.address}/{place}?token={lab.token}&reset")
    page.locator(".jp-NotebookPanel .jp-Cell").first.wait_for()
    # The indicator at the top says idle before there is a kernel, and Lab then drops what it is
    # told to run; the bar at the bottom knows.
    kernel(page).wait_for()
    tab = page.locator(".lm-TabBar-tab.jp-mod-current")
    assert tab.inner_text().strip() == f"{name.rpartition('/')[2]}.ipynb"
    assert "jp-mod-dirty" not in tab.get_attribute("class"), "only opened, and marked as changed"


def kernel(page):
    """What the bar at the bottom says of a kernel that waits."""
    return page.locator("#jp-bottom-panel .jp-StatusBar-TextItem", has_text="| Idle")


def close_notebook(page, lab: Lab) -> None:
    """Closes what is open, unsaved, and ends its kernel; the page and its Lab stay."""
    choose(page, "File", "Close All Tabs")
    discard = page.get_by_role("button", name="Discard")
    gone = page.locator(".jp-NotebookPanel")
    assert until(lambda: not gone.count() or (discard.count() and discard.click()))
    lab.end_kernels()
    kernel(page).wait_for(state="hidden")


def choose(page, menu: str, entry: str) -> None:
    page.locator(".lm-MenuBar-item", has_text=menu).click()
    page.get_by_text(entry, exact=True).click()


def run_all(page) -> None:
    """Runs all cells and waits until the last one is done.

    Numbers of an earlier run are cleared away before.
    """
    for menu, entry in (("Edit", "Clear Outputs of All Cells"), ("Run", "Run All Cells")):
        choose(page, menu, entry)
    page.wait_for_function(
        """() => {
        const cells = [...document.querySelectorAll('.jp-Notebook .jp-CodeCell')];
        return cells.length && cells.every((cell) => {
            const text = cell.querySelector('.cm-content');
            const prompt = cell.querySelector('.jp-InputPrompt');
            const empty = text && prompt && !text.textContent.trim();
            const folded = cell.querySelector('.jp-InputPlaceholder'); // it shows no number
            return empty || folded || /\\[\\d+\\]/.test(prompt?.textContent);
        });
    }""",
        timeout=180_000,
        polling=200,  # ms; at every frame it would cost as much as the run
    )
    page.locator(".jp-Notebook-ExecutionIndicator[data-status='idle']").wait_for(state="attached")


def walk(page):
    """Shows every code cell for a moment.

    Lab puts what is in a cell into the page when it comes near.
    """
    page.evaluate("""async () => {
        const cells = '.jp-NotebookPanel:not(.lm-mod-hidden) .jp-CodeCell';
        for (const cell of document.querySelectorAll(cells)) {
            cell.scrollIntoView();
            await new Promise((shown) => setTimeout(shown, 30));
        }
    }""")


def failures(page):
    """The errors and warnings under the cells. By textContent.

    Lab skips the painting of what is far away, and innerText is empty there.
    """
    kinds = ("application/vnd.jupyter.error", "application/vnd.jupyter.stderr")
    return [
        text
        for kind in kinds
        for text in page.locator(f'.jp-Notebook [data-mime-type="{kind}"]').all_text_contents()
    ]


def panels(page, number=1):
    """All panels, `number` of them, each once it has painted its picture.

    Lab makes widgets when it has nothing else to do or their cells come near.
    """
    painted = page.locator(".jp-Notebook .labkit-panel canvas")
    assert until(lambda: painted.count() >= number or walk(page), 90)
    found = page.locator(".labkit-panel")
    for k in range(found.count()):
        found.nth(k).scroll_into_view_if_needed()
        pictures(page, found.nth(k), 1)
        settled(page, found.nth(k))  # the first picture may be of another size
    return [found.nth(k) for k in range(found.count())]


def pictures(page, panel, number):
    """Waits until the panel has painted the answer to its message `number`."""
    page.wait_for_function(
        "([canvas, number]) => Number(canvas.dataset.seq) >= number",
        arg=[panel.locator("canvas").element_handle(), number],
    )
    return int(panel.locator("canvas").get_attribute("data-seq"))


def remember(panel):
    panel.locator("canvas").evaluate(
        "canvas => { canvas.before = canvas.getContext('2d')"
        ".getImageData(0, 0, canvas.width, canvas.height); }"
    )


def changed(panel):
    """Part of the picture's pixels that differ clearly from those that were remembered."""
    return panel.locator("canvas").evaluate("""canvas => {
        const now = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        const [a, b] = [canvas.before.data, now.data];
        if (a.length !== b.length) return 1;
        let count = 0;
        const off = (i) => Math.abs(a[i] - b[i]);
        const far = (i) => Math.max(off(i), off(i + 1), off(i + 2)) > 60;
        for (let i = 0; i < a.length; i += 4) count += far(i);
        return count / (a.length / 4);
    }""")


def drag(page, panel, part, slider=0):
    """Drags a slider with the mouse to a part of its way, in small steps.

    Returns the last picture's number.
    """
    thumb = panel.locator(".labkit-range:visible").nth(
        slider
    )  # a method with a fixed step hides the tolerance, an adaptive one the step
    thumb.scroll_into_view_if_needed()
    box = still(thumb)
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.5 * box["width"], y)
    page.mouse.down()
    for k in range(1, 11):
        page.mouse.move(box["x"] + (0.5 + (part - 0.5) * k / 10) * box["width"], y)
        time.sleep(0.03)
    page.mouse.up()
    return settled(page, panel)


def still(element):
    """The element's box once it has stopped moving: panels above it may still be painted."""
    boxes = [element.bounding_box()]
    until(lambda: boxes.append(element.bounding_box()) or boxes[-1] == boxes[-2])
    return boxes[-1]


def until(check, seconds=60):
    """Waits until check() is true: a machine with much to do takes its time for a redraw."""
    deadline = time.monotonic() + seconds
    while not check() and time.monotonic() < deadline:
        time.sleep(0.2)
    return check()


def settled(page, panel):
    """Waits until no new picture comes for 0.7 s and the panel waits for none.

    It says so when an answer takes longer than 0.4 s.
    """
    last, since, deadline = None, time.monotonic(), time.monotonic() + 90
    while time.monotonic() - since < 0.7 and time.monotonic() < deadline:
        now = panel.evaluate(
            "panel => [panel.querySelector('canvas').dataset.seq, "
            "'late' in panel.querySelector('.labkit-verdict').dataset]"
        )
        if now != last or now[1]:
            last, since = now, time.monotonic()
        time.sleep(0.05)
    return int(last[0])


def opens_runs_and_slides(page, lab: Lab, name: str) -> None:
    """Opens a notebook, runs all its cells without an error, drags a slider of every panel."""
    open_notebook(page, lab, name)
    saved = json.dumps(lab.saved(name))
    shown = saved.count('"panel of ')  # a saved notebook has these words beside the picture
    assert bool(shown) == ("explore(" in saved)
    if "image/png" in saved:
        assert until(
            lambda: page.locator(".jp-OutputArea img").count() > 0 or walk(page)
        )  # pictures are there before anything is run
    assert (
        page.locator(".labkit-panel").count() == 0
        and "model not found" not in page.locator(".jp-Notebook").inner_text()
    )
    run_all(page)
    made = panels(page, shown)
    assert len(made) == shown
    assert failures(page) == []
    for panel in made:
        remember(panel)
        first = pictures(page, panel, 1)
        # A hand, too, takes a slider again when the page moved under it
        assert until(lambda panel=panel, first=first: drag(page, panel, 0.9) > first, 10)
        if not changed(panel) > 0.001:  # the default may be at that place
            drag(page, panel, 0.1)
        if not changed(panel) > 0.001:  # a star's rate does not bend its rays
            drag(page, panel, 0.9, slider=1)
        assert changed(panel) > 0.001
        assert panel.locator(".labkit-error").count() == 0, panel.locator(
            ".labkit-verdict"
        ).inner_text()
    assert failures(page) == [] and page.problems == []
