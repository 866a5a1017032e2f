"""Notebooks as files: which there are, running them in a fresh kernel, and what a saved one keeps.

A saved notebook keeps pictures and text and nothing of a widget: model ids would make diffs, a
trusted notebook reopened without a kernel would show "model not found", an exported page an empty
canvas.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import re
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterable, MutableMapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from .model import ModelError
from .run import write_whole

__all__ = [
    "ROOT",
    "complete",
    "execute",
    "executed",
    "found",
    "in_one_line",
    "in_parallel",
    "named",
    "parsed",
    "pre_save_hook",
    "read",
    "state",
    "strip",
]

ROOT = Path(__file__).resolve().parent.parent
HOME = ROOT / "notebooks"
TEMPLATES = Path(__file__).with_name("jupyter") / "nbconvert" / "templates"
#: What labkit's template of an exported page needs besides nbconvert's own filters
FILTERS = {
    "markdown2html": "labkit.page.markdown_to_html",
    "typeset": "labkit.page.typeset",
    "contents": "labkit.page.contents",
}
WIDGET = "application/vnd.jupyter.widget-view+json"
KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
#: What the kernel says of itself and is not of this machine or day.
LANGUAGE = {"codemirror_mode", "file_extension", "mimetype", "name"}
LANGUAGE |= {"nbconvert_exporter", "pygments_lexer"}


def found(folder: str | os.PathLike = HOME) -> list[Path]:
    """found() -> all notebooks under notebooks/, sorted, without Jupyter's checkpoints."""
    return sorted(
        path
        for path in Path(folder).rglob("*.ipynb")
        if not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )


def named(word: str, folder: str | os.PathLike = HOME) -> Path:
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
    words = {known: (known, known.rpartition("/")[2]) for known in names}

    def those(fits: Callable[[str], bool]) -> list[str]:
        return [known for known, both in words.items() if name and any(map(fits, both))]

    begins = those(name.__eq__) or those(lambda known: known.startswith(name))
    if len(begins) == 1:
        return names[begins[0]]
    if begins:
        raise LookupError(f"{word!r} is not one notebook; say one of: {', '.join(begins)}")
    close = difflib.get_close_matches(name, [each for both in words.values() for each in both])
    meant = those(lambda known: name in known) or those(close.__contains__)
    what = f"; did you mean {' or '.join(meant)}?" if meant else f"; there are {', '.join(names)}"
    raise LookupError(f"{word!r} is no notebook{what}")


def parsed(path: str | os.PathLike) -> Any:
    """parsed("my.ipynb") -> the file's JSON as it is; some editors put a mark at its beginning."""
    return json.loads(Path(path).read_text(encoding="utf-8-sig"))


def read(path: str | os.PathLike) -> Any:
    """read("my.ipynb") -> the notebook; what a hand that has edited the file left out is put in.

    Raises ModelError for a file that is no notebook or cannot be read.
    """
    import nbformat

    try:
        page = parsed(path)
        page.setdefault("metadata", {})
        for cell in page.get("cells", ()):
            cell.setdefault("metadata", {})
            if cell["cell_type"] == "code":
                cell.setdefault("outputs", [])
                cell.setdefault("execution_count", None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cells without a name, or two of one
            notebook = nbformat.convert(nbformat.reader.reads(json.dumps(page)), 4)
            nbformat.validate(notebook)
    except Exception as error:
        said = getattr(error, "strerror", None) or in_one_line(error, first=True)
        raise ModelError(
            f"{str(path)!r} is no notebook ({said}): take another one, or an earlier copy of it"
        ) from None
    return notebook


def state(notebook: Any, *without: str) -> str:
    """state(notebook, "metadata") -> a digest of its cells, without these parts, and of labkit."""
    results = {"id", "outputs", "execution_count", *without}
    cells = [{k: v for k, v in cell.items() if k not in results} for cell in notebook["cells"]]
    text = json.dumps(cells, sort_keys=True).encode()
    return hashlib.sha256(_package() + text).hexdigest()


@cache
def _package() -> bytes:
    """labkit's own files, as they are now."""
    kinds = (".py", ".js", ".css", ".j2")
    paths = sorted(path for path in Path(__file__).parent.rglob("*") if path.suffix in kinds)
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).digest()


def in_one_line(error: BaseException, first: bool = False) -> str:
    """in_one_line(error) -> the last line of its text, which in a cell's traceback names it."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    lines = [line.strip() for line in text.splitlines() if line.strip("- ")]  # and no rules
    return lines[0 if first else -1] if lines else type(error).__name__


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
            stream = output["output_type"] == "stream" == last.get("output_type")
            if stream and output["name"] == last["name"]:
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
    cell's traceback, unless errors are allowed: then the cells after it run as well. Raises
    ModelError for what is no notebook, and for a kernel that dies, takes too long or never starts.
    """
    import zmq
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError
    from traitlets.config import Config

    path = Path(path)
    notebook = read(path) if notebook is None else notebook
    private = "auto" if zmq.has("curve") else "disabled"
    client = NotebookClient(
        notebook,
        timeout=timeout,
        allow_errors=allow_errors,
        kernel_name="python3",
        extra_arguments=["--log-level=ERROR"],  # a warning at each start says that TCP is plain
        store_widget_state=False,
        resources={"metadata": {"path": str(path.parent)}},
        config=Config(KernelManager={"transport_encryption": private}),
    )
    _at_work.add(client)
    try:
        client.execute(env=os.environ | environment)
    except CellExecutionError:
        raise
    except Exception as error:  # no time, no memory, no kernel
        said = f"{path.name} did not run to its end ({in_one_line(error)})"
        raise ModelError(f"{said}: run it in Jupyter, cell by cell") from error
    finally:
        _at_work.discard(client)
    notebook.metadata["kernelspec"] = dict(KERNEL)
    return notebook


_at_work: set[Any] = set()  # clients of kernels


def in_parallel(
    work: Callable[[Any], Any],
    items: Iterable[Any],
    done: Callable[[Any, Future], object],
    workers: int | None = None,
) -> None:
    """in_parallel(executed, paths, lambda path, task: …) calls it here as one after the other ends.

    An interrupt, or an error in `done`, ends the kernels that `executed` has begun.
    """
    from jupyter_core.utils import ensure_event_loop

    def alone(item: Any) -> Any:
        try:
            return work(item)
        finally:
            ensure_event_loop().close()  # this thread's, which Jupyter's client leaves open

    tasks: dict[Future, Any] = {}
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        try:
            tasks = {pool.submit(alone, item): item for item in items}
            for task in as_completed(tasks):
                done(tasks.pop(task), task)
        finally:
            while not all([task.cancel() or task.done() for task in tasks]):
                for client in tuple(_at_work):
                    with suppress(AttributeError, TypeError, OSError):  # not begun, or ended
                        os.kill(client.km.provisioner.pid, _KILL)
                time.sleep(0.2)


_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


def execute(path: str | os.PathLike, timeout: float = 300.0) -> Path:
    """execute("notebooks/start.ipynb") -> path: runs it in a fresh kernel, strips, saves.

    The file is written whole, and only if every cell ran. Raises as `executed` does.
    """
    import nbformat

    notebook = executed(path, timeout)
    return write_whole(Path(path), (nbformat.writes(strip(notebook)) + "\n").encode())


def execute_all(paths: list[str], say: Callable[[str], None] = print) -> int:
    """execute_all([]) -> number of notebooks that failed; runs those named, or all.

    After a failure it goes on with the next.
    """

    def one(name: str | Path) -> str:
        begin = time.perf_counter()
        path = execute(named(str(name)))
        return f"{path}: {time.perf_counter() - begin:.1f} s, {path.stat().st_size / 1000:.0f} kB"

    def done(name: str | Path, task: Future) -> None:
        if error := task.exception():
            failed.append(name)
        say(f"{name}: failed\n{error}" if error else task.result())

    failed: list[str | Path] = []
    names: list[str | Path] = []
    for name in paths or [HOME]:
        names += found(name) if Path(name).is_dir() else [name]
    if not names:
        raise ModelError(f"there are no notebooks in {' and '.join(map(repr, paths))}")
    in_parallel(one, names, done, workers=1)
    return len(failed)
