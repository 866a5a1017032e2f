"""The workbook, or a folder of one's own, as a static web site that needs no Python and no network.

Panels are recorded (recorded.py). Files refer to each other relatively and by plain scripts, so
that the site works from a disk or a file share (file://) as well. A page is made anew only when its
notebook or labkit has changed.
"""

from __future__ import annotations

import html
import json
import os
import re
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from pathlib import Path
from typing import Any
from urllib.parse import quote

from .course import heading
from .model import ModelError
from .notebooks import HOME, executed, found, in_one_line, in_parallel, read, state
from .page import Page
from .recorded import MIME, script, style
from .run import unwritable, write_whole

__all__ = ["site"]

STAMPS = "labkit-site.json"
_LINK = re.compile(r'href="(?![a-z]+:|/)([^"#]*)\.ipynb(?=[#"])')
_STYLE = re.compile(r"<style[^>]*>(.*?)</style>", re.DOTALL)
_TAGS = re.compile(r"<(script|style|math|svg)\b.*?</\1>|<[^>]+>", re.DOTALL)
SEARCH = """
<p class="labkit-site">On these pages the panels are recorded: one slider at a time. In the
notebooks themselves (python -m labkit) all move together, and the code is yours to change.</p>
<div class="labkit-search"><label>Search all pages
<input type="search" id="labkit-search" autocomplete="off"></label>
<ul id="labkit-found"></ul></div>
"""


def site(
    folder: str | os.PathLike,
    source: str | os.PathLike = HOME,
    say: Callable[[str], object] = print,
    workers: int | None = None,
) -> int:
    """site("public", "my-project") -> number of notebooks that failed; their old pages stay.

    Runs each notebook below `source` that has no page of its present state, in as many kernels
    as there are cores. Raises ModelError for a folder that holds something else, and for a source
    without notebooks.
    """
    folder, source = Path(folder), Path(source)
    stamps = _stamps(folder)
    names = {path.relative_to(source).with_suffix("").as_posix(): path for path in found(source)}
    if not names:
        raise ModelError(f"there are no notebooks in {str(source)!r}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None

    def keep() -> None:
        write_whole(folder / STAMPS, json.dumps(stamps, indent=1).encode())

    keep()  # from now on it is a site
    wanted = {name: _digest(path) for name, path in names.items()}
    todo = [
        name
        for name, digest in wanted.items()
        if stamps.get(name) != digest or not (folder / place(name)).is_file()
    ]
    seen, failed = [], []

    def done(name: str, task: Future) -> None:
        seen.append(name)
        try:
            size = make_page(task.result(), names[name], name, folder)
        except Exception as error:
            failed.append(name)
            said = f"{name} failed: {in_one_line(error)}"
        else:
            stamps[name] = wanted[name]
            keep()
            said = f"{place(name)}, {size / 1e6:.1f} MB"
        say(f"{len(seen)} of {len(todo)}: {said}")

    in_parallel(lambda name: executed(names[name], LABKIT_RECORD="1"), todo, done, workers)
    for name in stamps.keys() - names.keys():  # of notebooks that are gone
        (folder / place(name)).unlink(missing_ok=True)
        del stamps[name]
    keep()
    _finish(folder, names)
    return len(failed)


def _digest(path: Path) -> str:
    """Of what cannot be read none: it fails again, each time."""
    try:
        return state(read(path))
    except ModelError:
        return ""


def place(name: str) -> str:
    """place("start") -> "index.html", place("part3/06_x") -> "part3/06_x.html"."""
    return "index.html" if name == "start" else f"{name}.html"


def make_page(notebook: Any, path: Path, name: str, folder: Path) -> int:
    """make_page(executed(path), path, "part3/06_x", folder) -> bytes written."""
    text, _ = RecordedPage().from_notebook_node(
        notebook, resources={"metadata": {"name": heading(path), "path": str(path.parent)}}
    )
    up = "../" * name.count("/")
    text = _LINK.sub(lambda m: f'href="{up + "index" if m[1] == up + "start" else m[1]}.html', text)
    # Styles that all pages share stand in one file.
    shared = [style for style in _STYLE.findall(text) if len(style) > 1000]
    text = _STYLE.sub(lambda m: "" if len(m[1]) > 1000 else m[0], text)
    css = "\n".join([*shared, style()]).encode()
    if not (folder / "labkit.css").is_file() or (folder / "labkit.css").read_bytes() != css:
        write_whole(folder / "labkit.css", css)
    head = f'<link rel="stylesheet" href="{up}labkit.css">\n'
    foot = f'<script src="{up}labkit.js"></script>\n' if "labkit-recording" in text else ""
    if place(name) == "index.html":
        text = re.sub(r"(<main[^>]*>)", lambda m: m[1] + SEARCH, text, count=1)
        foot += '<script src="labkit-search.js"></script>\n'
    text = text.replace("</head>", head + "</head>", 1).replace("</body>", foot + "</body>", 1)
    target = folder / place(name)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, text.encode())
    return len(text.encode())


class RecordedPage(Page):
    """A page whose panels play their recordings."""

    @property
    def default_config(self) -> Any:
        config = super().default_config
        config.NbConvertBase.display_data_priority = [
            MIME,
            *config.NbConvertBase.display_data_priority,
        ]
        return config


def _stamps(folder: Path) -> dict[str, str]:
    """Which state of which notebook the pages of an earlier call show."""
    try:
        return dict(json.loads((folder / STAMPS).read_text()))
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError, TypeError) as error:
        raise ModelError(f"{str(folder / STAMPS)!r} cannot be read ({error}): delete it") from None
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ModelError(
            f"{str(folder)!r} exists and holds no site of labkit: name a new or an empty folder"
        )
    return {}


def _finish(folder: Path, names: Iterable[str]) -> None:
    """The player, the words to search in, and a first page where there is none."""
    write_whole(folder / "labkit.js", script().encode())
    pages, listed = [], []
    for name in names:
        path = folder / place(name)
        if not path.is_file():
            continue
        text = path.read_text(encoding="utf-8")
        title = html.unescape(_TAGS.sub("", (re.findall(r"<h1[^>]*>(.*?)<a", text) or [name])[0]))
        body = html.unescape(_TAGS.sub(" ", text.partition("<main")[2]))
        words = sorted(set(re.findall(r"\w{3,}", body.lower())))
        link = quote(place(name))
        pages.append([link, title, " ".join(words)])
        listed.append(f'<li><a href="{link}">{html.escape(title)}</a></li>')
    search = Path(__file__).with_name("search.js").read_text("utf-8")
    data = json.dumps(pages, ensure_ascii=False, separators=(",", ":"))
    write_whole(folder / "labkit-search.js", f"const PAGES = {data};\n{search}".encode())
    if "index.html" not in map(place, names):
        first = (
            '<!doctype html><html lang="en"><meta charset="utf-8"><title>Notebooks</title>'
            f'<link rel="stylesheet" href="labkit.css"><main>{SEARCH}<ul>{"".join(listed)}</ul>'
            '</main><script src="labkit-search.js"></script></html>'
        )
        write_whole(folder / "index.html", first.encode())
