"""Notebooks as files: which there are, running them in a fresh kernel, and what a saved one keeps.

execute("notebooks/part1/00_sample_stable_spiral.ipynb")   # python -m labkit run does so for all
named("part3/06")                                          # the notebook that is meant
strip(notebook)                                            # the save hook of Jupyter does the same

A saved notebook keeps pictures and text and nothing of a widget: model ids would make diffs, a
trusted notebook reopened without a kernel would show "model not found", an exported page an empty
canvas.
"""

from __future__ import annotations

import difflib
import os
import re
import sys
from collections.abc import Callable, MutableMapping
from pathlib import Path
from typing import Any

from .run import _write

__all__ = ["ROOT", "complete", "execute", "executed", "found", "named", "pre_save_hook", "strip"]

ROOT = Path(__file__).resolve().parent.parent
TEMPLATES = Path(__file__).with_name("jupyter") / "nbconvert" / "templates"
#: What labkit's template of an exported page needs besides nbconvert's own filters
FILTERS = {
    "markdown2html": "labkit.page.markdown_to_html",
    "typeset": "labkit.page.typeset",
    "contents": "labkit.page.contents",
}
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


def named(word: str, folder: str | os.PathLike = ROOT / "notebooks") -> Path:
    """named("part3/06") -> the path of the one notebook that is meant.

    A file of one's own (with or without .ipynb), a name below notebooks/, or the beginning of one.
    Raises LookupError with what could have been meant, if it is none or several.
    """
    for path in (Path(word), Path(f"{word}.ipynb")):
        if path.suffix == ".ipynb" and path.is_file():
            return path
    names = {path.relative_to(folder).with_suffix("").as_posix(): path for path in found(folder)}
    name = word.removesuffix(".ipynb").removeprefix("notebooks/")
    if name in names:
        return names[name]
    short = {known: known.rpartition("/")[2] for known in names}
    begins = [known for known in names if name and name in (known, short[known])]
    begins = begins or [
        known for known in names if name and any(n.startswith(name) for n in (known, short[known]))
    ]
    if len(begins) == 1:
        return names[begins[0]]
    if begins:
        raise LookupError(f"{word!r} is not one notebook; say one of: {', '.join(begins)}")
    close = difflib.get_close_matches(name, [*names, *short.values()], n=3)
    meant = [known for known in names if name and name in known]
    meant = meant or [known for known in names if known in close or short[known] in close]
    what = f"; did you mean {' or '.join(meant)}?" if meant else f"; there are {', '.join(names)}"
    raise LookupError(f"{word!r} is no notebook{what}")


def strip(notebook: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """strip(notebook) -> the same object, changed in place: run and saved twice it is one file.

    Where a picture stands beside a widget view, the view goes (a widget without a picture stays a
    line of text). Widget state, time stamps, version numbers and the places where a stream
    happened to be cut go as well.
    """
    metadata = notebook["metadata"]
    metadata.pop("widgets", None)
    if metadata.get("language_info"):
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
            for mime in [mime for mime in data if mime.startswith("application/vnd.labkit.")]:
                del data[mime]  # what only pages hold
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


def complete(notebook: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    """complete(notebook) -> the same object, with what a reader needs and `strip` took.

    Lab writes the kernel's description into a notebook that is opened, and marks it as changed if
    the file said anything else: so the version, which the file does not keep, is put in before.
    Widget views left by other programs go, since without their kernel they show an error.
    """
    strip(notebook)
    language = notebook["metadata"].get("language_info")
    if language and language.get("name") == "python":
        language["version"] = sys.version.split()[0]
    return notebook


def _text(text: str | list[str]) -> str:
    return text if isinstance(text, str) else "".join(text)


def pre_save_hook(model: MutableMapping[str, Any], **_: object) -> None:
    """The `pre_save_hook` of a Jupyter contents manager: strips a notebook that is being saved."""
    if model["type"] == "notebook" and model.get("content"):
        strip(model["content"])


def executed(
    path: str | os.PathLike,
    timeout: float = 300.0,
    notebook: Any = None,
    allow_errors: bool = False,
    **environment: str,
) -> Any:
    """executed("notebooks/start.ipynb") -> the notebook, run from the top in a fresh kernel.

    The kernel works in the notebook's folder, with more variables of the environment if need be.
    `notebook`: a changed copy that runs in its place. Raises nbclient's CellExecutionError with the
    cell's traceback, unless errors are allowed: then the cells after it run as well.
    """
    import nbformat
    from nbclient import NotebookClient

    path = Path(path)
    notebook = nbformat.read(path, as_version=4) if notebook is None else notebook
    client = NotebookClient(
        notebook,
        timeout=timeout,
        allow_errors=allow_errors,
        kernel_name="python3",
        extra_arguments=["--log-level=ERROR"],  # a warning at each start says that TCP is plain
        store_widget_state=False,
        resources={"metadata": {"path": str(path.parent)}},
    )
    client.execute(env=os.environ | environment)
    notebook.metadata["kernelspec"] = {
        "display_name": "Python 3 (ipykernel)",
        "language": "python",
        "name": "python3",
    }
    return notebook


def execute(path: str | os.PathLike, timeout: float = 300.0) -> Path:
    """execute("notebooks/start.ipynb") -> path: runs it in a fresh kernel, strips, saves.

    The file is written whole, and only if every cell ran. Raises as `executed` does.
    """
    import nbformat

    notebook = executed(path, timeout)
    return _write(Path(path), (nbformat.writes(strip(notebook)) + "\n").encode())


def execute_all(paths: list[str], say: Callable[[str], None] = print) -> int:
    """execute_all([]) -> number of notebooks that failed; runs those named, or all.

    After a failure it goes on with the next.
    """
    import time

    from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

    failed = 0
    folders = [found(name) if Path(name).is_dir() else [name] for name in paths]
    for name in [name for names in folders for name in names] or found():
        begin = time.perf_counter()
        try:
            path = execute(named(str(name)))
            say(f"{path}: {time.perf_counter() - begin:.1f} s, {path.stat().st_size / 1000:.0f} kB")
        except (
            CellExecutionError,
            CellTimeoutError,
            DeadKernelError,
            LookupError,
            OSError,
            ValueError,
        ) as error:
            failed += 1
            say(f"{name}: failed\n{error}")
    return failed
