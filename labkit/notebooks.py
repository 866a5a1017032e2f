"""Notebooks as files: which there are, running them in a fresh kernel, and what a saved one keeps.

    execute("notebooks/part1/00_sample_stable_spiral.ipynb")     # python -m labkit run does this for all
    strip(notebook)                                              # the save hook of labkit's own server does the same

A saved notebook keeps pictures and text and nothing of a widget: model ids would make diffs, a trusted notebook
reopened without a kernel would show "model not found", an exported page an empty canvas.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, MutableMapping
from pathlib import Path
from typing import Any

from .run import _write

__all__ = ["ROOT", "execute", "found", "pre_save_hook", "strip"]

ROOT = Path(__file__).resolve().parent.parent
WIDGET = "application/vnd.jupyter.widget-view+json"
#: What the kernel says of itself and is not of this machine or day.
LANGUAGE = {
    "codemirror_mode",
    "file_extension",
    "mimetype",
    "name",
    "nbconvert_exporter",
    "pygments_lexer",
}


def found(folder: str | os.PathLike = ROOT / "notebooks") -> list[Path]:
    """found() -> all notebooks under notebooks/, sorted, without Jupyter's checkpoints."""
    return sorted(
        path
        for path in Path(folder).rglob("*.ipynb")
        if not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )


def strip(notebook: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """strip(notebook) -> the same object, changed in place, so that running and saving it twice gives the same file.

    Where a picture stands beside a widget view, the view goes (a widget without a picture stays a line of text). Widget
    state, time stamps, version numbers and the places where a stream happened to be cut go as well.
    """
    metadata = notebook["metadata"]
    metadata.pop("widgets", None)
    if "language_info" in metadata:
        metadata["language_info"] = {
            key: value for key, value in metadata["language_info"].items() if key in LANGUAGE
        }
    for cell in notebook["cells"]:
        for key in ("execution", "ExecuteTime"):
            cell["metadata"].pop(key, None)
        if cell["cell_type"] != "code":
            continue
        outputs: list[Any] = []
        for output in cell["outputs"]:
            data = output.get("data", {})
            if data.pop(WIDGET, None) is not None and "image/png" not in data:
                data["text/plain"] = "widget: run the cell to see it"
            if isinstance(data.get("text/plain"), str):
                data["text/plain"] = re.sub(r" at 0x[0-9a-fA-F]+", "", data["text/plain"])
            last = outputs[-1] if outputs else {}
            if (
                output["output_type"] == "stream" == last.get("output_type")
                and output["name"] == last["name"]
            ):
                last["text"] = _text(last["text"]) + _text(output["text"])
            else:
                outputs.append(output)
        cell["outputs"] = outputs
    return notebook


def _text(text: str | list[str]) -> str:
    return text if isinstance(text, str) else "".join(text)


def pre_save_hook(model: MutableMapping[str, Any], **_: object) -> None:
    """The `pre_save_hook` of a Jupyter contents manager: strips a notebook that is being saved."""
    if model["type"] == "notebook" and model.get("content"):
        strip(model["content"])


def execute(path: str | os.PathLike, timeout: float = 300.0) -> Path:
    """execute("notebooks/start.ipynb") -> path: runs all cells in a fresh kernel in the notebook's folder, strips, saves.

    The file is written whole, and only if every cell ran. Raises nbclient's CellExecutionError with the cell's traceback.
    """
    import nbformat
    from nbclient import NotebookClient

    path = Path(path)
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=timeout,
        kernel_name="python3",
        store_widget_state=False,
        resources={"metadata": {"path": str(path.parent)}},
    )
    client.execute()
    notebook.metadata["kernelspec"] = {
        "display_name": "Python 3 (ipykernel)",
        "language": "python",
        "name": "python3",
    }
    return _write(path, (nbformat.writes(strip(notebook)) + "\n").encode())


def execute_all(paths: list[str], say: Callable[[str], None] = print) -> int:
    """execute_all([]) -> number of notebooks that failed; executes those named, or all, and goes on after a failure."""
    import time

    from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

    failed = 0
    for path in map(Path, paths) if paths else found():
        begin = time.perf_counter()
        try:
            execute(path)
            say(f"{path}: {time.perf_counter() - begin:.1f} s, {path.stat().st_size / 1000:.0f} kB")
        except (
            CellExecutionError,
            CellTimeoutError,
            DeadKernelError,
            OSError,
            ValueError,
        ) as error:
            failed += 1
            say(f"{path}: failed\n{error}")
    return failed
