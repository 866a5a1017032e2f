"""A browser of this computer: for tests, and to print a page."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from .run import write_whole

__all__ = ["FLAGS", "find_browser", "print_to_pdf"]

FLAGS = ["--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
FLAGS += ["--disable-component-update", "--disable-sync"]
if hasattr(os, "geteuid") and os.geteuid() == 0:
    FLAGS.append("--no-sandbox")


def find_browser() -> str | None:
    """find_browser() -> the path of a Chrome, Chromium or Edge, or None.

    LABKIT_BROWSER, on the path, or in the usual places.
    """
    names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"]
    names += ["msedge", "microsoft-edge", "microsoft-edge-stable"]
    if sys.platform == "darwin":
        places = [
            f"/Applications/{name}.app/Contents/MacOS/{name}"
            for name in ("Google Chrome", "Chromium", "Microsoft Edge")
        ]
    else:
        keys = ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA")
        homes = [os.environ[key] for key in keys if os.environ.get(key)]
        windows = ("Google/Chrome/Application/chrome.exe", "Microsoft/Edge/Application/msedge.exe")
        places = [f"{home}/{place}" for home in homes for place in windows]
    candidates = [os.environ.get("LABKIT_BROWSER"), *map(shutil.which, names), *places]
    return next((path for path in candidates if path and Path(path).exists()), None)


def print_to_pdf(page: Path, pdf: Path, timeout: float = 120.0) -> bool:
    """print_to_pdf(Path("a.html"), Path("a.pdf")) -> whether there was a browser that did it."""
    browser = find_browser()
    if browser is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "page.pdf"
        command = [
            browser,
            "--headless",
            *FLAGS,
            f"--user-data-dir={folder}/profile",
            "--no-pdf-header-footer",
            f"--print-to-pdf={made}",
            page.resolve().as_uri(),
        ]
        try:
            subprocess.run(command, capture_output=True, timeout=timeout, check=True)
            data = made.read_bytes()
        except (OSError, subprocess.SubprocessError):
            return False
    write_whole(pdf, data)
    return True
