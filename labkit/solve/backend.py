"""The compiled back end: core.py once for all models, a model's functions as one small C function,
both kept on disk.

    code = compiled(system)          -> Code, or None while it is still being made in the background
    code = compiled(system, wait=True)

The core is compiled in a process of its own (`python -m labkit.solve`), so that a slider goes on
meanwhile; a model is compiled in a thread. What is kept on disk is keyed by everything it was made
from: the sources, every constant and helper they read, the versions of Python, Numba and LLVM, and
the processor. A changed constant is another key.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import itertools
import marshal
import os
import subprocess
import sys
import threading
import time
import types
import warnings
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..model import ModelError, System
from . import cache as kept
from . import core
from .checked import intrinsics
from .reads import Reads
from .source import FAILED, FLOW, GUARDS, RESET, Program

try:
    import llvmlite

    # light; Numba itself is imported when something is to be compiled
    import llvmlite.binding as llvm
except ImportError:  # a browser, a locked-down laptop: the plain back end is all there is
    llvm = None


@cache
def _machine() -> str:
    """What compiled code depends on besides its source."""
    spec = find_spec("numba")  # not imported: its version stands in a small file
    home = Path(spec.origin).parent if spec and spec.origin else Path()
    own = (home / "_version.py").read_text(encoding="utf8") if spec else ""
    versions = sys.version, own, llvmlite.__version__, np.__version__
    return repr((versions, llvm.get_host_cpu_name(), sorted(llvm.get_host_cpu_features().items())))


def _kept(text: str) -> str:
    """The name of the file in which the code made from `text` is kept."""
    return f"{hashlib.sha256((_machine() + text).encode()).hexdigest()[:40]}.bin"


_imported = threading.Event()


def _import() -> None:
    """Import all that compiling takes, while `compiled` keeps the cell from going on.

    Beside a running cell this can fail, and the model would stay plain: of 264 first runs of a
    notebook on a busy machine one did ("dictionary changed size during iteration"). Numba also
    parses signatures on its way, and two threads that parse at once are an error in Python up to
    3.12 (gh-106905). In the cell's own thread an interrupt would leave it half imported.
    """
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()
    _imported.set()


Native = tuple[object, int]  # what to keep alive, and the address of a C function
ENTRY = "labkit_entry"


def _read(text: str) -> Native | None:
    """The C function kept under `text`, None if there is none that can be loaded."""
    data = kept.read(_kept(text))
    return _load(data) if data else None


def _made(text: str, data: bytes) -> Native:
    """The C function in what _compile made, which is kept under `text`."""
    kept.write(_kept(text), data)
    found = _load(data)
    if found is None:
        raise RuntimeError("the compiled code cannot be loaded")
    return found


def _packed(machine_code: bytes, bitcode: bytes) -> bytes:
    body = marshal.dumps((machine_code, bitcode))
    return hashlib.sha256(body).digest() + body


def _load(data: bytes) -> Native | None:
    """Machine code made ready by LLVM alone, or by Numba where it calls what only Numba brings
    along (arrays made inside); None if it is damaged or another version's.
    """
    digest, body = data[:32], data[32:]
    if hashlib.sha256(body).digest() != digest:
        return None
    machine_code, bitcode = marshal.loads(body)
    try:
        name = f"labkit_{next(_numbers)}"
        builder = llvm.JITLibraryBuilder().add_object_img(machine_code).add_current_process()
        library = builder.export_symbol(ENTRY).link(_linker(), name)
        return library, library[ENTRY]
    except (RuntimeError, AttributeError, OSError):
        pass
    try:
        from numba.core.compiler_lock import global_compiler_lock
        from numba.core.registry import cpu_target

        _import()
        with global_compiler_lock:
            codegen = cpu_target.target_context.codegen()
            library = codegen.unserialize_library((ENTRY, "object", (machine_code, bitcode)))
            return library, library.get_pointer_to_function(ENTRY)
    except Exception:  # made by another version, after all
        return None


_numbers = itertools.count()


@cache
def _linker() -> object:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.create_lljit_compiler(suppress_errors=True)


def _jit(function: Callable, **options: object) -> Callable:
    from numba import njit

    usual = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(**{**usual, **options})(function)


def _compile(function: Callable, arguments: tuple, returns: object) -> bytes:
    """A function under @njit as a C function without any Python in it.

    One that fails (an exception) is called again, with FAILED added to its first argument.
    """
    from llvmlite import ir
    from numba import types as nb
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    with global_compiler_lock:
        function.compile(arguments)
        result = function.overloads[arguments]
        context = cpu_target.target_context
        library, module = context.codegen().create_library(ENTRY), context.create_module(ENTRY)
        library.enable_object_caching()
        kinds, nothing = [context.get_value_type(kind) for kind in arguments], returns == nb.none
        inner = context.call_conv.get_function_type(returns, arguments)
        callee = ir.Function(module, inner, result.fndesc.llvm_func_name)
        back = ir.VoidType() if nothing else context.get_value_type(returns)
        entry = ir.Function(module, ir.FunctionType(back, kinds), ENTRY)
        # One call in a loop, not two: LLVM puts it in its place
        first, again, done = (entry.append_basic_block() for _ in range(3))
        builder = ir.IRBuilder(first)
        builder.branch(again)
        builder.position_at_end(again)
        what = builder.phi(kinds[0])
        what.add_incoming(entry.args[0], first)
        status, value = context.call_conv.call_function(
            builder, callee, returns, arguments, [what, *entry.args[1:]]
        )
        if nothing:
            what.add_incoming(builder.add(what, ir.Constant(kinds[0], FAILED)), builder.block)
            builder.cbranch(status.is_error, again, done)
        else:
            builder.branch(done)
        builder.position_at_end(done)
        builder.ret_void() if nothing else builder.ret(value)
        library.add_ir_module(module)
        library.add_linking_library(result.library)
        library.finalize()
        library.get_pointer_to_function(ENTRY)  # now it is machine code
        _, _, (machine_code, bitcode) = library.serialize_using_object_code()
    return _packed(machine_code, bitcode)


# ---------------------------------------------------------------- the core


def _source(name: str) -> str:
    return Path(__file__).with_name(f"{name}.py").read_text(encoding="utf8")


# Read when this module is: files that change under a running kernel (an update) must not meet the
# functions it has.
#: The core's files: each takes from those before it.
PARTS = ["layout", "sliding", "step", "rounding", "leaving", "sides"]
PARTS += ["locate", "instant", "core", "lanes"]
#: … as one source.
CORE = "\n".join(
    line for name in PARTS for line in _source(name).splitlines() if not line.startswith("from .")
)
#: What the compiled core depends on, and what compiled models do besides their text: how both are
#: made.
CORE_KEY = CORE + _source("backend") + _source("__main__") + repr((FLOW, GUARDS, RESET))
HOW = _source("backend") + _source("checked")


def _make_core() -> bytes:
    """CORE, whose flow, guards, reset call the model's C function, as one of an address table."""
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

    # `w` is one pointer, to a table of addresses and shapes; w.k is made from its entries. (Passed
    # as a named tuple of sixty arrays, every call had four hundred arguments and the core took a
    # minute to compile; Numba's own arrays count their references, and each count is a call that
    # keeps LLVM from seeing through.)
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
            fields = [("data", nb.CPointer(kind.item)), ("width", nb.intp)]
            super().__init__(manager, kind, fields[: kind.ndim])

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
            # Nothing writes to the table while the core runs. Unless LLVM is told, it reads the
            # table again after every store
            loaded = builder.load(builder.gep(value, [ir.Constant(ir.IntType(64), start + k)]))
            loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
            return loaded

        made = cgutils.create_struct_proxy(block)(context, builder)
        made.data = builder.inttoptr(entry(0), made.data.type)
        if block.ndim == 2:
            made.width = entry(2)
        return made._getvalue()

    def told(builder, access, block):
        """A store of a whole number leaves all floats as they were, and the other way round."""
        module, zero = builder.module, ir.Constant(ir.IntType(64), 0)
        kind = module.add_metadata([str(block.item), module.add_metadata(["labkit"]), zero])
        access.set_metadata("tbaa", module.add_metadata([kind, kind, zero]))
        return access

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
            return told(builder, builder.load(builder.gep(made.data, [index])), block)
        row = cgutils.create_struct_proxy(signature.return_type)(context, builder)
        row.data = builder.gep(made.data, [builder.mul(index, made.width)])
        return row._getvalue()

    @type_callable(operator.setitem)
    def type_set(context):
        def typer(block, index, value):
            if isinstance(block, Block) and block.ndim == 1 and isinstance(index, nb.Integer):
                return nb.none

        return typer

    @lower_builtin(operator.setitem, Block, nb.Integer, nb.Any)
    def set(context, builder, signature, arguments):
        block, index, value = signature.args
        made = cgutils.create_struct_proxy(block)(context, builder, value=arguments[0])
        place = builder.gep(made.data, [context.cast(builder, arguments[1], index, nb.intp)])
        value = context.cast(builder, arguments[2], value, block.item)
        told(builder, builder.store(value, place), block)
        return context.get_dummy_value()

    @intrinsic
    def as_workspace(context, table):
        signature = Table()(nb.CPointer(nb.int64))
        return signature, lambda context, builder, signature, arguments: arguments[0]

    @intrinsic
    def call(context, model, what, index, t, y, p, out):
        # p is the table's second entry: an address, passed on as it is
        signature = nb.void(nb.int64, nb.int64, nb.int64, nb.float64, y, nb.int64, out)

        def codegen(context, builder, signature, arguments):
            double, long = ir.DoubleType(), ir.IntType(64)
            kind = ir.FunctionType(ir.VoidType(), [long, long, double] + [double.as_pointer()] * 3)

            def data(i):
                block = cgutils.create_struct_proxy(signature.args[i])
                return block(context, builder, value=arguments[i]).data

            p = builder.inttoptr(arguments[5], double.as_pointer())
            model = builder.inttoptr(arguments[0], kind.as_pointer())
            builder.call(model, [*arguments[1:4], data(4), p, data(6)])
            return context.get_dummy_value()

        return signature, codegen

    # Numba loads what is kept by way of a module that can be imported
    space: dict[str, object] = {"__name__": __name__}
    exec(compile(CORE, core.__file__, "exec"), space)
    space |= {"call": call, "as_workspace": as_workspace}
    exec(
        f"""
def flow(model, mode, t, y, p, out): call(model, {FLOW}, mode, t, y, p, out)
def guards(model, mode, t, y, p, out): call(model, {GUARDS}, mode, t, y, p, out)
def reset(model, which, mode, t, y, p, out): call(model, {RESET} + mode, which, t, y, p, out)
def external_step(model, w, p, t, h): return 0.0
def row(p, lane, parameters): return p + 8 * parameters * lane
def entry(table): return sweep(table[0], as_workspace(table), table[1], table[2])
""",
        space,
    )
    apart = ("namedtuple", "workspace", "entry")
    for name, value in list(space.items()):
        if isinstance(value, types.FunctionType) and name not in apart:
            space[name] = _jit(value)
    return _compile(_jit(space["entry"]), (nb.CPointer(nb.int64),), nb.intp)


def addresses(model: int, p: np.ndarray, budget: int, w: core.Workspace) -> np.ndarray:
    """What the compiled `entry` reads: model, p, budget, a spare, address and shape of fields."""
    table = [model, p.ctypes.data, budget, 0]
    for array in w:
        table.append(array.__array_interface__["data"][0])
        table.extend(array.shape)
    return np.array(table, dtype=np.int64)


# ---------------------------------------------------------------- a model


def _make_model(program: Program) -> bytes:
    """The common function of a model, compiled."""
    from numba import types as nb

    strict = {"error_model": "python", "boundscheck": True}
    space = {"__name__": __name__} | program.values | intrinsics(program.intrinsics)
    exec(compile(program.text, f"<{program.system.name}>", "exec"), space)
    for name in (*program.helpers, *program.told):
        space[name] = _jit(space[name], **strict)
    number = nb.CPointer(nb.float64)
    arguments = nb.int64, nb.int64, nb.float64, number, number, number
    return _compile(_jit(space["model"], forceinline=True, **strict), arguments, nb.none)


# ---------------------------------------------------------------- who is ready


class Code:
    """Compiled code of one system: run(address of a table of `addresses`) goes on with its runs.

    places: what is said of whole numbers that it cannot reckon with, by the number behind p, less 1
    """

    def __init__(self, core_function: Native, model_function: Native, places: list[str]):
        self.places = places
        self._alive = core_function, model_function
        self.run = ctypes.CFUNCTYPE(ctypes.c_ssize_t, ctypes.c_void_p)(core_function[1])
        self.model = model_function[1]


class _State:
    """What has become of a system: its source, its code once there is one, or why there is none."""

    def __init__(self, system: System):
        self.reads = Reads()
        self.code: Code | None = None
        self.error: Exception | None = None
        self.key = ""
        try:
            # The syntax trees are made here: two threads at it at once is an error in Python up to
            # 3.12 (gh-106905)
            self.program = Program(system, self.reads)
            self.key = self.program.key + HOW
        except Exception as error:  # Unfit; anything else is no more than the translator's gap
            self.fail(system, error)

    def fail(self, system: System, error: Exception) -> None:
        self.error = error
        first = (str(error).strip() or repr(error)).splitlines()[0]
        warnings.warn(f"{system.name!r} runs in plain Python, because {first}", stacklevel=2)


_lock = threading.RLock()
_core: Native | None = None
_states: dict[System, _State] = {}  # of the systems that were used last
MOST = 64
_threads: list[threading.Thread] = []


@atexit.register
def _settle() -> None:
    for thread in _threads:  # LLVM must not be at work while the interpreter is taken down
        thread.join(timeout=3)


def compiled(system: System, wait: bool = False, patience: float = 0.0) -> Code | None:
    """compiled(system) -> Code, or None while it is being made (or cannot be).

    wait=True waits, and raises ModelError where nothing can be compiled; `patience` waits so many
    seconds at most and raises nothing. What only has to be read from disk is there at once; Numba's
    imports are waited for (a second, once), because they and a running cell can break each other:
    see _import.
    """
    if why := _unavailable():
        if wait:
            raise ModelError(f"backend='compiled' {why}: use backend='auto' or 'plain'")
        return None
    code, until = _compiled(system, wait), time.monotonic() + patience
    while (
        code is None
        and (time.monotonic() < until or not _imported.is_set())
        and any(thread.is_alive() for thread in _threads)
    ):
        time.sleep(0.02)
        code = _compiled(system, False)
    return code or _compiled(system, False)  # its thread may have ended since it was last asked for


_SWITCHED_OFF = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def _unavailable() -> str:
    if llvm is None:
        return "needs Numba, which is not installed here"
    return "is switched off by NUMBA_DISABLE_JIT" if _SWITCHED_OFF else ""


def _compiled(system: System, wait: bool) -> Code | None:
    with _lock:
        state = old = _states.pop(system, None)
        if old is None or not old.reads.same():
            state = _State(system)
            if old is not None and state.key and state.key == old.key:
                state.code, state.error = old.code, old.error
            if state.code is None and state.error is None and not wait:
                _begin(system, state)
        _states[system] = state
        while len(_states) > MOST:
            del _states[next(iter(_states))]
    if state.error is None and state.code is None and wait:
        _prepare(system, state)
    if state.error is not None and wait:
        state.fail(system, state.error)  # said again to who asks for it
    return state.code


def _begin(system: System, state: _State) -> None:
    """Load what is kept; compile what is not, in a thread."""
    if core_is_kept() and kept.has(_kept(state.key)):
        _prepare(system, state)
        return
    arguments = system, state
    thread = threading.Thread(target=_prepare, args=arguments, daemon=True, name="labkit compiles")
    _threads[:] = [t for t in _threads if t.is_alive()] + [thread]
    thread.start()


_one_at_a_time = threading.Lock()


def _prepare(system: System, state: _State) -> None:
    """Get the core and the model, from disk or anew, and put them where `compiled` finds them."""
    try:
        load_core()
        model = _read(state.key)
        if model is None:
            _import()
        with _one_at_a_time:
            if state.code is None:
                model = model or _made(state.key, _make_model(state.program))
                state.code = Code(_core, model, state.program.places)
    except Exception as error:
        state.fail(system, error)


def load_core(here: bool = False) -> None:
    """Load the core; at first it is compiled in a process of its own (here=True: in this one)."""
    global _core
    if _core is not None:
        return
    with _one_at_a_time:
        if _core is None:
            if not here and not core_is_kept():
                _import()
                path = str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH")
                own = {"PYTHONPATH": os.pathsep.join(filter(None, path))}
                own["LABKIT_CACHE"] = str(kept.folder())
                mute = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
                command = [sys.executable, "-m", "labkit.solve"]
                subprocess.run(command, check=False, env={**os.environ, **own}, **mute)
            _core = _read(CORE_KEY) or _made(CORE_KEY, _make_core())


def core_is_kept() -> bool:
    return kept.has(_kept(CORE_KEY))
