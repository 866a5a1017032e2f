"""What a simulation leaves behind: samples, values at any time, the event ledger, the work done, export.

run = simulate(ball, 12.0, e=0.9)
run.t, run["y"], run.at(3.2)["v"], run.events[0].t, run.stopped, run.mode
run.to_csv("ball.csv"); run.to_npz("ball.npz"); load_npz("ball.npz")["y"]; run.to_frame()
"""

from __future__ import annotations

import csv
import io
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from .model import ModelError, System, listed

__all__ = ["Event", "Run", "Runs", "Touch", "Work", "load_npz"]


@dataclass(frozen=True)
class Event:
    """One line of the ledger: run.events[0].t, .transition, .source, .target, .before["v"], .after["v"]."""

    t: float
    transition: str
    source: str
    target: str | None
    before: Mapping[str, float]
    after: Mapping[str, float]
    index: int

    def __str__(self) -> str:
        # differences of rounding size would tell of the machine, not of the system
        pairs = [
            (k, self.before[k], v)
            for k, v in self.after.items()
            if k in self.before and abs(v - self.before[k]) > 1e-9 * (1 + abs(v))
        ]
        changed = ", ".join(f"{k} {old:.6g} → {new:.6g}" for k, old, new in pairs)
        return f"{self.t:12.6f}  {self.transition}: {self.source} → {self.target or 'end'}" + (
            f"  ({changed})" if changed else ""
        )


@dataclass(frozen=True)
class Touch:
    """A limit that was touched and not passed: run.touches[0].t, .transition, .by, the guard at its highest (0 … the transition's tolerance)."""

    t: float
    transition: str
    by: float

    def __str__(self) -> str:
        return f"{self.t:12.6f}  {self.transition}: touched, no event (by {self.by:.3g})"


class Events(Sequence):
    """Events(count, make): the ledger as a sequence; make() gives the list of Event, and is called when somebody looks."""

    def __init__(self, count: int, make: Callable[[], list[Event]]):
        self._count, self._make = count, make

    @cached_property
    def _events(self) -> list[Event]:
        return self._make()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int | slice) -> Event | list[Event]:
        return self._events[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._events == list(other)

    def __repr__(self) -> str:
        return repr(self._events)


@dataclass(frozen=True)
class Work:
    """What it cost: accepted and rejected steps, evaluations of flows and guards, events, seconds, and by which means."""

    steps: int
    rejected: int
    evaluations: int
    guard_evaluations: int
    events: int
    seconds: float
    method: str
    backend: str


@dataclass(frozen=True, repr=False)
class Run:
    """The result of `simulate`. Arrays have one entry a sample, in the order of hybrid time (t, j).

    t        (m,) time. An event adds two samples at one instant: before and after
    j        (m,) number of events so far; each sample advances t or j, never both
    mode     (m,) name of the mode of each sample
    run[n]   (m,) a state or output; NaN in modes that do not have it
    events   the ledger, a sequence of Event
    touches  limits that a guard came up to without passing them, a list of Touch (the first 64)
    stopped  why it ended: "finished", 'terminal event "destroyed"', "Zeno at …"
    p        the parameters used, p.g; work: the Work done
    """

    system: System
    p: tuple
    t: np.ndarray
    j: np.ndarray
    mode_index: np.ndarray
    values: np.ndarray  # (m, most states of any mode)
    events: Sequence[Event]
    stopped: str
    work: Work
    pieces: np.ndarray  # one row a step: t0, h, mode, then the coefficients of its polynomial in (t − t0)/h, lowest first
    touches: list[Touch] = field(default_factory=list)

    @cached_property
    def mode(self) -> np.ndarray:
        return np.array(list(self.system.modes), dtype=object)[self.mode_index]

    @property
    def start(self) -> dict[str, float]:
        return self._state(0)

    @property
    def final(self) -> dict[str, float]:
        """State names and values at the end, after the last event."""
        return self._state(-1)

    def _state(self, row: int) -> dict[str, float]:
        names = self.system.states_of(self.mode[row])
        return dict(zip(names, self.values[row].tolist(), strict=False))

    def __getitem__(self, name: str) -> np.ndarray:
        return _column(self.system, self.p, name, self.t, self.mode_index, self.values)

    def at(self, t: float | np.ndarray, side: str = "after") -> dict[str, float | np.ndarray]:
        """run.at(3.2)["v"]: every state and output at one time or an array of times, and "mode".

        From the polynomial of the step that holds t, to the accuracy of the method. At the instant of an event
        `side` chooses the value "before" it (the first one) or "after" it (the last one).
        Raises ModelError when t lies outside the run.
        """
        if side not in ("before", "after"):
            raise ModelError(f"side is 'before' or 'after', not {side!r}")
        when = np.atleast_1d(np.asarray(t, dtype=float))
        first, last = self.t[0], self.t[-1]
        if not np.all((when >= first) & (when <= last)):
            raise ModelError(
                f"t = {when[~((when >= first) & (when <= last))][0]:g} lies outside the run, {first:g} … {last:g}"
            )
        width = self.values.shape[1]
        modes = np.full(when.shape, self.mode_index[-1])
        values = np.repeat(self.values[-1:], len(when), axis=0)
        if len(self.pieces):
            index = (
                np.searchsorted(
                    self.pieces[:, 0], when, side="right" if side == "after" else "left"
                )
                - 1
            )
            inside = np.ones(len(when), dtype=bool)
            if side == "after":
                inside = when < last
            else:
                inside = index >= 0  # before the first instant there is only the start itself
                modes[~inside], values[~inside] = self.mode_index[0], self.values[0]
            piece = self.pieces[index[inside]]
            theta = ((when[inside] - piece[:, 0]) / piece[:, 1])[:, None]
            modes[inside] = piece[:, 2].astype(int)
            coefficients = piece[:, 4:].reshape(
                len(piece), (self.pieces.shape[1] - 4) // width, width
            )  # not -1: there may be no piece
            y = np.zeros((len(piece), width))
            for k in range(coefficients.shape[1] - 1, -1, -1):
                y = y * theta + coefficients[:, k]
            values[inside] = y
        found = {
            name: _column(self.system, self.p, name, when, modes, values)
            for name in (*self.system.units, *self.system.outputs)
        }
        found["mode"] = np.array(list(self.system.modes), dtype=object)[modes]
        return {
            key: value.tolist()[0] if np.ndim(t) == 0 else value for key, value in found.items()
        }

    def ledger(self) -> str:
        """print(run.ledger()): events and touched limits, one a line, and why the run ended."""
        return "\n".join(
            [
                *map(str, sorted([*self.events, *self.touches], key=lambda line: line.t)),
                f"{self.t[-1]:12.6f}  {self.stopped}",
            ]
        )

    def columns(self) -> dict[str, np.ndarray]:
        """run.columns() -> {"t", "j", "mode", every state, every output}: what the exports hold."""
        return {
            "t": self.t,
            "j": self.j,
            "mode": self.mode.astype(str),
            **{n: self[n] for n in (*self.system.units, *self.system.outputs)},
        }

    def to_csv(self, path: str | os.PathLike) -> Path:
        """run.to_csv("ball.csv") -> path. UTF-8, a header with units, numbers that read back to the same bits.

        The file is written whole or not at all. Raises ModelError when it cannot be written; the run is not touched.
        """
        columns = self.columns()
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(
            [
                n
                if n in ("j", "mode")
                else f"{n} [{self.system.unit(n)}]"
                if self.system.unit(n)
                else n
                for n in columns
            ]
        )
        writer.writerows(zip(*(c.tolist() for c in columns.values()), strict=True))
        return _write(path, text.getvalue().encode())

    def to_npz(self, path: str | os.PathLike) -> Path:
        """run.to_npz("ball.npz") -> path. All columns, parameters and the ledger; `load_npz` reads it back exactly."""
        data = io.BytesIO()
        parameters = {
            f"p.{name}": value for name, value in zip(self.p._fields, self.p, strict=True)
        }
        ledger = {
            "event.t": [e.t for e in self.events],
            "event.transition": np.array([e.transition for e in self.events], dtype=str),
        }
        np.savez_compressed(data, **self.columns(), **parameters, **ledger, stopped=self.stopped)
        return _write(path, data.getvalue())

    def to_frame(self):
        """run.to_frame() -> pandas.DataFrame of all columns. Raises ModelError when pandas is not installed."""
        try:
            import pandas
        except ImportError:
            raise ModelError(
                "a data frame needs pandas: pip install pandas (run.to_csv and run.columns() work without)"
            ) from None
        return pandas.DataFrame(self.columns())

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return f"Run of {self.system.name!r}: t = {self.t[0]:g} … {self.t[-1]:g} {self.system.time}, {len(self)} samples, {len(self.events)} events, {self.stopped}"


@dataclass(frozen=True, repr=False)
class Runs:
    """The result of `simulate_many`: many runs as rectangular arrays, one row a run, padded at the end with NaN.

    t, runs[n]   (lanes, m); mode_index (lanes, m) with −1 in the padding; runs[3] is the Run-like view of one lane
    final        state name -> (lanes,) values at the end;  stopped: list of reasons;  events: (lanes,) number of events
    """

    system: System
    p: list[tuple]
    t: np.ndarray
    mode_index: np.ndarray
    values: np.ndarray  # (lanes, m, most states)
    events: np.ndarray
    stopped: list[str]
    work: Work

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.system.units:  # the parameters do not matter: all lanes at once
            return _column(
                self.system,
                (),
                name,
                self.t.ravel(),
                self.mode_index.ravel(),
                self.values.reshape(-1, self.values.shape[2]),
            ).reshape(self.t.shape)
        return np.array(
            [
                _column(self.system, p, name, t, m, v)
                for p, t, m, v in zip(self.p, self.t, self.mode_index, self.values, strict=True)
            ]
        )

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        """for lane in runs: lane["t"], lane["mode_index"], lane["x"] … without the padding."""
        for p, t, m, v in zip(self.p, self.t, self.mode_index, self.values, strict=True):
            k = m >= 0
            yield {
                "t": t[k],
                "mode_index": m[k],
                **{n: _column(self.system, p, n, t[k], m[k], v[k]) for n in self.system.units},
            }

    @property
    def final(self) -> dict[str, np.ndarray]:
        last = (self.mode_index >= 0).sum(axis=1) - 1
        lanes = np.arange(len(self))
        t, modes, values = (
            self.t[lanes, last],
            self.mode_index[lanes, last],
            self.values[lanes, last],
        )
        return {
            name: _column(self.system, (), name, t, modes, values) for name in self.system.units
        }

    def __repr__(self) -> str:
        return (
            f"Runs of {self.system.name!r}: {len(self)} runs, up to {self.t.shape[1]} samples each"
        )


def _column(
    system: System, p: tuple, name: str, t: np.ndarray, modes: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """One state or output over samples of mixed modes; NaN where the mode does not have it."""
    result = np.full(len(t), np.nan)
    keys = list(system.modes)
    if name not in system.units and name not in system.outputs:
        raise ModelError(
            f"{name!r} is neither a state nor an output of {system.name!r}; there are {listed([*system.units, *system.outputs])}"
        )
    for index, key in enumerate(keys):
        here = np.flatnonzero(modes == index)
        if not len(here):
            continue
        names = system.states_of(key)
        if name in names and len(here) == len(t):
            return values[:, names.index(name)].copy()
        if name in names:
            result[here] = values[here, names.index(name)]
        elif name in system.outputs:
            function = system.outputs[name].function
            function = function.get(key) if isinstance(function, Mapping) else function
            if function is not None:
                kind = system.S[key]
                result[here] = [
                    function(t[i], kind(*values[i, : len(names)].tolist()), p) for i in here
                ]
    return result


_UMASK = os.umask(0)  # it can only be read by setting it
os.umask(_UMASK)


def write_whole(path: str | os.PathLike, data: bytes) -> None:
    """write_whole("a.csv", data): beside the goal, then renamed, so that a full disk or a lost share never leaves half a file. Raises OSError."""
    path, temporary = Path(path), None
    mode = (
        path.stat().st_mode if path.exists() else 0o666 & ~_UMASK
    )  # a temporary file is for its owner alone
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, mode)
        os.replace(temporary, path)
        temporary = None
    finally:  # also when the kernel is interrupted
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


def _write(path: str | os.PathLike, data: bytes) -> Path:
    try:
        write_whole(path, data)
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise ModelError(
            f"{str(path)!r} cannot be written ({getattr(error, 'strerror', None) or error}): choose a folder that exists and that you may write to"
        ) from error
    return Path(path)


def load_npz(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """load_npz("ball.npz")["y"]: the columns, "p.…", "event.…" and "stopped" that `Run.to_npz` wrote."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}
    except (OSError, ValueError, AttributeError, TypeError) as error:  # the last two: a plain .npy
        raise ModelError(
            f"{str(path)!r} cannot be read ({getattr(error, 'strerror', None) or error}): it must be a file that run.to_npz wrote"
        ) from error
