"""Simulation: simulate(system, t_end) and simulate_many(system, t_end, start={"x": array}).

    run = simulate(ball, 12.0, e=0.9, start={"y": 5.0}, method="DOP853", rtol=1e-8)

The work is done by lanes.py and core.py, compiled (backend.py) or as plain Python from the same source, on the memory
of a Batch (batch.py); methods.py has the tables, plain.py and source.py turn a model's functions into what the core calls,
scipy_step.py lets SciPy's implicit methods take the steps.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from weakref import WeakKeyDictionary

import numpy as np

from ..model import At, ModelError, System, listed, number
from ..run import Run, Runs
from . import core
from .backend import compiled, core_is_kept, load_core
from .batch import Batch, gather
from .check import check_functions
from .methods import DEGREE, FIXED_STEP, METHODS, explicit, proxy

__all__ = ["METHODS", "simulate", "simulate_many", "warm"]

BACKENDS = ("auto", "compiled", "plain")
WORTH_THREADS = 4e-3  # seconds of work below which threads cost more than they save
KEPT = (
    32,
    4_000_000,
)  # workspaces that are kept for the next run, and the most bytes of samples in one


def simulate(
    system: System,
    t_end: float,
    *,
    t0: float = 0.0,
    start: Mapping[str, float] | None = None,
    mode: str | None = None,
    method: str = "DOP853",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    step: float | None = None,
    max_step: float | None = None,
    points: int | np.ndarray = 500,
    locate: bool = True,
    backend: str = "auto",
    max_events: int = 100_000,
    max_steps: int = 1_000_000,
    **parameters: float,
) -> Run:
    """simulate(system, 12.0, e=0.9, start={"y": 5.0}) -> Run

    t_end, t0     end and start time; start: states that differ from system.start; mode: start mode
    method        "Euler", "Heun", "RK4" (with a fixed `step`, default a thousandth of the time), "RK45" (Dormand–Prince 5(4)),
                  "DOP853", or SciPy's "LSODA", "Radau", "BDF" for stiff systems
    rtol, atol    the error of a step is kept below atol + rtol·|state|; max_step bounds the step
    points        number of equidistant samples, or an array of times; every event adds one before and one after
    locate        False: events are noticed only at the end of a step, as by a solver that knows nothing of them
    backend       "auto" (compiled once that is ready), "compiled", "plain": the same numbers
    max_events, max_steps   when to give up; the run then keeps what there is and says so in run.stopped
    parameters    any of the system's parameters by name

    Raises ModelError for bad input and for a model whose functions do not fit it. A run that cannot go on is no
    error: it ends early and run.stopped names the reason.
    """
    began = perf_counter()
    settings = _settings(
        system,
        t_end,
        t0,
        method,
        rtol,
        atol,
        step,
        max_step,
        points,
        locate,
        backend,
        max_events,
        max_steps,
        True,
    )
    p = system.values(parameters)
    begin, first_mode = _start(
        system, {**system.start, **start} if start else system.start, mode, settings.t0, p
    )
    code = settings.code(p, begin, first_mode)
    batch = settings.batch(code, 1)
    batch.load(np.array([p]), np.array([begin]), np.array([settings.place[first_mode]]))
    batch.run()
    run = batch.as_run(p, began)
    settings.leave(batch)
    return run


def simulate_many(
    system: System,
    t_end: float,
    *,
    t0: float = 0.0,
    start: Mapping[str, object] | None = None,
    mode: str | None = None,
    method: str = "DOP853",
    rtol: float = 1e-6,
    atol: float = 1e-9,
    step: float | None = None,
    max_step: float | None = None,
    points: int | np.ndarray = 300,
    locate: bool = True,
    backend: str = "auto",
    max_events: int = 10_000,
    max_steps: int = 1_000_000,
    workers: int | None = None,
    **parameters: object,
) -> Runs:
    """simulate_many(system, 20.0, start={"x": array, "v": 0.0}, k=array) -> Runs, one run for each entry of the arrays.

    `start` and parameters take numbers or one-dimensional arrays of one common length; everything else is as in
    `simulate`. Compiled runs are shared out over all cores (`workers` threads). Raises ModelError as `simulate` does.
    """
    began = perf_counter()
    settings = _settings(
        system,
        t_end,
        t0,
        method,
        rtol,
        atol,
        step,
        max_step,
        points,
        locate,
        backend,
        max_events,
        max_steps,
        False,
    )
    given, starting = (
        {key: np.asarray(value, dtype=float) for key, value in some.items()}
        for some in (parameters, start or {})
    )
    columns = [*given.items(), *starting.items()]
    lengths = {key: len(value) for key, value in columns if value.ndim == 1}
    if any(value.ndim > 1 for _, value in columns) or len(set(lengths.values())) > 1:
        raise ModelError(
            f"simulate_many takes numbers and arrays of one common length; here {lengths or 'arrays of two dimensions'}"
        )
    lanes = next(iter(lengths.values()), 1)
    if lanes == 0:
        raise ModelError(
            f"simulate_many got arrays without entries for {listed(lengths)}: there is nothing to simulate"
        )
    for key, value in given.items():
        for extreme in (
            value.min(),
            value.max(),
        ):  # NaN where there is one; and what lies between is in range, too
            system.values({key: float(extreme)})
    p = np.empty((lanes, len(system.parameters)))
    for place, (key, parameter) in enumerate(system.parameters.items()):
        p[:, place] = given.get(key, parameter.value)
    begin, modes = _starts(settings, {**system.start, **starting}, mode, p)
    name = settings.modes[modes[0]]
    code = settings.code(
        system.P(*p[0].tolist()),
        tuple(begin[0].tolist()[: len(system.states_of(name))]),
        name,
        lanes,
    )
    threads = 1 if code is None else min(workers or os.cpu_count() or 1, lanes)
    blocks = np.array_split(np.arange(lanes), 1 if threads == 1 else min(4 * threads, lanes))
    batches = []
    for block in blocks:
        batch = settings.batch(code, len(block))
        batch.load(p[block], begin[block], modes[block])
        batches.append(batch)
    begun = perf_counter()
    batches[0].run()
    if (
        threads > 1 and (perf_counter() - begun) * (len(batches) - 1) > WORTH_THREADS
    ):  # the compiled core lets go of the interpreter's lock
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(Batch.run, batches[1:]))
    else:
        for batch in batches[1:]:
            batch.run()
    runs = gather(settings, p, batches, began)
    for batch in batches:
        settings.leave(batch)
    return runs


def warm(progress: Callable[[str], object] = print) -> bool:
    """warm() -> True when the engine is compiled. Once a machine; says so by `progress` while it takes its time."""
    from .backend import llvm

    if llvm is None:
        progress("Numba is not installed: simulations run in plain Python")
        return False
    if not core_is_kept():
        progress("compiling the engine, once on this machine (about 20 s) …")
    load_core()
    return True


class Settings:
    """What all runs with the same options share, checked: method tables, structure of the modes; and workspaces to use again."""

    def __init__(
        self,
        system: System,
        t_end: float,
        t0: float,
        method: str,
        rtol: float,
        atol: float,
        step: float | None,
        max_step: float | None,
        points: int | np.ndarray,
        locate: bool,
        backend: str,
        max_events: int,
        max_steps: int,
        dense: bool,
    ):
        self.system, self.dense, self.locate = system, dense, bool(locate)
        self.t0, self.t_end = number(t0, "t0"), number(t_end, "t_end")
        if self.t_end <= self.t0:
            raise ModelError(
                f"t_end = {self.t_end:g} must lie after t0 = {self.t0:g}: runs go forward in time"
            )
        if method not in METHODS:
            raise ModelError(f"there is no method {method!r}; there are {listed(METHODS)}")
        if backend not in BACKENDS:
            raise ModelError(f"there is no backend {backend!r}; there are {listed(BACKENDS)}")
        self.method, self.backend = method, backend
        self.rtol, self.atol = number(rtol, "rtol"), number(atol, "atol")
        if not 0 < self.rtol < 1 or self.atol < 0:
            raise ModelError(
                f"rtol = {self.rtol:g} must lie between 0 and 1, and atol = {self.atol:g} must not be negative"
            )
        self.rtol = max(self.rtol, 100 * core.EPS)
        span = self.t_end - self.t0
        self.max_step = float("inf") if max_step is None else number(max_step, "max_step")
        self.step = span / 1000 if step is None else number(step, "step")
        if self.step <= 0 or self.max_step <= 0:
            raise ModelError(
                f"step = {self.step:g} and max_step = {self.max_step:g} must be positive"
            )
        self.max_events, self.max_steps = (
            _count(max_events, "max_events"),
            _count(max_steps, "max_steps"),
        )
        if np.ndim(points) == 0:
            self.grid = np.linspace(self.t0, self.t_end, max(2, _count(points, "points")))
        else:
            self.grid = np.asarray(points, dtype=float)
            if not (
                np.all(np.diff(self.grid) > 0)
                and len(self.grid)
                and self.grid[0] >= self.t0
                and self.grid[-1] <= self.t_end
            ):
                raise ModelError(
                    f"points must be times in rising order between t0 = {self.t0:g} and t_end = {self.t_end:g}, or a number of samples"
                )
        self.external = method in DEGREE
        self.table = explicit("RK45") if self.external else explicit(method)
        self.degree = DEGREE[method] if self.external else self.table.Q.shape[0]
        self.proxy = min(max(self.degree + 1, 4), 8)
        self.modes = list(system.modes)
        self.place = {mode: index for index, mode in enumerate(self.modes)}
        self.width = max(len(system.states_of(m)) for m in self.modes)
        self.plans = [tr for tr in system.transitions if tr.at is not None]
        self.fixed = self._fixed()
        self.free: list[Batch] = []
        self.checked: object = None  # the code with which the model's functions have been tried

    def _fixed(self) -> dict[str, np.ndarray]:
        """The fields of the workspace that are the same for every run: how it begins, the method's table and the structure of the modes."""
        system, table, trs, modes = self.system, self.table, self.system.transitions, self.modes
        leave = [[i for i in system.leaving[m] if trs[i].guard is not None] for m in modes]
        order = sorted(range(len(trs)), key=lambda i: (-trs[i].priority, i))
        urgent = {None: core.REFUSE, False: core.NO, True: core.YES}
        instants = [len(tr.at.instants) if isinstance(tr.at, At) else 0 for tr in self.plans]
        i0, f0 = np.zeros(core.INTEGERS, dtype=np.int64), np.zeros(core.FLOATS)
        for place, value in {
            core.FRESH: 1,
            core.ENTRY: 1,
            core.STAGES: table.stages,
            core.DEGREE: self.degree,
            core.PROXY: self.proxy,
            core.ADAPTIVE: 2 if self.external else 0 if self.method in FIXED_STEP else 1,
            core.TWO: self.method == "DOP853",
            core.LOCATE: self.locate,
            core.DENSE: self.dense,
            core.TRANSITIONS: len(trs),
            core.MAX_EVENTS: self.max_events,
            core.MAX_STEPS: self.max_steps,
            core.ORDER: table.order,
            core.ROWS: len(table.A),
            core.WIDTH: self.width,
            core.PARAMETERS: len(system.parameters),
            core.SAMPLES: len(self.grid),
            core.SCHEDULES: len(self.plans),
            core.POWERS: not table.Q.any(),
        }.items():
            i0[place] = value
        for place, value in {
            core.T: self.t0,
            core.H: self.step if self.method in FIXED_STEP else 0.0,
            core.T_END: self.t_end,
            core.RTOL: self.rtol,
            core.ATOL: self.atol,
            core.MAX_STEP: self.max_step,
            core.T0: self.t0,
            core.EVENT_T: -1e300,
            core.DUE_T: -1e300,
            core.SPAN: self.t_end - self.t0,
        }.items():
            f0[place] = value
        fixed = {
            "i0": i0,
            "f0": f0,
            "c": table.C,
            "grid": self.grid,
            "size": [len(system.states_of(m)) for m in modes],
            "leave_from": np.cumsum([0, *map(len, leave)]),
            "leave": sum(leave, []),
            "source": np.array([[m in tr.sources for m in modes] for tr in trs]).reshape(
                len(trs), len(modes)
            ),
            "target": [-1 if tr.target is None else self.place[tr.target] for tr in trs],
            "zeno": [-1 if tr.zeno is None else self.place[tr.zeno] for tr in trs],
            "directed": [tr.direction != 0 for tr in trs],
            "urgent": [urgent[tr.urgent] for tr in trs],
            "rank": np.argsort(order),
            "tolerance": [tr.tolerance for tr in trs],
            "plan": [system.transitions.index(tr) for tr in self.plans],
            "plan_from": np.cumsum([0, *instants]),
        }
        interpolant = (
            (np.zeros((self.degree, 1)),) * 2 if self.external else (table.W.T, table.Q)
        )  # SciPy's methods bring their own
        for name, matrix in zip("aewq", (table.A, table.E, *interpolant), strict=True):
            rows, columns = np.nonzero(matrix)
            fixed |= {
                f"{name}_from": np.searchsorted(rows, np.arange(len(matrix) + 1)),
                f"{name}_column": columns,
                f"{name}_value": matrix[rows, columns],
            }
        fixed["node"], fixed["bernstein"], fixed["test"] = proxy(self.proxy)
        self.sizes = {
            "n": self.width,
            "modes": len(modes),
            "transitions": len(trs),
            "guards": len(fixed["leave"]),
            "rows": len(table.A),
            "degree": self.degree,
            "proxy": self.proxy,
            "instants": sum(instants),
            "schedules": len(self.plans),
            "grid": len(self.grid),
            **{name: len(fixed[f"{name}_value"]) for name in "aewq"},
        }
        kinds = {name: kind for name, kind, _ in core.FIELDS}
        return {
            name: np.ascontiguousarray(value, dtype=float if kinds[name] == "f" else np.int64)
            for name, value in fixed.items()
        }

    def batch(self, code: object, lanes: int) -> Batch:
        """Memory for so many runs, that of an earlier call where there is one. Each is taken out: another thread may be simulating, too."""
        for batch in reversed(self.free) if code is not None else ():
            if batch.lanes == lanes and batch.code is code:
                try:
                    self.free.remove(batch)
                except ValueError:  # the other one was faster
                    continue
                return batch
        return Batch(self, code, lanes)

    def leave(self, batch: Batch) -> None:
        if batch.code is not None and len(self.free) < KEPT[0] and batch.w.out.nbytes <= KEPT[1]:
            self.free.append(batch)

    def code(self, p: tuple, start: tuple[float, ...], mode: str, lanes: int = 1) -> object:
        """The compiled code, or None for the plain back end; the model's functions are tried unless this very code has run with them."""
        if self.checked is None:
            self.check_start(start, mode, p)
        code = self._code(lanes)
        if self.checked not in (None, code):  # something that they read has changed
            self.check_start(start, mode, p)
        self.checked = code
        return code

    def _code(self, lanes: int) -> object:
        if (
            self.external
            or self.backend == "plain"
            or (self.backend == "auto" and os.environ.get("LABKIT_BACKEND") == "plain")
        ):
            if self.external and self.backend == "compiled":
                raise ModelError(
                    f"method {self.method!r} is SciPy's and runs with backend='plain' or 'auto' only"
                )
            return None
        # many lanes in plain Python would take longer than the compiler needs for a model
        return compiled(
            self.system, wait=self.backend == "compiled", patience=0.0 if lanes < 10 else 3.0
        )

    def check_start(self, start: tuple[float, ...], mode: str, p: tuple) -> None:
        """Why a start does not do, in words: the model's functions are tried, and a guard that is passed already is refused."""
        check_functions(self.system, p, self.t0, start, mode)
        s = self.system.S[mode](*start)
        for i in self.system.leaving[mode]:
            tr = self.system.transitions[i]
            if tr.guard is None or tr.direction == 0 or tr.urgent is not None:
                continue
            value = float(tr.guard(self.t0, s, p))
            beyond = tr.direction * value - tr.tolerance
            if beyond > 1e-9 * (1 + max(map(abs, start))):
                side = "> 0" if tr.direction > 0 else "< 0"
                raise ModelError(
                    f"the start does not fit mode {mode!r}: the guard of {tr.name!r} is already {value:.6g} ({side}) at t = {self.t0:g}. "
                    f"Start elsewhere, choose another mode{'' if tr.target in (None, mode) else f' (mode={tr.target!r}?)'}, or say what the transition "
                    f"shall do: urgent=True fires at once, urgent=False waits for the next crossing"
                )


#: Settings used lately, so that a slider's next position need not make them again.
_settings_of: WeakKeyDictionary[System, dict[tuple, Settings]] = WeakKeyDictionary()


def _settings(system: System, *options: object) -> Settings:
    try:
        kept = _settings_of.setdefault(system, {})
        if found := kept.get(options):
            return found
    except TypeError:  # an array of sample times is no key
        return Settings(system, *options)  # type: ignore[arg-type]
    made = Settings(system, *options)  # type: ignore[arg-type]
    if len(kept) >= 8:
        kept.clear()
    kept[options] = made
    return made


def _count(value: object, what: str) -> int:
    if isinstance(value, bool) or int(value) != value or value < 1:  # type: ignore[call-overload]
        raise ModelError(f"{what} must be a whole number of at least 1, not {value!r}")
    return int(value)  # type: ignore[call-overload]


def _start(
    system: System, start: Mapping[str, float], mode: str | None, t0: float, p: tuple
) -> tuple[tuple[float, ...], str]:
    """The start state in the order of the start mode, which is given, or the system's, or chosen by the system's function."""
    mode = mode or system.mode
    if callable(mode):
        s = system.S[next(iter(system.modes))]
        values = {name: number(start.get(name, np.nan), f"start of {name!r}") for name in s._fields}
        mode = mode(t0, s(**values), p)
    if mode not in system.modes:
        raise ModelError(
            f"start mode {mode!r} is not a mode of {system.name!r}; there are {listed(system.modes)}"
        )
    own = system.S[mode]._fields
    return system.check_start(
        {k: v for k, v in start.items() if k in own or k not in system.units}, mode
    ), mode


def _starts(
    settings: Settings, start: Mapping[str, object], mode: str | None, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Start states (lanes, width) and modes (lanes,) of many lanes."""
    system, lanes = settings.system, len(p)
    begin = np.zeros((lanes, settings.width))
    if callable(mode or system.mode):
        lists = {key: np.broadcast_to(value, lanes).tolist() for key, value in start.items()}
        modes = np.zeros(lanes, dtype=np.int64)
        for lane, values in enumerate(p.tolist()):
            state, name = _start(
                system,
                {key: value[lane] for key, value in lists.items()},
                mode,
                settings.t0,
                system.P(*values),
            )
            begin[lane, : len(state)], modes[lane] = state, settings.place[name]
        return begin, modes
    first = {key: float(np.ravel(value)[0]) for key, value in start.items()}
    _, name = _start(system, first, mode, settings.t0, ())
    for place, key in enumerate(system.states_of(name)):
        for extreme in (np.min(start[key]), np.max(start[key])):
            number(float(extreme), f"start of {key!r}")
        begin[:, place] = start[key]
    return begin, np.full(lanes, settings.place[name])
