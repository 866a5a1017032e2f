"""python -m tests.benchmarks recorded: how many pictures a second a recorded panel plays.

The picture of `latency.py` is recorded, the page is opened from the disk, and a mouse that moves
120 times a second drags the slider up and down for 5 s, so fast that each frame of the screen meets
another position. Counted are the pictures that were painted.
"""

from __future__ import annotations

import base64
import os
import socket
import tempfile
import time
from pathlib import Path
from unittest import mock

from ..helpers import run_cell
from ..lab import open_browser
from .latency import SETUP, Mouse

WATCH = """canvas => {
    window.seen = 0;
    new MutationObserver(() => (window.seen += 1))
        .observe(canvas, { attributes: true, attributeFilter: ['data-seq'] });
}"""


def page_of(panel) -> str:
    """page_of(panel) -> the HTML of a page with this recorded panel alone."""
    from labkit.recorded import record, script, style

    tape, picture = (base64.b64encode(data).decode() for data in (record(panel), panel.png))
    return (
        f'<!doctype html><meta charset="utf-8"><style>{style()}</style>'
        f'<div class="labkit-recording"><img src="data:image/png;base64,{picture}">'
        f'<script type="application/octet-stream">{tape}</script></div>'
        f"<script>{script()}</script>"
    )


def measure(browser, port: int, place: Path, ratio: float, seconds: float = 5.0) -> float:
    """measure(browser, port, Path("page.html"), 2) -> pictures a second."""
    page = browser.new_page(device_scale_factor=ratio, viewport={"width": 1366, "height": 768})
    page.goto(place.as_uri())
    page.locator("canvas[data-seq]").wait_for()
    time.sleep(2)
    page.locator("canvas").evaluate(WATCH)
    box = page.locator(".labkit-range").first.bounding_box()
    y = box["y"] + box["height"] / 2
    mouse, begun, times = Mouse(port, "file:"), time.time(), int(120 * seconds)
    mouse("mouseMoved", box["x"], y)
    mouse("mousePressed", box["x"], y)
    for k in range(times):
        time.sleep(max(0.0, begun + k / 120 - time.time()))
        share = abs((6 * seconds * k / times + 1) % 2 - 1)
        mouse("mouseMoved", box["x"] + share * box["width"], y)
    mouse("mouseReleased", box["x"], y)
    shown = page.evaluate("seen") / (time.time() - begun)
    page.close()
    return shown


def main() -> int:
    with tempfile.TemporaryDirectory() as folder, socket.socket() as free:
        before = Path.cwd()
        os.chdir(folder)
        with mock.patch.dict(os.environ, LABKIT_CHECK="0"):
            names = run_cell(SETUP, "<the benchmark>", {})
            panel = names["explore"](names["system"], 10.0, names["draw"], sliders=["delta"])
        (place := Path(folder) / "page.html").write_text(page_of(panel), encoding="utf-8")
        os.chdir(before)
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        with open_browser(f"--remote-debugging-port={port}") as browser:
            for ratio in (1, 2):
                shown = measure(browser, port, place, ratio)
                print(f"{shown:.0f} pictures a second, {ratio} pixels to one of CSS", flush=True)
    return 0
