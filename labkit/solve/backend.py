"""The compiled back end: core.py once for all models, a model's functions as one small C function, both kept on disk.

    code = compiled(system)          -> Code, or None while it is still being made in the background
    code = compiled(system, wait=True)

The core is compiled in a process of its own (`python -m labkit.solve`), so that a slider goes on meanwhile; a model is
compiled in a thread. What is kept on disk is keyed by everything it was made from: the sources, every constant and
helper they read, the versions of Python, Numba and LLVM, and the processor. A changed constant is another key.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import time
import types
import warnings
from collections import namedtuple
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from ..model import ModelError, System
from ..run import write_whole
from . import core
from .functions import FLOW, GUARDS, RESET, common_source, fingerprint, references

try:
    import llvmlite.binding as llvm  # light; Numba itself is imported when something is to be loaded or compiled
except ImportError:  # a browser, a locked-down laptop: the plain back end is all there is
    llvm = None


def cache_folder() -> Path:
    """cache_folder() -> where compiled code is kept: $LABKIT_CACHE, or the user's cache folder, or a temporary one."""
    if os.environ.get("LABKIT_CACHE"):
        folder = Path(os.environ["LABKIT_CACHE"])
    elif sys.platform == "win32":
        folder = Path(os.environ.get("LOCALAPPDATA", Path.home())) / "labkit"
    elif sys.platform == "darwin":
        folder = Path.home() / "Library" / "Caches" / "labkit"
    else:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "labkit"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    folder = (
        Path(tempfile.gettempdir())
        / f"labkit-{os.getuid() if hasattr(os, 'getuid') else os.environ.get('USERNAME', '')}"
    )
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@cache
def _machine() -> str:
    """What compiled code depends on besides its source."""
    versions = [version(package) for package in ("numba", "llvmlite", "numpy")]
    return repr(
        (
            sys.version,
            versions,
            llvm.get_host_cpu_name(),
            sorted(llvm.get_host_cpu_features().items()),
        )
    )


def _kept(text: str) -> Path:
    """The file in which the code made from `text` is kept."""
    return cache_folder() / f"{hashlib.sha256((_machine() + text).encode()).hexdigest()[:40]}.bin"


_imported = threading.Event()


def _import() -> None:
    """Import all that compiling takes, while `compiled` keeps the cell from going on.

    Beside a running cell this can fail, and the model would stay plain: of 264 first runs of a notebook on a busy machine one did
    ("dictionary changed size during iteration"). Numba also parses signatures on its way, and two threads that parse at once are an error
    in Python up to 3.12 (gh-106905). In the cell's own thread an interrupt would leave it half imported.
    """
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()
    _imported.set()


def _c_function(text: str, make: Callable[[], tuple[Callable, object]]) -> tuple[object, int]:
    """(what to keep alive, address) of a C function: the one kept under `text`, or a new one from make() -> (function, signature)."""
    from numba.core.ccallback import CFunc
    from numba.core.compiler import CompileResult
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target
    from numba.core.serialize import dumps

    path, context = _kept(text), cpu_target.target_context
    with global_compiler_lock:
        try:
            data = path.read_bytes()
            if (
                b"NRT_" in data or b"_numba_hashsecret" in data
            ):  # arrays or texts are made inside: the code calls what the rest of Numba brings along,
                context.refresh()  # which takes half a second
            result = CompileResult._rebuild(context, *pickle.loads(data))
        except Exception:  # missing, damaged, written by another version: it is only a cache
            _import()
            function, signature = make()
            result = CFunc(
                function, (signature.args, signature.return_type), {}, {"error_model": "numpy"}
            )._compile_uncached()
            with suppress(OSError):
                write_whole(path, dumps(result._reduce()))
        return result, result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)


def _jit(function: Callable) -> Callable:
    from numba import njit

    return njit(error_model="numpy")(function)


# ---------------------------------------------------------------- the core


def _source(name: str) -> str:
    return Path(__file__).with_name(f"{name}.py").read_text(encoding="utf8")


# Read when this module is: files that change under a running kernel (an update) must not meet the functions it has.
#: The core's files as one source: each takes from those before it.
CORE = "\n".join(
    line
    for name in ("layout", "sliding", "step", "sides", "locate", "instant", "core", "lanes")
    for line in _source(name).splitlines()
    if not line.startswith("from .")
)
HOW = _source("functions") + _source("backend")


def _make_core() -> tuple[Callable, object]:
    """core.py with `flow`, `guards`, `reset` calling the model's C function, as one C function of an address table."""
    import operator

    from llvmlite import ir
    from numba import types as nb
    from numba.core import cgutils
    from numba.core.imputils import lower_getattr_generic
    from numba.core.typing.templates import AttributeTemplate
    from numba.extending import (
        infer_getattr,
        intrinsic,
        lower_builtin,
        models,
        register_model,
        type_callable,
    )

    # `w` is one pointer, to a table of addresses and shapes; w.k is made from its entries. (Passed as a named tuple of sixty
    # arrays, every call had four hundred arguments and the core took a minute to compile; Numba's own arrays count
    # their references, and each count is a call that keeps LLVM from seeing through.)
    class Table(nb.Type):
        def __init__(self):
            super().__init__("labkit.Workspace")

    class Block(nb.Type):
        """One field of the workspace: numbers in one or two dimensions, at an address."""

        def __init__(self, item, ndim):
            super().__init__(f"labkit.Block({item}, {ndim})")
            self.item, self.ndim = item, ndim

    @register_model(Table)
    class TableModel(models.PrimitiveModel):
        def __init__(self, manager, kind):
            super().__init__(manager, kind, ir.IntType(64).as_pointer())

    @register_model(Block)
    class BlockModel(models.StructModel):
        def __init__(self, manager, kind):
            super().__init__(
                manager, kind, [("data", nb.CPointer(kind.item)), ("width", nb.intp)][: kind.ndim]
            )

    places, place = {}, 4
    for name, kind, shape in core.FIELDS:
        places[name] = place, Block(nb.float64 if kind == "f" else nb.int64, len(shape))
        place += 1 + len(shape)

    @infer_getattr
    class Fields(AttributeTemplate):
        key = Table

        def generic_resolve(self, kind, name):
            return places[name][1] if name in places else None

    @lower_getattr_generic(Table)
    def field(context, builder, kind, value, name):
        start, block = places[name]

        def entry(k):
            # Nothing writes to the table while the core runs. Unless LLVM is told, it reads the table again after every store
            loaded = builder.load(builder.gep(value, [ir.Constant(ir.IntType(64), start + k)]))
            loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
            return loaded

        made = cgutils.create_struct_proxy(block)(context, builder)
        made.data = builder.inttoptr(entry(0), made.data.type)
        if block.ndim == 2:
            made.width = entry(2)
        return made._getvalue()

    @type_callable(operator.getitem)
    def type_get(context):
        def typer(block, index):
            if isinstance(block, Block) and isinstance(index, nb.Integer):
                return block.item if block.ndim == 1 else Block(block.item, 1)

        return typer

    @lower_builtin(operator.getitem, Block, nb.Integer)
    def get(context, builder, signature, arguments):
        block, index = signature.args
        made = cgutils.create_struct_proxy(block)(context, builder, value=arguments[0])
        index = context.cast(builder, arguments[1], index, nb.intp)
        if block.ndim == 1:
            return builder.load(builder.gep(made.data, [index]))
        row = cgutils.create_struct_proxy(signature.return_type)(context, builder)
        row.data = builder.gep(made.data, [builder.mul(index, made.width)])
        return row._getvalue()

    @type_callable(operator.setitem)
    def type_set(context):
        return lambda block, index, value: (
            nb.none
            if isinstance(block, Block) and block.ndim == 1 and isinstance(index, nb.Integer)
            else None
        )

    @lower_builtin(operator.setitem, Block, nb.Integer, nb.Any)
    def set(context, builder, signature, arguments):
        block, index, value = signature.args
        made = cgutils.create_struct_proxy(block)(context, builder, value=arguments[0])
        place = builder.gep(made.data, [context.cast(builder, arguments[1], index, nb.intp)])
        builder.store(context.cast(builder, arguments[2], value, block.item), place)
        return context.get_dummy_value()

    @intrinsic
    def as_workspace(context, table):
        return Table()(
            nb.CPointer(nb.int64)
        ), lambda context, builder, signature, arguments: arguments[0]

    @intrinsic
    def call(context, model, what, index, t, y, p, out):
        # p is the table's second entry: an address, passed on as it is
        signature = nb.void(nb.int64, nb.int64, nb.int64, nb.float64, y, nb.int64, out)

        def codegen(context, builder, signature, arguments):
            double, long = ir.DoubleType(), ir.IntType(64)
            kind = ir.FunctionType(ir.VoidType(), [long, long, double] + [double.as_pointer()] * 3)
            y, out = (
                cgutils.create_struct_proxy(signature.args[i])(
                    context, builder, value=arguments[i]
                ).data
                for i in (4, 6)
            )
            p = builder.inttoptr(arguments[5], double.as_pointer())
            builder.call(
                builder.inttoptr(arguments[0], kind.as_pointer()), [*arguments[1:4], y, p, out]
            )
            return context.get_dummy_value()

        return signature, codegen

    space: dict[str, object] = {
        "__name__": __name__
    }  # Numba loads what is kept by way of a module that can be imported
    exec(compile(CORE, core.__file__, "exec"), space)
    space |= {"call": call, "as_workspace": as_workspace}
    exec(
        f"""
def flow(model, mode, t, y, p, out): call(model, {FLOW}, mode, t, y, p, out)
def guards(model, mode, t, y, p, out): call(model, {GUARDS}, mode, t, y, p, out)
def reset(model, transition, mode, t, y, p, out): call(model, {RESET} + mode, transition, t, y, p, out)
def external_step(model, w, p, t, h): return 0.0
def row(p, lane, parameters): return p + 8 * parameters * lane
def entry(table): return sweep(table[0], as_workspace(table), table[1], table[2])
""",
        space,
    )
    for name, value in list(space.items()):
        if isinstance(value, types.FunctionType) and name not in (
            "namedtuple",
            "workspace",
            "entry",
        ):
            space[name] = _jit(value)
    return space["entry"], nb.intp(nb.CPointer(nb.int64))


def addresses(model: int, p: np.ndarray, budget: int, w: core.Workspace) -> np.ndarray:
    """The table that the compiled `entry` reads: model, p, budget, one spare, then address and shape of every field."""
    table = [model, p.ctypes.data, budget, 0]
    for array in w:
        table.append(array.__array_interface__["data"][0])
        table.extend(array.shape)
    return np.array(table, dtype=np.int64)


# ---------------------------------------------------------------- a model


def _native(value: object, made: dict[int, object]) -> object:
    """A value that a model function reads, as Numba takes it: helpers compiled too, lists as tuples."""
    if isinstance(value, types.FunctionType):
        if id(value) not in made:
            read = {name: _native(item, made) for name, item in references(value).items()}
            cells = tuple(types.CellType(read[name]) for name in value.__code__.co_freevars)
            copy = types.FunctionType(
                value.__code__,
                {"__name__": __name__, "__builtins__": __builtins__, **read},
                value.__name__,
                value.__defaults__,
                cells,
            )
            made[id(value)] = _jit(copy)
        return made[id(value)]
    if isinstance(value, list):
        return tuple(value)
    if isinstance(value, tuple) and len(value) == 2 and value[0] in ("S", "P"):
        return namedtuple(*value)
    return value


def _make_model(name: str, source: str, values: dict[str, object]) -> tuple[Callable, object]:
    """The common function of a model, as functions.common_source gives it, ready for Numba."""
    from numba import types as nb

    made: dict[int, object] = {}
    space = {"__name__": __name__} | {name: _native(value, made) for name, value in values.items()}
    exec(compile(source, f"<{name}>", "exec"), space)
    for name, value in values.items():
        if value is None:
            space[name] = _jit(space[name])
    pointer = nb.CPointer(nb.float64)
    return space["model"], nb.void(nb.int64, nb.int64, nb.float64, pointer, pointer, pointer)


def model_functions(system: System) -> list[Callable]:
    """The functions that are called while a system runs."""
    found = [mode.flow for mode in system.modes.values()]
    for tr in system.transitions:
        parts = tr.reset.values() if isinstance(tr.reset, Mapping) else [tr.reset]
        found += [f for f in (tr.guard, *parts) if callable(f)]
    return found


def model_text(system: System) -> str:
    """Everything the compiled model depends on, and so its key."""
    shape = (
        tuple(system.parameters),
        [(m, system.states_of(m)) for m in system.modes],
        tuple(system.held),
    )
    edges = [
        (
            tr.sources,
            tr.target,
            tr.direction,
            tr.tolerance,
            tr.guard is None,
            {name: None if callable(part) else part for name, part in tr.reset.items()}
            if isinstance(tr.reset, Mapping)
            else tr.reset is None,
            tr.priority,
        )
        for tr in system.transitions
    ]
    return repr((shape, edges)) + "\n".join(fingerprint(f) for f in model_functions(system)) + HOW


# ---------------------------------------------------------------- who is ready


class Code:
    """Compiled code of one system: run(address) goes on with the runs that the table of `addresses` there describes."""

    def __init__(self, core_function: tuple[object, int], model_function: tuple[object, int]):
        self._alive = core_function, model_function
        self._entry = ctypes.CFUNCTYPE(ctypes.c_ssize_t, ctypes.c_void_p)(core_function[1])
        self.model = model_function[1]

    def run(self, address: int) -> int:
        return self._entry(address)


_lock = threading.RLock()
_core: tuple[object, int] | None = None
_codes: WeakKeyDictionary[System, tuple[str, Code | BaseException | None, list]] = (
    WeakKeyDictionary()
)
_threads: list[threading.Thread] = []


@atexit.register
def _settle() -> None:
    for thread in _threads:  # LLVM must not be at work while the interpreter is taken down
        thread.join(timeout=3)


def _watch(system: System) -> list[tuple[Callable[[], object], object]]:
    """Everything the functions read from outside, to see cheaply whether it is still the same."""
    found, seen = [], set()

    def walk(function: Callable) -> None:
        if id(function) in seen:
            return
        seen.add(id(function))
        for cell, name in zip(
            function.__closure__ or (), function.__code__.co_freevars, strict=True
        ):
            found.append((lambda cell=cell: cell.cell_contents, cell.cell_contents))
        for name, value in references(function).items():
            if name not in function.__code__.co_freevars:
                found.append((lambda space=function.__globals__, name=name: space.get(name), value))
            if isinstance(value, types.FunctionType):
                walk(value)

    for function in model_functions(system):
        walk(function)
    return found


def _same(watch: list[tuple[Callable[[], object], object]]) -> bool:
    for read, value in watch:
        now = read()
        if now is not value or isinstance(now, list | np.ndarray | dict):
            return False
    return True


def compiled(system: System, wait: bool = False, patience: float = 0.0) -> Code | None:
    """compiled(system) -> Code, or None while it is being made (or cannot be).

    wait=True waits and raises ModelError if it cannot be made; `patience` waits so many seconds at most and raises nothing.
    What only has to be read from disk is waited for, so that the last digit of a run does not depend on how fast a thread is;
    and Numba's imports are (a second, once), because they and a running cell can break each other: see _import.
    """
    code = _compiled(system, wait)
    if (
        code is None
        and any(thread.is_alive() for thread in _threads)
        and core_is_kept()
        and _kept(_codes[system][0]).exists()
    ):
        patience = 20.0
    until = time.monotonic() + patience
    while (
        code is None
        and (time.monotonic() < until or not _imported.is_set())
        and any(thread.is_alive() for thread in _threads)
    ):
        time.sleep(0.02)
        code = _compiled(system, False)
    return code or _compiled(system, False)  # its thread may have ended since it was last asked for


def _compiled(system: System, wait: bool) -> Code | None:
    if llvm is None:
        if wait:
            raise ModelError(
                "backend='compiled' needs Numba, which is not installed here: use backend='auto' or 'plain'"
            )
        return None
    with _lock:
        text, code, watch = _codes.get(system, ("", None, []))
        if text and _same(watch):
            if isinstance(code, Code):
                return code
            if code is not None and not wait:
                return None
        else:
            fresh = model_text(system)
            if fresh != text:
                code = None
                _codes[system] = fresh, None, _watch(system)
                if not wait:
                    # The syntax trees are made here: two threads at it at once is an error in Python up to 3.12 (gh-106905)
                    arguments = system, fresh, None if _kept(fresh).exists() else _sources(system)
                    thread = threading.Thread(
                        target=_prepare, args=arguments, daemon=True, name="labkit compiles"
                    )
                    _threads[:] = [t for t in _threads if t.is_alive()] + [thread]
                    thread.start()
                    return None
            elif isinstance(code, Code):
                return code
            text = fresh
    if not wait:
        return None
    _prepare(system, text, None)
    code = _codes[system][1]
    if isinstance(code, Code):
        return code
    raise ModelError(
        f"{system.name!r} cannot be compiled, use backend='plain' or mend it: {str(code).strip() or repr(code)}"
    ) from code


_one_at_a_time = threading.Lock()


def _sources(system: System) -> tuple[str, dict[str, object]] | Exception:
    try:
        return common_source(system)
    except Exception as error:
        return error


def _prepare(
    system: System, text: str, sources: tuple[str, dict[str, object]] | Exception | None
) -> None:
    """Get the core and the model, from disk or anew, and put them where `compiled` finds them."""
    try:
        load_core()
        with _one_at_a_time:
            if isinstance(_codes.get(system, ("", None))[1], Code) and _codes[system][0] == text:
                return

            def make() -> tuple[Callable, object]:
                found = _sources(system) if sources is None else sources
                if isinstance(found, Exception):
                    raise found
                return _make_model(system.name, *found)

            code: object = Code(_core, _c_function(text, make))
    except Exception as error:
        code = error
        warnings.warn(
            f"{system.name!r} runs in plain Python, because it cannot be compiled: {str(error).strip().splitlines()[0] if str(error) else error!r}",
            stacklevel=2,
        )
    with _lock:
        if system in _codes and _codes[system][0] == text:
            _codes[system] = text, code, _codes[system][2]


def load_core(here: bool = False) -> None:
    """Load the compiled core; the first time on a machine it is compiled in a process of its own (here=True: in this one)."""
    global _core
    if _core is not None:
        return
    with _one_at_a_time:
        if _core is None:
            if not here and not core_is_kept():
                _import()
                subprocess.run(
                    [sys.executable, "-m", "labkit.solve"],
                    check=False,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    stdin=subprocess.DEVNULL,
                    env={
                        **os.environ,
                        "PYTHONPATH": os.pathsep.join(
                            [
                                str(Path(__file__).parents[2]),
                                *filter(None, [os.environ.get("PYTHONPATH")]),
                            ]
                        ),
                    },
                )
            _core = _c_function(CORE + HOW, _make_core)


def core_is_kept() -> bool:
    return _kept(CORE + HOW).exists()
