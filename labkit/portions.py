"""Portions of a sweep: some runs at a time, measured and forgotten, here or through an executor.

for which, lanes in portions(task, columns, jobs, executor): …
"""

from __future__ import annotations

import io
import linecache
import os
import pickle
import types
import warnings
from collections import ChainMap, deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np

from .model import ModelError, System
from .run import Ended, Run
from .solve import simulate_many

__all__ = ["Lane", "Measure", "Task", "portions"]

Measure = Callable[[Run], object]
Lane = tuple[Mapping[str, object] | None, str]  # the results of a run, or None and why
Columns = Mapping[str, np.ndarray]  # parameters and states -> (lanes,) values
Job = tuple[np.ndarray, dict[str, object]]  # lanes, and the options with which they run

FIRST = 32  # lanes of the first portion
SECONDS = 0.4  # how long a portion should take: between two looks at the progress
SAMPLES = 2_000_000  # the most samples of a portion
ONE = ""  # the name of a result that has none


@dataclass(frozen=True)
class Task:
    """Task(system, horizon, measure, accept, start): what all lanes have in common."""

    system: System
    horizon: float
    measure: Measure
    accept: tuple[Ended, ...]
    start: Mapping[str, object]

    def run(
        self, lanes: int, columns: Columns, options: Mapping[str, object]
    ) -> tuple[list[Lane], int]:
        """task.run(2, {"d": array}, {}) -> results of so many lanes, and the number of samples."""
        parameters = {n: v for n, v in columns.items() if n in self.system.parameters}
        begin: dict[str, Any] = {n: v for n, v in columns.items() if n not in parameters}
        found: list[Lane] = [(None, "")] * lanes
        able = np.ones(lanes, dtype=bool)
        for name, value in self.start.items():
            begin[name] = np.full(lanes, np.nan) if callable(value) else np.full(lanes, value)
            for lane in range(lanes) if callable(value) else ():
                mine = {key: float(column[lane]) for key, column in parameters.items()}
                try:
                    begin[name][lane] = value(self.system.values(mine))
                except Exception as error:  # whatever a student's function may raise
                    able[lane] = False
                    found[lane] = (None, f"start of {name!r}: {type(error).__name__}: {error}")
        which = np.flatnonzero(able)
        used = self._simulate(which, parameters, begin, options, found) if len(which) else 0
        return found, used

    def _simulate(self, which, parameters, begin, options, found) -> int:  # type: ignore[no-untyped-def]
        values, start = ({n: column[which] for n, column in c.items()} for c in (parameters, begin))
        try:
            runs = simulate_many(self.system, self.horizon, start=start, **values, **options)
        except ModelError as error:  # none of them can start: each has its own reason
            if len(which) == 1:
                found[which[0]] = (None, str(error))
                return 0
            halves = np.array_split(which, 2)
            return sum(self._simulate(h, parameters, begin, options, found) for h in halves)
        for lane, run in zip(which.tolist(), runs, strict=True):
            found[lane] = self._measured(run)
        return len(runs.samples.t)

    def _measured(self, run: Run) -> Lane:
        if run.ended is Ended.REFUSED or run.ended not in self.accept:
            return None, run.stopped
        try:
            result = self.measure(run)
            result = dict(result) if isinstance(result, Mapping) else {ONE: result}
            return {name: _simple(value) for name, value in result.items()}, ""
        except Exception as error:  # whatever a student's function may raise
            return None, f"measure: {type(error).__name__}: {error}"


def _simple(value: object) -> object:
    """A float, a text, or True or False; ModelError for anything else."""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, bool | np.bool_):
        return bool(value)
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ModelError(
            f"measure must return a number, a text, True or False, not {value!r:.60}"
        ) from None


def portions(
    task: Task, columns: Mapping[str, Any], jobs: list[Job], executor: Executor | None = None
) -> Iterator[tuple[np.ndarray, list[Lane]]]:
    """portions(task, columns, jobs) -> which lanes and their results, portion after portion.

    columns: (all lanes,) values of parameters and states, or one number for all.
    """

    def cut(which: np.ndarray) -> Columns:
        return {
            name: values[which] if np.ndim(values) else np.full(len(which), values)
            for name, values in columns.items()
        }

    if executor is not None:
        yield from _elsewhere(task, cut, jobs, executor)
        return
    size = FIRST
    for lanes, options in jobs:
        while len(lanes):
            which, lanes = lanes[:size], lanes[size:]
            begun = perf_counter()
            results, used = task.run(len(which), cut(which), options)
            yield which, results
            speed = len(which) / max(perf_counter() - begun, 1e-6)
            room = SAMPLES * len(which) / max(used, 1)
            size = int(max(1, min(SECONDS * speed, room, 4 * size)))


def _elsewhere(
    task: Task, cut: Callable[[np.ndarray], Columns], jobs: list[Job], executor: Executor
) -> Iterator[tuple[np.ndarray, list[Lane]]]:
    """Portions through an executor, so many at a time that its workers never wait."""
    here = isinstance(executor, ThreadPoolExecutor)
    sent: Task | bytes = task if here else _packed(task)
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    total = sum(len(lanes) for lanes, _ in jobs)
    size = max(1, min(FIRST, -(-total // (4 * workers))))
    waiting = deque(
        (lanes[k : k + size], options)
        for lanes, options in jobs
        for k in range(0, len(lanes), size)
    )
    running: dict[Future, Job] = {}
    lost = ""  # why runs are made here that should have been made elsewhere
    try:
        while waiting or running:
            while waiting and not lost and len(running) < 2 * workers:
                which, options = waiting[0]
                more = {"workers": 1} | options
                try:
                    future = executor.submit(_remote, sent, len(which), cut(which), more)
                except RuntimeError as error:  # it is broken, or was shut down
                    lost = _said(error)
                    break
                running[future] = waiting.popleft()
            for future in wait(running, 0.1, FIRST_COMPLETED).done:
                which, options = running.pop(future)
                try:
                    results = future.result()
                except Exception as error:  # of the executor: what a run raises is its reason
                    lost = _said(error)
                    waiting.appendleft((which, options))
                else:
                    yield which, results
            if lost and waiting:
                which, options = waiting.popleft()
                yield which, task.run(len(which), cut(which), options)[0]
    finally:
        if lost:
            warnings.warn(
                f"the executor has lost a worker ({lost}): the runs that were missing were made "
                "in this process",
                stacklevel=4,
            )
        for future in running:
            future.cancel()


def _said(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def _packed(task: Task) -> bytes:
    """The task as bytes. Functions of a notebook travel with their text, to be compiled there."""
    try:
        import cloudpickle
    except ImportError:
        cloudpickle = None
    try:
        return _with_text(cloudpickle, task) if cloudpickle else pickle.dumps(task)
    except Exception as error:  # pickle raises what it likes
        raise ModelError(
            f"the model cannot be sent to other processes ({error}). Write its functions and "
            "measure with def in a module of their own, or install cloudpickle, or take a "
            "ThreadPoolExecutor: compiled runs share the processors in threads, too"
        ) from None


def _with_text(cloudpickle: Any, task: Task) -> bytes:
    """By cloudpickle, which forgets where code was written."""

    def reduced(code: types.CodeType) -> tuple:
        place = code.co_filename
        return _rewritten, (*table[types.CodeType](code), place, linecache.getlines(place))

    class Packer(cloudpickle.Pickler):
        pass

    table = cloudpickle.Pickler.dispatch_table
    Packer.dispatch_table = ChainMap({types.CodeType: reduced}, table)
    file = io.BytesIO()
    Packer(file).dump(task)
    return file.getvalue()


def _rewritten(make: Callable, parts: tuple, place: str, lines: list[str]) -> types.CodeType:
    code = make(*parts).replace(co_filename=place)
    if lines and linecache.getlines(place) != lines:
        linecache.cache[place] = (sum(map(len, lines)), None, lines, place)
    return code


@lru_cache(4)
def _unpacked(sent: bytes) -> Task:
    return pickle.loads(sent)


def _remote(
    sent: Task | bytes, lanes: int, columns: Columns, options: Mapping[str, object]
) -> list[Lane]:
    task = _unpacked(sent) if isinstance(sent, bytes) else sent
    return task.run(lanes, columns, options)[0]
