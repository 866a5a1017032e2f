"""Where compiled code is kept between sessions: read(name) -> bytes or None; write(name, data).

What lies there is machine code that will be run. So a folder serves only if it is the user's own
and nobody else can write to it; otherwise nothing outlives the process.
"""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

from ..run import write_whole


def wanted() -> Path:
    """wanted() -> $LABKIT_CACHE, or labkit's part of the user's cache folder, safe or not."""
    if os.environ.get("LABKIT_CACHE"):
        return Path(os.environ["LABKIT_CACHE"])
    if sys.platform == "win32":
        home = Path(os.environ.get("LOCALAPPDATA", Path.home()))
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "labkit" / "code"


def folder() -> Path:
    """folder() -> the user's folder for compiled code; if that is not safe, one that this
    process makes and removes.
    """
    with suppress(OSError, RuntimeError):  # RuntimeError: a user without a home
        path = wanted()
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_ours(os.lstat(path), stat.S_ISDIR) and os.access(path, os.W_OK):
            return path
    return _temporary()


@cache
def _temporary() -> Path:
    made = tempfile.mkdtemp(prefix="labkit-")
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return Path(made)


def _is_ours(found: os.stat_result, kind) -> bool:
    """No link, owned by this user, and no one else may write to it. (Windows keeps a user's
    folders by other means.)
    """
    if sys.platform == "win32":
        return kind(found.st_mode)
    return kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


def read(name: str) -> bytes | None:
    """read("4f….bin") -> what write() was given, None where it is missing or cannot be trusted."""
    with suppress(OSError):
        handle = os.open(
            folder() / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        )
        with os.fdopen(handle, "rb") as file:
            if _is_ours(os.fstat(file.fileno()), stat.S_ISREG):
                return file.read()
    return None


def write(name: str, data: bytes) -> None:
    """write("4f….bin", data): a full disk or a missing folder is no error, it is only a cache."""
    with suppress(OSError):
        path = folder() / name
        write_whole(path, data)
        os.chmod(path, 0o600)


def has(name: str) -> bool:
    """has("4f….bin") -> whether read() would find something."""
    return (folder() / name).is_file()
