"""What a simulation leaves behind: samples, values at any time, the ledger, the work done, export.

run = simulate(ball, 12.0, e=0.9)
run.t, run["y"], run.at(3.2)["v"], run.events["bounce"].t, run.mode
run.ended is Ended.FINISHED, run.stopped; run.options; run.again(e=0.7)
run.to_csv("ball.csv"); run.to_npz("ball.npz"); load_npz("ball.npz")["y"]; run.to_frame()
run.to_parquet("ball.parquet"); repeated(ball, "ball.csv")
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import exports
from .arguments import asked
from .ledger import Event, Named, Touch
from .model import ModelError, System, check_names

__all__ = ["Ended", "Event", "Run", "Samples", "Touch", "Work", "load_npz"]


class Ended(StrEnum):
    """Why a run ended, as a value that code can test: run.ended is Ended.ZENO.

    run.stopped says the same as a sentence, with the place.

    >>> Ended.FINISHED == "finished"
    True
    """

    FINISHED = "finished"
    TERMINAL = "terminal event"
    ZENO = "Zeno"  # events pile up, and no mode is named to rest in
    CONTACT = "resting contact"  # after its event a guard does not leave zero
    LOOP = "endless loop"  # too many events at one instant
    TOO_MANY_EVENTS = "too many events"
    TOO_MANY_STEPS = "too many steps"
    STIFF = "stiff"  # an explicit method that spends its steps on stability
    JUMP = "jump in a flow"  # not declared as an event: rejected steps pile up at one place
    NOT_A_NUMBER = "not a number"
    DIVERGED = "diverged"
    SINGULAR = "singular"  # no step is short enough
    QUEUE = "too many dead times"  # under way at once
    REFUSED = "refused start"  # does not fit its mode; only among the runs of simulate_many


class Work(NamedTuple):
    """run.work.steps: what a run cost, and by which means.

    Accepted and rejected steps, evaluations of flows and of guards, events, seconds (of a run of
    `simulate_many` not known: NaN), method and back end.
    """

    steps: int
    rejected: int
    evaluations: int
    guard_evaluations: int
    events: int
    seconds: float
    method: str
    backend: str


class Samples(NamedTuple):
    """Samples(t, mode_index, j, values, other, part): see Run, of one run or of many in a row."""

    t: np.ndarray
    mode_index: np.ndarray
    j: np.ndarray | None
    values: np.ndarray
    other: np.ndarray | None = None
    part: np.ndarray | None = None

    def cut(self, rows: slice) -> Samples:
        """samples.cut(slice(10, 20)) -> those rows, in the same memory."""
        return Samples(*(None if array is None else array[rows] for array in self))

    def column(self, system: System, p: tuple, name: str) -> np.ndarray:
        """samples.column(system, p, "x") -> (m,) a state, held variable or output.

        NaN where a mode has none. While sliding (other ≥ 0) an output is the mixture
        (1 − part)·(the mode's) + part·(the other's). Raises ModelError for an unknown name.
        """
        if name not in system.units:
            said = f"{{}} is neither a state nor an output of {system.name!r}"
            check_names([name], [*system.units, *system.outputs], said)
        result, output = np.full(len(self.t), np.nan), system.outputs.get(name)
        for index, mode in enumerate(system.modes):
            here, place = np.flatnonzero(self.mode_index == index), system.places(mode).get(name)
            if output:
                result[here] = self._output(system, p, name, mode, here)
            elif place is not None and len(here) == len(result):
                return self.values[:, place].copy()
            elif place is not None:
                result[here] = self.values[here, place]
        if output and self.other is not None:
            for index, mode in enumerate(system.modes):
                here = np.flatnonzero(self.other == index)
                theirs = self._output(system, p, name, mode, here)
                result[here] += self.part[here] * (theirs - result[here])
        return result

    def _output(
        self, system: System, p: tuple, name: str, mode: str, here: np.ndarray
    ) -> np.ndarray:
        """An output of a mode at some of the samples; NaN when the mode has none."""
        function, kind = system.outputs[name].of(mode), system.S[mode]
        if function is None:
            return np.full(len(here), np.nan)
        states = self.values[np.ix_(here, list(system.places(mode).values()))].tolist()
        rows = [(t, kind(*s), p) for t, s in zip(self.t[here].tolist(), states, strict=True)]
        try:
            found = np.array([function(*row) for row in rows])
        except Exception:  # asked again below, for the words
            found = np.array(None)
        if found.ndim == 1 and found.dtype.kind in "fiub":
            return found
        from .solve.check import number_of  # it imports this file

        return np.array([number_of(function, f"output {name!r}", *row) for row in rows])


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """The result of `simulate`. Arrays have one entry a sample, in the order of hybrid time (t, j).

    t         (m,) time. An event adds two samples at one instant: before and after
    j         (m,) number of events so far; each sample advances t or j, never both
    mode      (m,) name of the mode of each sample
    run[n]    (m,) a state, held variable or output; NaN in modes that do not have it
    events    the ledger: events[0] an Event, events["bounce"] its Firings as arrays
    touches   limits that a guard came up to without passing them, a list of Touch (the first 64)
    ended     why it ended, an Ended;  stopped: the same as a sentence, 'terminal event "destroyed"'
    notes     sentences about what was done but should be known, mostly none
    p         the parameters used, p.g;  options: how it was made;  work: the Work done

    A run of `simulate_many` has no `pieces`; its `at` makes the run once more to find them.
    """

    system: System
    p: tuple
    t: np.ndarray
    j: np.ndarray
    mode_index: np.ndarray
    values: np.ndarray  # (m, most states of any mode + held variables)
    events: Sequence[Event]
    stopped: str
    work: Work
    # One row a step: t0, h, mode, the other mode while sliding (else −1), then the coefficients of
    # its polynomial in (t − t0)/h, lowest first, then the held variables
    pieces: np.ndarray | None
    touches: list[Touch] = field(default_factory=list)
    ended: Ended = Ended.FINISHED
    said: list[str] = field(default_factory=list)  # notes that the run itself has made
    options: Mapping[str, object] = field(default_factory=dict)
    make: Callable[..., Run] | None = None  # what made it: simulate
    # While sliding, of each sample the other mode (else −1) and its share of the flow, 0 … 1
    other: np.ndarray | None = None
    part: np.ndarray | None = None
    look: Callable[[], list[str]] | None = None  # finds notes that take time, when they are read

    @cached_property
    def notes(self) -> list[str]:
        return self.said + (self.look() if self.look else [])

    @cached_property
    def mode(self) -> np.ndarray:
        return self._modes[self.mode_index]

    @cached_property
    def _modes(self) -> np.ndarray:
        return np.array(list(self.system.modes), dtype=object)

    @property
    def start(self) -> dict[str, float]:
        """Names and values of states and held variables at the first sample."""
        return self._state(0)

    @property
    def final(self) -> dict[str, float]:
        """Names and values of states and held variables at the end, after the last event."""
        return self._state(-1)

    def _state(self, row: int) -> dict[str, float]:
        values = self.values[row].tolist()
        places = self.system.places(self.mode[row])
        return Named((name, values[k]) for name, k in places.items())

    @asked
    def __getitem__(self, name: str) -> np.ndarray:
        more = self.j, self.values, self.other, self.part
        return Samples(self.t, self.mode_index, *more).column(self.system, self.p, name)

    def again(self, **changes: object) -> Run:
        """run.again(e=0.7, rtol=1e-10, start={"y": 2.0}) -> Run, as this one but for the changes.

        Takes parameters and options of `simulate`; `start` changes the values that it names.
        Raises ModelError as `simulate` does.
        """
        if self.make is None:
            raise ModelError("this run was not made by simulate, so it cannot be made again")
        said = f"again takes options and parameters of {self.system.name!r}, not {{}}"
        check_names(changes, [*self.p._fields, *self.options], said)
        if isinstance(changes.get("start"), Mapping):
            changes["start"] = {**self.options["start"], **changes["start"]}
        return self.make(self.system, **{**self.p._asdict(), **self.options, **changes})

    @cached_property
    def _pieces(self) -> np.ndarray:
        return self.pieces if self.pieces is not None else self.again().pieces

    @asked
    def at(self, t: float | np.ndarray, side: str = "after") -> dict[str, float | np.ndarray]:
        """run.at(3.2)["v"]: every state and output at one time or an array of times, and "mode".

        From the polynomial of the step that holds t, to the accuracy of the method. At the instant
        of an event `side` chooses the value "before" it (the first one) or "after" it (the last
        one). A run of `simulate_many` is made once more, alone, when it is first asked: the same
        numbers. Raises ModelError when t lies outside the run.
        """
        if side not in ("before", "after"):
            raise ModelError(f"side is 'before' or 'after', not {side!r}")
        when = np.ravel(np.asarray(t, dtype=float))
        first, last = self.t[0], self.t[-1]
        outside = ~((when >= first) & (when <= last))  # NaN, too
        if outside.any():
            raise ModelError(f"t = {when[outside][0]:g} lies outside the run, {first:g} … {last:g}")
        between, names = self._between(when, side), (*self.system.units, *self.system.outputs)
        found = {name: between.column(self.system, self.p, name) for name in names}
        found["mode"] = self._modes[between.mode_index]
        shape = np.shape(t)
        return Named(
            (name, each.reshape(shape) if shape else each.item()) for name, each in found.items()
        )

    def _between(self, when: np.ndarray, side: str) -> Samples:
        """At times inside the run, from its pieces."""
        modes = np.full(when.shape, self.mode_index[-1])
        values = np.repeat(self.values[-1:], len(when), axis=0)
        other, part = np.full(when.shape, -1), np.zeros(when.shape)
        pieces = self._pieces
        made = Samples(when, modes, None, values, other, part)
        if not len(pieces):
            return made
        index = np.searchsorted(pieces[:, 0], when, side="right" if side == "after" else "left") - 1
        inside = when < self.t[-1]
        if side == "before":
            inside = index >= 0  # before the first instant there is only the start itself
            modes[~inside], values[~inside] = self.mode_index[0], self.values[0]
        piece = pieces[index[inside]]
        theta = (when[inside] - piece[:, 0]) / piece[:, 1]
        modes[inside], other[inside] = piece[:, 2], piece[:, 3]
        values[inside], slope = between(piece, theta, self.system.width, len(self.system.held))
        for k in np.flatnonzero(other[inside] >= 0):
            i = np.flatnonzero(inside)[k]
            both = self._modes[[modes[i], other[i]]]
            part[i] = _part(self.system, self.p, when[i], both, values[i], slope[k])
        return made

    def ledger(self) -> str:
        """print(run.ledger()): events and touched limits, one a line, why the run ended, notes."""
        lines = list(map(str, sorted([*self.events, *self.touches], key=lambda line: line.t)))
        lines.append(f"{self.t[-1]:12.6f}  {self.stopped}")
        return "\n".join([*lines, *(f"{'note':>12}  {note}" for note in self.notes)])

    def columns(self) -> dict[str, np.ndarray]:
        """run.columns() -> {"t", "j", "mode", every state, every output}: what the exports hold."""
        own = {"t": self.t, "j": self.j, "mode": self.mode.astype(str)}
        return own | {name: self[name] for name in (*self.system.units, *self.system.outputs)}

    @asked
    def to_csv(self, path: str | os.PathLike) -> Path:
        """run.to_csv("ball.csv") -> path: UTF-8, a header with units, numbers to the last bit.

        The first line is a comment that says how the run was made: see exports.py. The file is
        written whole or not at all. Raises ModelError when it cannot be written.
        """
        columns = self.columns()
        units = {name: self.system.unit(name) for name in columns if name not in ("j", "mode")}
        heads = [f"{name} [{unit}]" if (unit := units.get(name)) else name for name in columns]
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return write_whole(path, exports.lines(heads, rows, exports.how(self)))

    @asked
    def to_npz(self, path: str | os.PathLike) -> Path:
        """run.to_npz("ball.npz") -> path: columns, parameters, ledger and how, for `load_npz`.

        The file is written whole or not at all. Raises ModelError when it cannot be written.
        """
        return write_whole(path, exports.zipped(self, self.columns()))

    def to_frame(self) -> Any:
        """run.to_frame() -> pandas.DataFrame of all columns; ModelError without pandas."""
        return exports.frame(self.columns(), exports.how(self))

    def to_parquet(self, path: str | os.PathLike) -> Path:
        """run.to_parquet("ball.parquet") -> path; ModelError without pyarrow."""
        return write_whole(path, exports.parquet(self.columns(), exports.how(self)))

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        notes = f"; note: {self.notes[0]}{', …' * (len(self.notes) > 1)}" if self.notes else ""
        return (
            f"Run of {self.system.name!r}: t = {self.t[0]:g} … {self.t[-1]:g} {self.system.time}, "
            f"{len(self)} samples, {len(self.events)} events, {self.stopped}{notes}"
        )


def between(
    pieces: np.ndarray, theta: np.ndarray, width: int, held: int
) -> tuple[np.ndarray, np.ndarray]:
    """between(run.pieces[3:5], theta, system.width, held) -> states (k, length), slopes (k, width).

    theta (k,) is where in its step each stands, 0 … 1; held, how many variables are held.
    """
    behind = pieces.shape[1] - held
    degree = (behind - 4) // width - 1  # not reshape(…, -1, …): there may be no piece
    coefficients = pieces[:, 4:behind].reshape(len(pieces), degree + 1, width)
    y, slope = np.zeros((2, len(pieces), width))
    for k in range(degree, -1, -1):
        slope = slope * theta[:, None] + y
        y = y * theta[:, None] + coefficients[:, k]
    return np.hstack([y, pieces[:, behind:]]), slope / pieces[:, 1:2]


def _part(
    system: System, p: tuple, t: float, modes: Sequence[str], y: np.ndarray, rates: np.ndarray
) -> float:
    """While sliding, the share λ of the second mode: rates = (1 − λ)·(flow) + λ·(its flow)."""
    flow, other = (
        np.array(system.modes[mode].flow(float(t), system.S[mode](*s.tolist()), p), dtype=float)
        for mode in modes
        for s in [y[list(system.places(mode).values())]]
    )
    apart = other - flow
    share = (rates[: len(apart)] - flow) @ apart / (apart @ apart) if apart.any() else 0.0
    return float(np.clip(share, 0.0, 1.0))


_UMASK = os.umask(0)  # it can only be read by setting it
os.umask(_UMASK)


def write_whole(path: str | os.PathLike, data: bytes) -> Path:
    """write_whole("a.csv", data) -> its path: written beside the goal, then renamed.

    So a full disk or a lost share never leaves half a file. Raises ModelError.
    """
    path, temporary = Path(path), ""
    try:
        # a temporary file is for its owner alone
        mode = path.stat().st_mode if path.exists() else 0o666 & ~_UMASK
        beside = {"dir": path.parent, "prefix": f".{path.name[:99]}."}
        with tempfile.NamedTemporaryFile(delete=False, **beside) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, mode)
        os.replace(temporary, path)
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise unwritable(path, error) from error
    finally:  # also when the kernel is interrupted
        if os.path.exists(temporary):
            os.unlink(temporary)
    return path


def unwritable(path: Path, error: Exception) -> ModelError:
    """raise unwritable(path, error): with what the system says, and the mend."""
    return ModelError(
        f"{str(path)!r} cannot be written ({getattr(error, 'strerror', None) or error}): "
        "choose a folder that exists and that you may write to, on a disk with room"
    )


@asked
def load_npz(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """load_npz("ball.npz")["y"]: what `Run.to_npz` wrote; also "p.…", "event.…", "stopped".

    Raises ModelError for a file that cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}
    except Exception as error:  # a file of another kind, or half of one, may raise anything
        raise ModelError(
            f"{str(path)!r} cannot be read ({getattr(error, 'strerror', None) or error}): "
            "it must be a file that run.to_npz wrote"
        ) from error
