"""Results as files and tables: CSV, NPZ, Parquet, pandas.

run.to_csv("ball.csv"); run.to_npz("ball.npz"); run.to_frame(); run.to_parquet("ball.parquet")
repeated(ball, "ball.csv")                  # the run that the file says, made once more
how(run)                                    # what the file says: model, parameters, options

Every file says how its run was made. In a CSV file that is the first line, a comment:
pandas.read_csv("ball.csv", comment="#"). Files are written whole or not at all.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import asked
from .model import ModelError, System

if TYPE_CHECKING:
    from .run import Run

__all__ = ["frame", "how", "lines", "parquet", "repeated", "zipped"]


def how(run: Run) -> dict[str, Any]:
    """how(run) -> {"model", "parameters", "options", "ended"}, all of it plain values."""
    options = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in run.options.items()
        if value is not None and name != "backend"  # where it was made, not what it is
    }
    return {
        "model": run.system.name,
        "parameters": run.p._asdict(),
        "options": options,
        "ended": run.stopped,
    }


@asked
def repeated(system: System, path: str | os.PathLike) -> Run:
    """repeated(ball, "ball.csv") -> Run, as the file says that it was made.

    From a CSV, NPZ or Parquet file of a run. Raises ModelError for a file that does not say it, and
    for a model of another name.
    """
    from .solve import simulate

    said = _read(Path(path))
    if not isinstance(said, dict) or not {"model", "parameters", "options"} <= said.keys():
        raise ModelError(f"{str(path)!r} does not say how its run was made: write it with labkit")
    if said["model"] != system.name:
        raise ModelError(
            f"{str(path)!r} holds a run of {said['model']!r}, and the model is {system.name!r}"
        )
    return simulate(system, **said["options"], **said["parameters"])


def _read(path: Path) -> Any:
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as data:
                return json.loads(str(data["how"]))
        if path.suffix == ".parquet":
            from pyarrow.parquet import read_schema

            return json.loads((read_schema(path).metadata or {}).get(b"labkit", b"null"))
        with path.open(encoding="utf-8") as file:
            first = file.readline()
        return json.loads(first.removeprefix("#")) if first.startswith("#") else None
    except ImportError:
        raise _missing("a Parquet file", "pyarrow") from None
    except Exception as error:  # a damaged file says it in many ways
        said = getattr(error, "strerror", None) or error
        raise ModelError(f"{str(path)!r} cannot be read ({said})") from None


def lines(heads: Sequence[str], rows: Iterable[Iterable[object]], said: object = None) -> bytes:
    """lines(["t [s]", "y [m]"], rows, how(run)) -> a CSV file; numbers to the last bit."""
    text = io.StringIO(newline="")
    if said is not None:
        text.write(f"# {json.dumps(said, ensure_ascii=False)}\n")
    writer = csv.writer(text)
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue().encode()


def zipped(run: Run, columns: Mapping[str, np.ndarray]) -> bytes:
    """zipped(run, run.columns()) -> an NPZ file: columns, parameters, ledger, and how."""
    data = io.BytesIO()
    parameters = {f"p.{name}": x for name, x in run.p._asdict().items()}
    ledger = {
        "event.t": [e.t for e in run.events],
        "event.transition": np.array([e.transition for e in run.events], dtype=str),
    }
    more = {"stopped": run.stopped, "how": json.dumps(how(run), ensure_ascii=False)}
    np.savez_compressed(data, **columns, **parameters, **ledger, **more)
    return data.getvalue()


def frame(columns: Mapping[str, Any], said: object = None) -> Any:
    """frame(run.columns(), how(run)) -> pandas.DataFrame; `how` is in its attrs."""
    try:
        import pandas
    except ImportError:
        raise _missing("a data frame", "pandas") from None
    made = pandas.DataFrame(dict(columns))
    if said is not None:
        made.attrs["how"] = said
    return made


def parquet(columns: Mapping[str, np.ndarray], said: object) -> bytes:
    """parquet(run.columns(), how(run)) -> a Parquet file; how stands in its metadata, `labkit`."""
    try:
        import pyarrow
        from pyarrow import parquet as writer
    except ImportError:
        raise _missing("a Parquet file", "pyarrow") from None
    table = pyarrow.table({name: column.tolist() for name, column in columns.items()})
    table = table.replace_schema_metadata({"labkit": json.dumps(said, ensure_ascii=False)})
    data = io.BytesIO()
    writer.write_table(table, data)
    return data.getvalue()


def _missing(what: str, package: str) -> ModelError:
    return ModelError(
        f"{what} needs {package}: pip install {package} (to_csv, to_npz and columns() work without)"
    )
