"""A panel in a bare page.

It has panel.js and panel.css as they are, and the panel's other half in this process; there is no
server and no kernel.

with open_browser() as browser, opened(browser, panel, ratio=2) as page: …
made_by("part3/06_dc_dc_converter")                  # the panels that a notebook makes
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
from collections.abc import Iterator
from unittest import mock

import numpy as np
from PIL import Image

from labkit.draw.figure import style
from labkit.panel import Panel

from .helpers import load

START = """async ([code, spec, first]) => {
    const bytes = (text) =>
        new DataView(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
    const module = new Blob([code], { type: 'text/javascript' });
    const { default: widget } = await import(URL.createObjectURL(module));
    let hear;
    const send = (message) => window.ask(message)
        .then(([content, buffers]) => hear(content, buffers.map(bytes)));
    const get = (name) => (name === 'spec' ? spec : bytes(first));
    const on = (name, listener) => name === 'msg:custom' && (hear = listener);
    const model = { get, on, off: () => {}, send };
    widget.render({ model, el: document.getElementById('panel') });
}"""


@contextlib.contextmanager
def opened(browser, panel: Panel, ratio: float = 1.0, **options: object) -> Iterator:
    """The page, once it has painted the kernel's first picture.

    Errors that nobody caught are page.problems, the messages page.asked.
    """
    context = browser.new_context(
        device_scale_factor=ratio, viewport={"width": 1200, "height": 1000}, **options
    )
    page = context.new_page()
    page.problems, page.asked, answers = [], [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))

    def ask(message: dict) -> tuple[dict, list[str]]:
        page.asked.append(message)
        panel._handle_custom_msg(message, [])
        content, buffers = answers.pop()
        return content, [base64.b64encode(buffer).decode() for buffer in buffers or []]

    with mock.patch.object(
        panel, "send", lambda content, buffers=None: answers.append((content, buffers))
    ):
        page.expose_function("ask", ask)
        page.set_content(
            f"<style>{panel._css}</style><div style='height: 200px'></div><div "
            "id=panel></div><div style='height: 2000px'></div>"
        )
        page.evaluate(
            START,
            [
                str(panel._esm),
                json.loads(json.dumps(panel.spec)),
                base64.b64encode(panel.first).decode(),
            ],
        )
        page.wait_for_function("() => document.querySelector('canvas').dataset.seq >= 1")
        yield page
        context.close()


def made_by(name: str) -> list[Panel]:
    """made_by("concepts/linear_systems") -> its panels, fresh ones."""
    made, make = [], Panel.__init__

    def init(self: Panel, *arguments: object, **options: object) -> None:
        make(self, *arguments, **options)
        made.append(self)

    with mock.patch.object(Panel, "__init__", init):
        load.__wrapped__(name)
    return made


def shown(page) -> np.ndarray:
    """The pixels of the canvas."""
    return pixels(
        base64.b64decode(
            page.locator("canvas").evaluate("canvas => canvas.toDataURL('image/png').split(',')[1]")
        )
    )


def saved(panel: Panel) -> np.ndarray:
    """What Matplotlib draws of the panel's figure at the same size.

    The axes stay where they are in the panel's picture.
    """
    panel.figure.frozen = True
    with style():
        panel.figure.canvas.print_png(file := io.BytesIO())
    panel.figure.frozen = False
    return pixels(file.getvalue())


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


class Fingers:
    """Fingers(page): touches at places of the picture, in parts of its width and height."""

    def __init__(self, page):
        self.page, self.box = page, page.locator("canvas").bounding_box()
        self.session = page.context.new_cdp_session(page)

    def __call__(self, kind, *places):
        points = [
            {
                "x": self.box["x"] + x * self.box["width"],
                "y": self.box["y"] + y * self.box["height"],
                "id": k,
            }
            for k, (x, y) in enumerate(places)
        ]
        self.session.send(
            "Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points}
        )

    def move(self, *ways, steps=10):
        """Each finger along its way, (from, to)."""
        self("Start", *(way[0] for way in ways))
        for k in range(1, steps + 1):
            self(
                "Move",
                *(
                    tuple(np.array(way[0]) + (np.array(way[1]) - way[0]) * k / steps)
                    for way in ways
                ),
            )
            self.page.wait_for_timeout(20)
        self("End")

    def tap(self, place):
        self("Start", place)
        self("End")
