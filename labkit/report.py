"""A folder of notebooks as a report and as slides: each one file that needs no network.

report.html has contents, numbered figures, formulas, folded code and a list of what was predicted;
printed ("Save as PDF") it is a clean A4. slides.html shows the cells that are marked as slides in
JupyterLab (the field "Slide Type"); where a notebook has no marks, its title, pictures, panels and
checked results. Panels are recorded.
"""

from __future__ import annotations

import ast
import copy
import html
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat

from .answers import MARKS
from .answers import MIME as CHECK
from .browser import print_to_pdf
from .copies import REPORT
from .course import opening
from .model import ModelError
from .notebooks import executed, found, in_parallel, read, state
from .page import Page
from .recorded import MIME, script, style
from .run import unwritable, write_whole
from .site import RecordedPage

__all__ = ["checks", "report", "with_results"]

HEADS = ("notebook", "answer to", "mine", "right", "within", "")
RAN = ".labkit"  # the folder of notebooks with results, beside the student's own
_IMAGE = re.compile(r'<div class="jp-RenderedImage[^"]*"[^>]*>\s*(<img[^>]*>)\s*</div>')
_MAIN = re.compile(r"<main[^>]*>(.*)</main>", re.DOTALL)


@dataclass
class Ran:
    """A notebook with its results; `trouble` says which cells failed."""

    path: Path
    notebook: Any
    trouble: str = ""

    @property
    def cells(self) -> list[Any]:
        return self.notebook["cells"]


def report(folder: str | os.PathLike, say: Callable[[str], object] = print) -> list[Path]:
    """report("my-project") -> [report.html, slides.html, and report.pdf where a browser is found].

    Runs the notebooks that have changed since the last call. After a cell that fails the others run
    as well, and the report says which it was. Raises ModelError for a folder without notebooks or
    one that cannot be written.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ModelError(f"there is no folder {str(folder)!r}: python -m labkit new makes one")
    paths = [path for path in found(folder) if path.parent == folder]
    if not paths:
        raise ModelError(f"there are no notebooks in {str(folder)!r}")
    paths.sort(key=lambda path: (path.name != REPORT, path.name))
    _room(folder)
    for path in paths:  # before any of them runs
        read(path)
    ran: dict[Path, Ran] = {}

    def done(path: Path, task: Future) -> None:
        ran[path] = task.result()
        say(f"{len(ran)} of {len(paths)}: {ran[path].trouble or path.name}")

    in_parallel(with_results, paths, done)
    made = [ran[path] for path in paths]
    texts = {"report.html": _report(made), "slides.html": _slides(made)}
    written = [write_whole(folder / name, text.encode()) for name, text in texts.items()]
    pdf = folder / "report.pdf"
    if print_to_pdf(written[0], pdf):
        written.append(pdf)
    elif pdf.exists():
        say(f"{pdf.name} is the one of an earlier call: no browser was found that prints it")
    return written


def _room(folder: Path) -> Path:
    """The folder of what has run, made; a ModelError before anything runs in vain."""
    place = folder / RAN
    try:
        place.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b" " * 2_000_000)  # as much as a small report
    except OSError as error:
        raise unwritable(folder, error) from None
    return place


def with_results(path: Path) -> Ran:
    """with_results(path) -> the notebook as it is now, run unless that was done before."""
    notebook, kept, old = read(path), _room(path.parent) / path.name, None
    digest = state(notebook, "metadata")  # of which the marks of slides are
    with suppress(ModelError):  # there is none, or it is damaged
        old = read(kept)
    if old is not None and old.metadata.get("labkit_ran") == digest:
        for cell, now in zip(old.cells, notebook.cells, strict=True):
            cell.metadata = now.metadata
        return Ran(path, old, _said(path, old))
    try:
        fresh = copy.deepcopy(notebook)  # not the file, which may have changed since
        made = executed(path, notebook=fresh, allow_errors=True, LABKIT_RECORD="1")
    except ModelError as error:
        shown = "an earlier run" if old is not None else "what the file has saved"
        return Ran(path, old or notebook, f"{error}; shown is {shown}")
    made.metadata |= {"labkit_ran": digest, "labkit_trouble": _errors(made)}
    write_whole(kept, nbformat.writes(made).encode())
    return Ran(path, made, _said(path, made))


def _errors(notebook: Any) -> list[str]:
    """Which cells failed; in the page their tracebacks are one line."""
    found = []
    for number, cell in enumerate(notebook["cells"], 1):
        for k, output in enumerate(cell.get("outputs", [])):
            if output["output_type"] == "error":
                said = f"{output['ename']}: {output['evalue']}".strip(": ")
                found.append(f"cell {number}: {said}")
                text = f"This cell failed. {said}\n"
                cell["outputs"][k] = nbformat.v4.new_output("stream", name="stderr", text=text)
    return found


def _said(path: Path, notebook: Any) -> str:
    found = notebook.metadata.get("labkit_trouble")
    return f"{path.name}, what failed: {'; '.join(found)}" if found else ""


# ---- the report


def _report(ran: list[Ran]) -> str:
    cells = copy.deepcopy([cell for one in ran for cell in one.cells])
    for k, cell in enumerate(cells):  # copies of one notebook have the same names of cells
        cell["id"] = f"cell-{k}"
    whole = nbformat.v4.new_notebook(cells=cells)
    resources = {"metadata": {"name": _title(ran)}, "fold": True, "contents": "12"}
    text, _ = Page().from_notebook_node(whole, resources)
    head = "".join(
        f'<p class="labkit-not-run">{html.escape(one.trouble)}</p>' for one in ran if one.trouble
    )
    text = re.sub(r"(<main[^>]*>)", lambda m: m[1] + head, text, count=1)
    text = _numbered(text)
    text = re.sub(r'(<body[^>]*class=")', r"\1labkit-report ", text, count=1)
    return text.replace("</main>", _answers(ran) + "</main>", 1)


def _numbered(text: str) -> str:
    """Pictures become figures with a number and, from their alternative text, a caption."""
    count = 0

    def figure(found: re.Match) -> str:
        nonlocal count
        count += 1
        alt = re.search(r'alt="([^"]*)"', found[1])
        said = html.unescape(alt[1]).partition("\n")[0].partition(": ")[0] if alt else ""
        caption = f"<b>Figure {count}.</b> {html.escape(said)}"
        return f'<figure id="figure-{count}">{found[1]}<figcaption>{caption}</figcaption></figure>'

    return _IMAGE.sub(figure, text)


def _answers(ran: list[Ran]) -> str:
    """What was predicted and answered, in a table at the end."""
    rows, right = [], 0
    for one in ran:
        for name, check in checks(one.cells):
            said = [check[key] for key in ("answer", "right", "within")]
            given = said if check["ok"] is not None else ("–", "", "")
            cells = (one.path.stem, name, *given, MARKS[check["ok"]])
            rows.append("".join(f"<td>{html.escape(cell)}</td>" for cell in cells))
            right += check["ok"] is True
    if not rows:
        return ""
    head = "".join(f"<th>{h}</th>" for h in HEADS)
    lines = "".join(f"<tr>{row}</tr>" for row in rows)
    return (
        '<div class="jp-RenderedHTMLCommon"><h1 id="predictions">Predictions and answers</h1>'
        f"<p>{right} of {len(rows)} right.</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


def checks(cells: list[Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """checks(notebook.cells) -> name of an answer and what `check` found, for each one shown."""
    for cell in cells:
        for output in cell.get("outputs", []):
            if CHECK in output.get("data", {}):
                yield _asked(cell["source"]), output["data"][CHECK]


def _asked(source: str) -> str:
    """check(my_period, 4.7) -> "my_period", of the last `check` of a cell."""
    try:
        calls = [
            node
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "check" and node.args
        ]
    except SyntaxError:
        return ""
    return ast.unparse(calls[-1].args[0]) if calls else ""


def _title(ran: list[Ran]) -> str:
    return opening(ran[0].cells)[0] or ran[0].path.stem


# ---- slides


def _slides(ran: list[Ran]) -> str:
    exporter, pages, shell, title = RecordedPage(), [], "", _title(ran)
    groups = [cells for one in ran for cells in _groups(one.cells)]
    for cells in groups or [[nbformat.v4.new_markdown_cell(f"# {title}")]]:
        part = nbformat.v4.new_notebook(cells=copy.deepcopy(cells))
        for cell in part.cells:  # code only where it is the point of the slide
            if cell["cell_type"] == "code" and cell["outputs"]:
                cell["metadata"]["jupyter"] = {"source_hidden": True}
        resources = {"metadata": {"name": title}, "contents": ""}
        shell, _ = exporter.from_notebook_node(part, resources)
        pages.append(f"<section>{_MAIN.search(shell)[1]}</section>")
    here = Path(__file__).parent
    look = f"<style>{style()}{(here / 'slides.css').read_text('utf-8')}</style></head>"
    keys = f"<script>{script()}</script><script>{(here / 'slides.js').read_text('utf-8')}</script>"
    text = _MAIN.sub(lambda m: f"<main>{''.join(pages)}</main>{keys}", shell)
    return text.replace("</head>", look, 1)


def _groups(cells: list[Any]) -> list[list[Any]]:
    """Cells slide by slide, as marked; without marks by what is worth showing."""
    kinds = [cell["metadata"].get("slideshow", {}).get("slide_type", "") for cell in cells]
    if not any(kind in ("slide", "subslide") for kind in kinds):
        return list(_worth_showing(cells))
    groups: list[list[Any]] = []
    for cell, kind in zip(cells, kinds, strict=True):
        if kind in ("slide", "subslide"):
            groups.append([cell])
        elif groups and kind not in ("skip", "notes"):
            groups[-1].append(cell)
    return groups


def _worth_showing(cells: list[Any]) -> Iterator[list[Any]]:
    """The title; then each picture, panel and checked result under its section's heading."""
    heading = ""
    for cell in cells:
        if cell["cell_type"] == "markdown":
            if cell["source"].startswith("# "):
                first = cell["source"].split("\n\n")
                yield [nbformat.v4.new_markdown_cell("\n\n".join(first[:2]))]
            heads = re.findall(r"^## (.*)", cell["source"], re.MULTILINE)
            heading = heads[-1] if heads else heading
        elif "# NBVAL_CHECK_OUTPUT" in cell["source"] or any(
            MIME in output.get("data", {}) or "image/png" in output.get("data", {})
            for output in cell.get("outputs", ())
        ):
            yield [nbformat.v4.new_markdown_cell(f"## {heading}"), cell]
