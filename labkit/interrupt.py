"""An interrupt of the kernel also ends what a panel computes.

Jupyter lets panels answer in threads of their own, and Python raises KeyboardInterrupt in the main
thread only; while no cell runs, the kernel even ignores the signal.

hear_interrupts()                 # in the main thread, once
with interruptible(): …           # may end by KeyboardInterrupt, in whatever thread
"""

from __future__ import annotations

import asyncio
import ctypes
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

__all__ = ["hear_interrupts", "interruptible"]

_at_work: set[int] = set()  # threads


@contextmanager
def interruptible() -> Iterator[None]:
    """with interruptible(): an interrupt that comes meanwhile raises KeyboardInterrupt here."""
    me = threading.get_ident()
    _at_work.add(me)
    try:
        yield
    finally:
        _at_work.discard(me)


def _hand_on(number: int, frame: object) -> None:
    for thread in tuple(_at_work):
        interrupt = ctypes.py_object(KeyboardInterrupt)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), interrupt)


@cache
def hear_interrupts() -> None:
    """hear_interrupts(): from now on, whenever the kernel is idle; elsewhere it does nothing."""
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:  # no kernel
        return

    def install() -> None:
        handler = signal.getsignal(signal.SIGINT)
        if handler is signal.SIG_IGN:  # no cell runs; from now on the kernel puts ours back
            signal.signal(signal.SIGINT, _hand_on)
        elif handler is not _hand_on:
            loop.call_later(0.3, install)

    if threading.current_thread() is threading.main_thread():
        loop.call_soon(install)
