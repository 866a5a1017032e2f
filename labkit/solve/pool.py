"""Workspaces that are used again, and batches that run side by side.

pool = pool_of(system, options); batch = pool.take(code, lanes); together([batch, …], threads)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import lru_cache
from threading import Event as Flag
from time import perf_counter

from ..model import ModelError, System
from .backend import compiled
from .batch import Batch
from .options import Options
from .settings import Settings

__all__ = ["Pool", "pool_of", "together"]

WORTH_THREADS = 4e-3  # seconds of work below which threads cost more than they save
# Workspaces that are kept for the next run, and the most bytes of samples in one
KEPT = (32, 4_000_000)
PATIENCE = 0.1  # seconds between two looks at the keyboard while threads work


class Pool:
    """Pool(settings): the code and the free workspaces of runs with these settings."""

    def __init__(self, settings: Settings):
        self.settings, self.free = settings, []
        self.checked: object = None  # the code with which the model's functions have been tried

    def take(self, code: object, lanes: int) -> Batch:
        """Memory for so many runs, that of an earlier call where there is one.

        Each is taken out: another thread may be simulating, too. After an error or an interrupt it
        does not come back.
        """
        for batch in reversed(self.free):
            if batch.lanes == lanes and batch.code is code:
                try:
                    self.free.remove(batch)
                except ValueError:  # the other one was faster
                    continue
                return batch
        return Batch(self.settings, code, lanes)

    def give_back(self, batch: Batch) -> None:
        if batch.nbytes <= KEPT[1]:
            self.free.append(batch)
            del self.free[: -KEPT[0]]

    def code(self, lanes: int, check: Callable[[], None]) -> object:
        """The compiled code, or None for the plain back end.

        check() tries the model's functions, unless this very code has run with them.
        """
        if self.checked is None:
            check()
        code = self._code(lanes)
        if self.checked not in (None, code):  # something that they read has changed
            check()
            self.free.clear()
        self.checked = code
        return code

    def _code(self, lanes: int) -> object:
        external, backend = self.settings.external, self.settings.options.backend
        plain = backend == "auto" and os.environ.get("LABKIT_BACKEND") == "plain"
        if external and backend == "compiled":
            raise ModelError(
                f"method {self.settings.method!r} is SciPy's and runs with backend='plain' or "
                "'auto' only"
            )
        if external or plain or backend == "plain":
            return None
        # many lanes in plain Python would take longer than the compiler needs for a model
        patience = 0.0 if lanes < 10 else 3.0
        return compiled(self.settings.system, wait=backend == "compiled", patience=patience)


@lru_cache(maxsize=64)  # so that a slider's next position need not make them again
def _pool(system: System, options: tuple) -> Pool:
    return Pool(Settings(Options(system, *options)))


def pool_of(system: System, options: tuple, dense: bool) -> Pool:
    """pool_of(system, options as in Options, dense) -> the Pool for them, kept or new."""
    try:
        return _pool(system, (*options, dense))
    except TypeError:  # an array of sample times is no key
        return _pool.__wrapped__(system, (*options, dense))


def together(batches: Sequence[Batch], threads: int) -> None:
    """together(batches, threads): runs them all; an interrupt from the keyboard ends them at once.

    The compiled core lets go of the interpreter's lock, so threads share the processors. One batch
    is tried alone first: for little work no thread is started.
    """
    begun = perf_counter()
    batches[0].run()
    rest = batches[1:]
    if threads == 1 or (perf_counter() - begun) * len(rest) <= WORTH_THREADS:
        for batch in rest:
            batch.run()
        return
    stop = Flag()
    with ThreadPoolExecutor(threads) as pool:
        tasks = [pool.submit(batch.run, stop) for batch in rest]
        try:
            # waiting without an end hears no interrupt on Windows
            while (state := wait(tasks, PATIENCE, FIRST_EXCEPTION)).not_done:
                if any(task.exception() for task in state.done):
                    break
        finally:  # nothing is left to do, or what is left has no use
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
    for task in tasks:
        if not task.cancelled():
            task.result()
