"""What several tests need of notebooks and browsers.

load("part3/00_sample_dry_friction")["system"]       the notebook's names after its code cells ran
run_cell("x = 1", "<a cell>", {})["x"]               the names after one cell's text ran
"""

from __future__ import annotations

import functools
import json
import linecache
import os
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "notebooks"
NOTEBOOKS = [
    str(path.relative_to(FOLDER).with_suffix("").as_posix())
    for path in sorted(FOLDER.rglob("*.ipynb"))
    if ".ipynb_checkpoints" not in path.parts
]
ASSIGNMENTS = [name for name in NOTEBOOKS if name.startswith(("part1/", "part2/", "part3/"))]
CONCEPTS = [name for name in NOTEBOOKS if name.startswith("concepts/")]


def read(name: str | Path) -> dict:
    """read("start") -> the notebook as JSON says it."""
    return json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))


def source(cell: dict) -> str:
    return cell["source"] if isinstance(cell["source"], str) else "".join(cell["source"])


def code_cells(notebook: dict) -> list[dict]:
    return [
        cell for cell in notebook["cells"] if cell["cell_type"] == "code" and source(cell).strip()
    ]


@functools.cache
def load(name: str, *wanted: str) -> dict:
    """load("part1/00_sample_stable_spiral") -> namespace after its code cells ran in this process;
    load("part3/13_cork_in_water", "system", "horizon"): after those that it takes to have these.
    Do not change it.

    Cells run as plain Python in the notebook's folder, without a kernel; panels are made but do not
    try their sliders.
    """
    namespace: dict = {"__name__": "__main__", "display": lambda *things, **options: None}
    before = Path.cwd()
    os.chdir((FOLDER / name).parent)
    try:
        with mock.patch.dict(os.environ, LABKIT_CHECK="0"):
            for number, cell in enumerate(code_cells(read(name)), 1):
                run_cell(source(cell), f"<{name}, code cell {number}>", namespace)
                if wanted and namespace.keys() >= set(wanted):
                    break
    finally:
        os.chdir(before)
    return namespace


def run_cell(text: str, place: str, namespace: dict) -> dict:
    """run_cell("x = 1", "<a cell>", {}) -> the namespace after the text ran.

    The text is at hand, as a notebook's is, for tracebacks and to compile models.
    """
    linecache.cache[place] = (len(text), None, text.splitlines(True), place)
    exec(compile(text, place, "exec"), namespace)
    return namespace
