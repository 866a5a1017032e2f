"""A teacher's key: the answers of a project, for the values that a student has chosen.

The workbook's notebook runs with the student's parameters and start put into its models; what its
checked cells print then stands beside what the student's notebook prints.
"""

from __future__ import annotations

import ast
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import nbformat

from .answers import MARKS
from .course import project
from .model import ModelError
from .notebooks import HOME, executed, found, read
from .report import checks, with_results

__all__ = ["Key", "key"]

MODELS = ("system", "system_two")
CHECKED = "# NBVAL_CHECK_OUTPUT"
MARK = "labkit: values of the models: "
#: Appended to a student's notebook: the values of its models, as a line of JSON
ASK = f"""\
import json as _json
print({MARK!r} + _json.dumps({{
    _name: {{"values": {{_k: float(_v) for _k, _v in globals()[_name].values()._asdict().items()}},
             "start": {{_k: float(_v) for _k, _v in globals()[_name].start.items()}}}}
    for _name in {MODELS!r} if _name in globals()}}))"""


@dataclass(frozen=True)
class Key:
    """The key to one notebook: `changed` values, checked lines and answers, right and given."""

    name: str
    changed: list[str]
    lines: list[tuple[str, str]]  # what the key prints, what the student's notebook prints
    answers: list[tuple[str, str, str, str]]  # name, right, given, mark
    trouble: str = ""

    def __str__(self) -> str:
        text = [f"== {self.name}"]
        text += [f"   {self.trouble}"] if self.trouble else []
        text += [f"   changed: {', '.join(self.changed)}"] if self.changed else []
        for right, given in self.lines:
            text += [f"   {right}"] if right == given else [f"   key: {right}", f"   has: {given}"]
        for name, right, given, mark in self.answers:
            text.append(f"   {mark or ' '} {name}: {right}" + (f"   has: {given}" if given else ""))
        return "\n".join(text)


def key(which: int | str | os.PathLike) -> Iterator[Key]:
    """key(13) or key("project-13") -> the Key of each notebook, one after the other.

    By the workbook's own values, or by those in a student's folder, beside what the student has.

    Raises ModelError for a number that is no project, and for a folder without a student's copies.
    """
    if isinstance(which, int):
        for a in project(which).assignments:
            yield _own_values(a.notebook, f"{a.path}: {a.title}")
        return
    there = [path for path in found(which) if path.parent == Path(which)]
    copies = {path: name for path in there if (name := _assignment(path))}
    if not copies:
        raise ModelError(
            f"{str(which)!r} has no copies that `python -m labkit new` made: say such a folder, or "
            "a project's number"
        )
    for path, name in copies.items():
        yield _students(path, HOME / f"{name}.ipynb")


def _assignment(path: Path) -> str:
    try:
        return str(read(path).metadata.get("labkit", {}).get("assignment", ""))
    except (ModelError, AttributeError):
        return ""


def _own_values(path: Path, name: str) -> Key:
    cells = executed(path, allow_errors=True, LABKIT_RECORD="answers").cells
    answers = [(asked_for, right, "", "") for asked_for, right, _, _ in _answers(cells)]
    return Key(name, [], [(line, line) for line in _checked(cells)], answers)


def _students(path: Path, original: Path) -> Key:
    """The key with the student's values, beside what the student's notebook has."""
    theirs = with_results(path)
    chosen, default = _values(path), _values(original)
    changed = [
        f"{name}: {what} = {value:g} (workbook {default[name][part].get(what, float('nan')):g})"
        for name, parts in chosen.items()
        if name in default
        for part in ("values", "start")
        for what, value in parts[part].items()
        if default[name][part].get(what) != value
    ]
    right = _run_with(original, chosen).cells
    pairs = list(zip_longest(_checked(right), _checked(theirs.cells), fillvalue="–"))
    given = {name: (answer, mark) for name, _, answer, mark in _answers(theirs.cells)}
    answers = [
        (name, value, *given.get(name, ("–", MARKS[None]))) for name, value, _, _ in _answers(right)
    ]
    return Key(path.name, changed, pairs, answers, theirs.trouble)


def _values(path: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Values and start of a notebook's models, after its last cell."""
    notebook = read(path)
    notebook.cells.append(nbformat.v4.new_code_cell(ASK))
    for output in executed(path, notebook=notebook, allow_errors=True).cells[-1]["outputs"]:
        text = output.get("text", "")
        if text.startswith(MARK):
            return json.loads(text.removeprefix(MARK))
    return {}


def _run_with(original: Path, chosen: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Any:
    """The workbook's notebook, with other values in its models as soon as they are made."""
    notebook = read(original)
    for k, cell in reversed(list(enumerate(notebook.cells, 1))):
        puts = [_put(name, chosen[name]) for name in _makes(cell) if name in chosen]
        notebook.cells[k:k] = map(nbformat.v4.new_code_cell, puts)
    return executed(original, notebook=notebook, allow_errors=True, LABKIT_RECORD="answers")


def _makes(cell: Any) -> list[str]:
    """The models to which a cell gives a name."""
    if cell["cell_type"] != "code":
        return []
    assigned = (node for node in ast.parse(cell["source"]).body if isinstance(node, ast.Assign))
    targets = (name for node in assigned for each in node.targets for name in ast.walk(each))
    names = (name for name in targets if isinstance(name, ast.Name) and name.id in MODELS)
    # system.note = 3 and d[system] = 1 read the name
    return [name.id for name in names if isinstance(name.ctx, ast.Store)]


def _put(name: str, chosen: Mapping[str, Mapping[str, float]]) -> str:
    values, start = dict(chosen["values"]), dict(chosen["start"])
    return (
        f"{name} = {name}.variant({name}.name, "
        f"parameters={{k: v for k, v in {values!r}.items() if k in {name}.parameters}}, "
        f"start={{k: v for k, v in {start!r}.items() if k in {name}.start}})"
    )


def _checked(cells: list[Any]) -> list[str]:
    """The lines that the checked cells print."""
    return [
        line
        for cell in cells
        if cell["cell_type"] == "code" and CHECKED in cell["source"]
        for output in cell["outputs"]
        for line in _said(output).splitlines()
    ]


def _said(output: Any) -> str:
    if output["output_type"] == "error":
        return f"no answer for these values: {output['ename']}: {output['evalue']}"
    return output.get("text", "")


def _answers(cells: list[Any]) -> Iterator[tuple[str, str, str, str]]:
    for name, check in checks(cells):
        given = "–" if check["ok"] is None else check["answer"]
        within = f" (within {check['within']})" if check["within"] else ""
        yield name, check["right"] + within, given, MARKS[check["ok"]]
