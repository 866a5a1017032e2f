"""A line that says how far a long computation is; silent where nobody looks."""

from __future__ import annotations

import sys
from time import monotonic
from typing import Any

__all__ = ["Progress"]

PATIENCE = 0.7  # seconds before the line appears: what is faster needs none
PAUSE = 0.25  # seconds between two of its changes
WIDTH = 24


class Progress:
    """Progress(204, "runs", show=True): a bar, the fraction done and the time that is left.

    In a notebook it is one line below the cell, gone at the end; in a terminal one line of
    stderr. Silent with show=False, without a terminal, and in a kernel that nobody can answer:
    those of nbval, nbconvert and `labkit run` say so by allow_stdin.
    """

    def __init__(self, total: int, what: str = "runs", show: bool = True):
        self.total, self.what, self.done = total, what, 0
        self._begun, self._last = monotonic(), 0.0
        self._line: Any = None
        self._kernel = _kernel() if show else None
        self._terminal = show and self._kernel is None and sys.stderr.isatty()

    def add(self, count: int) -> None:
        """progress.add(17): so many more are done."""
        self.done += count
        now = monotonic()
        if now - self._begun >= PATIENCE and now - self._last >= PAUSE:
            self._last = now
            self._write(self.text(now - self._begun))

    def text(self, seconds: float) -> str:
        """progress.text(3.0) -> the line, `seconds` after the begin."""
        share = self.done / max(self.total, 1)
        bar = "█" * round(WIDTH * share)
        left = f"{seconds * (1 / share - 1):.0f} s left" if share else ""
        return f"{bar:░<{WIDTH}} {share:4.0%}  {self.done} of {self.total} {self.what}, {left}"

    def _write(self, text: str) -> None:
        if self._terminal:
            sys.stderr.write(f"\r{text}\033[K")
            sys.stderr.flush()
        elif self._kernel is not None:
            from IPython.display import display

            data = {"text/plain": text}
            if self._line is None:
                self._line = display(data, raw=True, display_id=True)
            else:
                self._line.update(data, raw=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal and self._last:
            sys.stderr.write("\r\033[K")
        elif self._line is not None:
            self._line.update({"text/plain": ""}, raw=True)


def _kernel() -> object | None:
    """The kernel that this runs in, if someone sits before it."""
    shell = sys.modules.get("IPython") and sys.modules["IPython"].get_ipython()
    kernel = getattr(shell, "kernel", None)
    if kernel is None:
        return None
    try:
        return kernel if kernel.get_parent("shell")["content"].get("allow_stdin") else None
    except (AttributeError, KeyError, TypeError):  # another kernel than ipykernel
        return None
