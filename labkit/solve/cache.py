"""Where compiled code is kept between sessions: read(name) -> bytes or None; write(name, data).

What lies there is machine code that will be run. So a folder serves only if it is the user's own
and nobody else can write to it. One that belongs to the system's administrator is read as well (a
cache for all users of a server), and what is new goes into the user's own cache folder.
"""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from ..model import ModelError
from ..run import write_whole

ADMINISTRATOR = 0  # whoever can write to what is theirs can change Python itself


def wanted() -> Path:
    """wanted() -> $LABKIT_CACHE, or labkit's part of the user's cache folder, safe or not."""
    return Path(os.environ.get("LABKIT_CACHE") or _users())


def _users() -> Path:
    if sys.platform == "win32":
        home = Path(os.environ.get("LOCALAPPDATA", Path.home()))
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "labkit" / "code"


def folder() -> Path:
    """folder() -> the folder to write to: `wanted()` or the user's cache folder; if neither is
    safe, one that this process makes and removes.
    """
    for place in (wanted, _users):
        with suppress(OSError, RuntimeError):  # RuntimeError: a user without a home
            path = place()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _safe(os.lstat(path), stat.S_ISDIR) and os.access(path, os.W_OK):
                return path
    return _temporary()


@cache
def _temporary() -> Path:
    made = tempfile.mkdtemp(prefix="labkit-")
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return Path(made)


def _safe(found: os.stat_result, kind: Callable[[int], bool], *others: int) -> bool:
    """No link, owned by this user (or one of the others), and no one else may write to it.
    (Windows keeps a user's folders by other means.)
    """
    if sys.platform == "win32":
        return kind(found.st_mode)
    owners = (os.geteuid(), *others)
    return kind(found.st_mode) and found.st_uid in owners and not found.st_mode & 0o022


def read(name: str) -> bytes | None:
    """read("4f….bin") -> what write() was given, None where it is missing or cannot be trusted."""
    how = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    for place in (folder, wanted):
        with suppress(OSError, RuntimeError):
            if _safe(os.lstat(place()), stat.S_ISDIR, ADMINISTRATOR):
                with os.fdopen(os.open(place() / name, how), "rb") as file:
                    if _safe(os.fstat(file.fileno()), stat.S_ISREG, ADMINISTRATOR):
                        return file.read()
    return None


def write(name: str, data: bytes) -> None:
    """write("4f….bin", data): a full disk or a missing folder is no error, it is only a cache."""
    with suppress(OSError, ModelError):
        path = folder() / name
        write_whole(path, data)
        os.chmod(path, 0o600)


def has(name: str) -> bool:
    """has("4f….bin") -> whether read() would find something."""
    return read(name) is not None
