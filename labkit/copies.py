"""A student's own copies of the notebooks of a project, and the frame of a report."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from .course import Assignment, project
from .model import ModelError, listed
from .notebooks import KERNEL, read
from .run import unwritable

__all__ = ["REPORT", "copy_project"]

REPORT = "report.ipynb"
_LINK = re.compile(r"\]\((?![a-z]+:|#)([^)#]+)(#[^)]*)?\)")
OPENING = """# Mini-project {number}

*Name:* …

*Course, date:* …

In two or three sentences: which three systems are in this report, and what is the most interesting
result?"""
QUESTIONS = {
    "The model": "Its equations in your own words. What is assumed, what is left out, where does "
    "it stop to hold?",
    "Values and reasons": "Which values have you chosen for the parameters and the start, and why "
    "these?",
    "Experiments": "What did you vary? What changed in size, and what changed in kind? One picture "
    "and one table are worth more than ten.",
    "The algorithm": "Vary the method, the tolerance or the step, the location of events, and the "
    "length of the simulation. How many digits of your results can be trusted? How do you know?",
    "Theory": "What does theory say, in a formula? Compare in numbers. Where they differ, why?",
}
CLOSING = {
    "A problem of my own": "A question that the handbook does not ask, about one of your systems: "
    "what you expected, what you did, what came out.",
    "The environment": "How is a model written and edited here? What ready-made parts are there? "
    "What happens when a model is wrong? How are results looked at, compared, exported? What could "
    "you not do?",
    "Conclusions": "Three sentences that you would defend.",
}
OWN = """# A place for the computations of your own problem
import labkit"""


def copy_project(number: int, folder: str | os.PathLike) -> list[Path]:
    """copy_project(13, "my-project") -> paths: three notebooks without results, and report.ipynb.

    The project's number stands in each notebook's metadata. All four are written or none; a file
    that is there already is never overwritten. Raises ModelError for a number that is no project, a
    missing notebook, a file that exists, and a folder that cannot be written.
    """
    folder, wanted = Path(folder), project(number)
    number = wanted.number
    if missing := [a.path for a in wanted.assignments if not a.exists]:
        raise ModelError(f"project {number} has no notebook yet for {listed(missing)}")
    pages = {_name(a): _copy(a, number, folder) for a in wanted.assignments}
    pages[REPORT] = _report(number, wanted.assignments)
    texts = {name: nbformat.writes(page) + "\n" for name, page in pages.items()}
    reserved: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if there := [name for name in texts if (folder / name).exists()]:
            raise _taken(folder, there)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".new-") as place:
            for name, text in texts.items():
                (Path(place) / name).write_text(text, encoding="utf-8")
            for name in texts:  # another call may be at work on the same folder
                try:
                    (folder / name).touch(exist_ok=False)
                except FileExistsError:
                    raise _taken(folder, [name]) from None
                reserved.append(folder / name)
            for name in texts:  # all of them are on the disk now
                os.replace(Path(place) / name, folder / name)
            reserved.clear()
    except (OSError, ValueError) as error:
        raise error if isinstance(error, ModelError) else unwritable(folder, error) from error
    finally:  # also when interrupted
        for path in reserved:
            path.unlink(missing_ok=True)
    return [folder / name for name in texts]


def _taken(folder: Path, names: list[str]) -> ModelError:
    return ModelError(
        f"{str(folder)!r} has {listed(names)} already, and nothing was written: take another "
        "folder, or move these files away"
    )


def _name(a: Assignment) -> str:
    return a.path.replace("/", "_") + ".ipynb"


def _copy(a: Assignment, number: int, folder: Path) -> Any:
    """The notebook without results; its links lead from the new place to the workbook."""
    page = read(a.notebook)
    for cell in page.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
        else:
            cell.source = _LINK.sub(lambda m: _linked(m, a.notebook.parent, folder), cell.source)
    page.metadata["labkit"] = {"project": number, "assignment": a.path}
    return page


def _linked(found: re.Match, old: Path, new: Path) -> str:
    goal = (old / found[1]).resolve()
    try:
        path = os.path.relpath(goal, new.resolve())
    except ValueError:  # another drive of Windows
        path = goal.as_uri()
    return f"]({Path(path).as_posix() if '://' not in path else path}{found[2] or ''})"


def _report(number: int, assignments: tuple[Assignment, ...]) -> Any:
    cells: list[Any] = []

    def add(text: str, slide: str = "slide", make: Callable[..., Any] = new_markdown_cell) -> None:
        metadata = {"slideshow": {"slide_type": slide}}
        cells.append(make(text, id=f"report-{len(cells):02}", metadata=metadata))

    add(OPENING.format(number=number))
    for a in assignments:
        add(f"## Part {a.part}. {a.title}\n\n[The notebook]({_name(a)})")
        for head, what in QUESTIONS.items():
            add(f"### {head}\n\n*{what}*", "slide" if head == "Experiments" else "skip")
    for head, what in CLOSING.items():
        add(f"## {head}\n\n*{what}*")
        if head == "A problem of my own":
            add(OWN, "skip", new_code_cell)
    about = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    return new_notebook(cells=cells, metadata={**about, "labkit": {"project": number}})
