"""Simulation: simulate(system, t_end) and simulate_many(system, t_end, start={"x": array}).

    run = simulate(ball, 12.0, e=0.9, start={"y": 5.0}, method="DOP853", rtol=1e-8)

The work is done by core.py, compiled (backend.py) or as plain Python from the same source; methods.py has the
tables, functions.py turns a model's functions into what the core calls, scipy_step.py lets SciPy's implicit methods
take the steps.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from types import SimpleNamespace
from weakref import WeakKeyDictionary

import numpy as np

from ..model import At, Every, ModelError, System, listed, number
from ..run import Event, Events, Run, Runs, Touch, Work
from . import core
from .backend import addresses, compiled, core_is_kept, load_core
from .functions import Plain, check_functions, orientations
from .layout import workspace
from .methods import DEGREE, FIXED_STEP, METHODS, explicit, proxy
from .scipy_step import SciPyStep

__all__ = ["METHODS", "simulate", "simulate_many", "warm"]

BACKENDS = ("auto", "compiled", "plain")
OUTPUTS = ("out", "ledger", "pieces")  # the fields that grow, in the order of w.room


def simulate(system: System, t_end: float, *, t0: float = 0.0, start: Mapping[str, float] | None = None, mode: str | None = None,
             method: str = "DOP853", rtol: float = 1e-8, atol: float = 1e-10, step: float | None = None, max_step: float | None = None,
             points: int | np.ndarray = 500, locate: bool = True, backend: str = "auto", max_events: int = 100_000,
             max_steps: int = 1_000_000, **parameters: float) -> Run:
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
    settings = _settings(system, t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events, max_steps, True)
    p = system.values(parameters)
    begin, first_mode = _start(system, {**system.start, **start} if start else system.start, mode, settings.t0, p)
    code = settings.code(p, begin, first_mode)
    batch = settings.free.pop() if settings.free and settings.free[-1].code is code and code is not None else _Batch(settings, code, 1)
    batch.load(np.array([p]), np.array([begin]), np.array([settings.place[first_mode]]))
    batch.run()
    run = batch.as_run(p, began)
    if code is not None:
        settings.free.append(batch)  # its memory serves the next run
    return run


def simulate_many(system: System, t_end: float, *, t0: float = 0.0, start: Mapping[str, object] | None = None, mode: str | None = None,
                  method: str = "DOP853", rtol: float = 1e-6, atol: float = 1e-9, step: float | None = None, max_step: float | None = None,
                  points: int | np.ndarray = 300, locate: bool = True, backend: str = "auto", max_events: int = 10_000,
                  max_steps: int = 1_000_000, workers: int | None = None, **parameters: object) -> Runs:
    """simulate_many(system, 20.0, start={"x": array, "v": 0.0}, k=array) -> Runs, one run for each entry of the arrays.

    `start` and parameters take numbers or one-dimensional arrays of one common length; everything else is as in
    `simulate`. Compiled runs are shared out over all cores (`workers` threads). Raises ModelError as `simulate` does.
    """
    began = perf_counter()
    settings = _settings(system, t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events, max_steps, False)
    given, starting = ({key: np.asarray(value, dtype=float) for key, value in some.items()} for some in (parameters, start or {}))
    columns = [*given.items(), *starting.items()]
    lengths = {key: len(value) for key, value in columns if value.ndim == 1}
    if any(value.ndim > 1 for _, value in columns) or len(set(lengths.values())) > 1:
        raise ModelError(f"simulate_many takes numbers and arrays of one common length; here {lengths or 'arrays of two dimensions'}")
    lanes = next(iter(lengths.values()), 1)
    if lanes == 0:
        raise ModelError(f"simulate_many got arrays without entries for {listed(lengths)}: there is nothing to simulate")
    for key, value in given.items():
        for extreme in (value.min(), value.max()):  # NaN where there is one; and what lies between is in range, too
            system.values({key: float(extreme)})
    p = np.empty((lanes, len(system.parameters)))
    for place, (key, parameter) in enumerate(system.parameters.items()):
        p[:, place] = given.get(key, parameter.value)
    begin, modes = _starts(settings, {**system.start, **starting}, mode, p)
    name = settings.modes[modes[0]]
    code = settings.code(system.P(*p[0].tolist()), tuple(begin[0].tolist()[: len(system.states_of(name))]), name, lanes)
    threads = 1 if code is None else min(workers or os.cpu_count() or 1, lanes)
    blocks = np.array_split(np.arange(lanes), 1 if threads == 1 else min(4 * threads, lanes))
    batches = []
    for block in blocks:
        batch = _Batch(settings, code, len(block))
        batch.load(p[block], begin[block], modes[block])
        batches.append(batch)
    if threads == 1:
        batches[0].run()
    else:  # the compiled core lets go of the interpreter's lock
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(_Batch.run, batches))
    return _gather(settings, p, batches, began)


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


class _Settings:
    """What all runs with the same options share, checked: method tables, structure of the modes; and workspaces to use again."""

    def __init__(self, system: System, t_end: float, t0: float, method: str, rtol: float, atol: float, step: float | None, max_step: float | None,
                 points: int | np.ndarray, locate: bool, backend: str, max_events: int, max_steps: int, dense: bool):
        self.system, self.dense, self.locate = system, dense, bool(locate)
        self.t0, self.t_end = number(t0, "t0"), number(t_end, "t_end")
        if self.t_end <= self.t0:
            raise ModelError(f"t_end = {self.t_end:g} must lie after t0 = {self.t0:g}: runs go forward in time")
        if method not in METHODS:
            raise ModelError(f"there is no method {method!r}; there are {listed(METHODS)}")
        if backend not in BACKENDS:
            raise ModelError(f"there is no backend {backend!r}; there are {listed(BACKENDS)}")
        self.method, self.backend = method, backend
        self.rtol, self.atol = number(rtol, "rtol"), number(atol, "atol")
        if not 0 < self.rtol < 1 or self.atol < 0:
            raise ModelError(f"rtol = {self.rtol:g} must lie between 0 and 1, and atol = {self.atol:g} must not be negative")
        self.rtol = max(self.rtol, 100 * core.EPS)
        span = self.t_end - self.t0
        self.max_step = float("inf") if max_step is None else number(max_step, "max_step")
        self.step = span / 1000 if step is None else number(step, "step")
        if self.step <= 0 or self.max_step <= 0:
            raise ModelError(f"step = {self.step:g} and max_step = {self.max_step:g} must be positive")
        self.max_events, self.max_steps = _count(max_events, "max_events"), _count(max_steps, "max_steps")
        if np.ndim(points) == 0:
            self.grid = np.linspace(self.t0, self.t_end, max(2, _count(points, "points")))
        else:
            self.grid = np.asarray(points, dtype=float)
            if not (np.all(np.diff(self.grid) > 0) and len(self.grid) and self.grid[0] >= self.t0 and self.grid[-1] <= self.t_end):
                raise ModelError(f"points must be times in rising order between t0 = {self.t0:g} and t_end = {self.t_end:g}, or a number of samples")
        self.external = method in DEGREE
        self.table = explicit("RK45") if self.external else explicit(method)
        self.degree = DEGREE[method] if self.external else self.table.Q.shape[0]
        self.proxy = min(max(self.degree + 1, 4), 8)
        self.modes = list(system.modes)
        self.place = {mode: index for index, mode in enumerate(self.modes)}
        self.width = max(len(system.states_of(m)) for m in self.modes)
        self.plans = [tr for tr in system.transitions if tr.at is not None]
        self.fixed = self._fixed()
        self.free: list[_Batch] = []
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
            core.FRESH: 1, core.ENTRY: 1, core.STAGES: table.stages, core.DEGREE: self.degree, core.PROXY: self.proxy,
            core.ADAPTIVE: 2 if self.external else 0 if self.method in FIXED_STEP else 1, core.TWO: self.method == "DOP853", core.LOCATE: self.locate,
            core.DENSE: self.dense, core.TRANSITIONS: len(trs), core.MAX_EVENTS: self.max_events, core.MAX_STEPS: self.max_steps, core.ORDER: table.order,
            core.ROWS: len(table.A), core.WIDTH: self.width, core.PARAMETERS: len(system.parameters), core.SAMPLES: len(self.grid),
            core.SCHEDULES: len(self.plans), core.POWERS: not table.Q.any(),
        }.items():
            i0[place] = value
        for place, value in {
            core.T: self.t0, core.H: self.step if self.method in FIXED_STEP else 0.0, core.T_END: self.t_end, core.RTOL: self.rtol, core.ATOL: self.atol,
            core.MAX_STEP: self.max_step, core.T0: self.t0, core.EVENT_T: -1e300, core.DUE_T: -1e300, core.SPAN: self.t_end - self.t0,
        }.items():
            f0[place] = value
        fixed = {
            "i0": i0, "f0": f0, "c": table.C, "grid": self.grid, "size": [len(system.states_of(m)) for m in modes],
            "leave_from": np.cumsum([0, *map(len, leave)]), "leave": sum(leave, []),
            "source": np.array([[m in tr.sources for m in modes] for tr in trs]).reshape(len(trs), len(modes)),
            "target": [-1 if tr.target is None else self.place[tr.target] for tr in trs], "zeno": [-1 if tr.zeno is None else self.place[tr.zeno] for tr in trs],
            "directed": [tr.direction != 0 for tr in trs], "urgent": [urgent[tr.urgent] for tr in trs], "rank": np.argsort(order), "tolerance": [tr.tolerance for tr in trs],
            "plan": [system.transitions.index(tr) for tr in self.plans], "plan_from": np.cumsum([0, *instants]),
        }
        interpolant = (np.zeros((self.degree, 1)),) * 2 if self.external else (table.W.T, table.Q)  # SciPy's methods bring their own
        for name, matrix in zip("aewq", (table.A, table.E, *interpolant), strict=True):
            rows, columns = np.nonzero(matrix)
            fixed |= {f"{name}_from": np.searchsorted(rows, np.arange(len(matrix) + 1)), f"{name}_column": columns, f"{name}_value": matrix[rows, columns]}
        fixed["node"], fixed["bernstein"], fixed["test"] = proxy(self.proxy)
        self.sizes = {
            "n": self.width, "modes": len(modes), "transitions": len(trs), "guards": len(fixed["leave"]), "rows": len(table.A), "degree": self.degree, "proxy": self.proxy,
            "instants": sum(instants), "schedules": len(self.plans), "grid": len(self.grid), **{name: len(fixed[f"{name}_value"]) for name in "aewq"},
        }
        kinds = {name: kind for name, kind, _ in core.FIELDS}
        return {name: np.ascontiguousarray(value, dtype=float if kinds[name] == "f" else np.int64) for name, value in fixed.items()}

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
        if self.external or self.backend == "plain" or (self.backend == "auto" and os.environ.get("LABKIT_BACKEND") == "plain"):
            if self.external and self.backend == "compiled":
                raise ModelError(f"method {self.method!r} is SciPy's and runs with backend='plain' or 'auto' only")
            return None
        # many lanes in plain Python would take longer than the compiler needs for a model
        return compiled(self.system, wait=self.backend == "compiled", patience=0.0 if lanes < 10 else 3.0)

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
_settings_of: WeakKeyDictionary[System, dict[tuple, _Settings]] = WeakKeyDictionary()


def _settings(system: System, *options: object) -> _Settings:
    try:
        kept = _settings_of.setdefault(system, {})
        if found := kept.get(options):
            return found
    except TypeError:  # an array of sample times is no key
        return _Settings(system, *options)  # type: ignore[arg-type]
    made = _Settings(system, *options)  # type: ignore[arg-type]
    if len(kept) >= 8:
        kept.clear()
    kept[options] = made
    return made


def _count(value: object, what: str) -> int:
    if isinstance(value, bool) or int(value) != value or value < 1:  # type: ignore[call-overload]
        raise ModelError(f"{what} must be a whole number of at least 1, not {value!r}")
    return int(value)  # type: ignore[call-overload]


def _start(system: System, start: Mapping[str, float], mode: str | None, t0: float, p: tuple) -> tuple[tuple[float, ...], str]:
    """The start state in the order of the start mode, which is given, or the system's, or chosen by the system's function."""
    mode = mode or system.mode
    if callable(mode):
        s = system.S[next(iter(system.modes))]
        values = {name: number(start.get(name, np.nan), f"start of {name!r}") for name in s._fields}
        mode = mode(t0, s(**values), p)
    if mode not in system.modes:
        raise ModelError(f"start mode {mode!r} is not a mode of {system.name!r}; there are {listed(system.modes)}")
    own = system.states_of(mode)
    return system.check_start({k: v for k, v in start.items() if k in own or k not in system.units}, mode), mode


def _starts(settings: _Settings, start: Mapping[str, object], mode: str | None, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start states (lanes, width) and modes (lanes,) of many lanes."""
    system, lanes = settings.system, len(p)
    begin = np.zeros((lanes, settings.width))
    if callable(mode or system.mode):
        lists = {key: np.broadcast_to(value, lanes).tolist() for key, value in start.items()}
        modes = np.zeros(lanes, dtype=np.int64)
        for lane, values in enumerate(p.tolist()):
            state, name = _start(system, {key: value[lane] for key, value in lists.items()}, mode, settings.t0, system.P(*values))
            begin[lane, : len(state)], modes[lane] = state, settings.place[name]
        return begin, modes
    first = {key: float(np.ravel(value)[0]) for key, value in start.items()}
    _, name = _start(system, first, mode, settings.t0, ())
    for place, key in enumerate(system.states_of(name)):
        for extreme in (np.min(start[key]), np.max(start[key])):
            number(float(extreme), f"start of {key!r}")
        begin[:, place] = start[key]
    return begin, np.full(lanes, settings.place[name])


class _Batch:
    """Runs under way, one after the other: their workspace, and what is needed to turn it into results."""

    def __init__(self, settings: _Settings, code: object, lanes: int):
        self.settings, self.code, self.lanes = settings, code, lanes
        self.sizes = {**settings.sizes, "lanes": lanes, "ledger": 64, "pieces": 256 if settings.dense else 1}
        self.sizes["out"] = lanes * (len(settings.grid) + 8) + 200
        made, plain = [], code is None
        for name, kind, shape in self._fields():
            if plain and name in OUTPUTS:  # rows are added as they are needed
                made.append(_Rows(shape[1]))
            elif name in settings.fixed:
                made.append(settings.fixed[name].tolist() if plain else settings.fixed[name])
            else:
                array = (np.empty if name == "out" else np.zeros)(shape, dtype=float if kind == "f" else np.int64)
                made.append(array.tolist() if plain else array)
        self.w = core.Workspace(*made)
        self.w.room[:] = [self.sizes[name] for name in OUTPUTS]
        self.p = np.zeros((lanes, len(settings.system.parameters)))
        self.table: np.ndarray | None = None
        if plain:
            self.model = Plain(settings.system, orientations(settings.system))
            if settings.external:
                self.model.stepper = SciPyStep(settings, self.model, settings.width)

    def _fields(self) -> tuple:
        return workspace(SimpleNamespace(**self.sizes))

    def load(self, p: np.ndarray, start: np.ndarray, modes: np.ndarray) -> None:
        """Parameters (lanes, parameters), start states (lanes, states of the mode) and modes (lanes,) of the runs to make."""
        st, w = self.settings, self.w
        self.reasons: dict[int, str] = {}
        self.p[:] = p
        if self.code is None:
            self.p_lanes = [st.system.P(*values) for values in p.tolist()]
            w.y0[:] = np.pad(start, ((0, 0), (0, st.width - start.shape[1]))).tolist()
        else:
            w.y0[:, : start.shape[1]] = start
        w.mode0[:] = modes if self.code else modes.tolist()
        for i, tr in enumerate(st.system.transitions):
            if tr.delay != 0:
                delay = self._resolve(tr.delay, f"the delay of {tr.name!r}")
                if delay.min() < 0:
                    raise ModelError(f"the delay of {tr.name!r} is {delay.min():g}: a dead time cannot be negative")
                self._put("delay", i, delay)
        for k, tr in enumerate(st.plans):
            self._load_schedule(k, tr)
        w.i[core.LANE] = w.i[core.BEGUN] = w.i[core.OUT] = 0
        w.i[core.LANES] = self.lanes

    def _load_schedule(self, k: int, tr) -> None:
        """Of a scheduled transition: instants t0 + first + m·period for m = 0 or 1, 2, …; or a list of instants, none before t0."""
        if isinstance(tr.at, Every):
            period = self._resolve(tr.at.period, f"the period of {tr.name!r}")
            first = self._resolve(0.0 if tr.at.first is None else tr.at.first, f"the first instant of {tr.name!r}")
            if period.min() <= 0 or first.min() < 0:
                raise ModelError(f"the schedule of {tr.name!r} has period {period.min():g} and first instant {first.min():g}: a period must be positive, an instant not negative")
            self._put("plan_first", k, first)
            self._put("plan_period", k, period)
            self._put("plan_next0", k, np.full(self.lanes, int(tr.at.first is None)))
        elif tr.at.instants:
            found = np.sort([self._resolve(x, f"an instant of {tr.name!r}") for x in tr.at.instants], axis=0)
            for place, column in enumerate(found, self.settings.fixed["plan_from"][k]):
                self._put("instant", place, column)
            self._put("plan_next0", k, (found < self.settings.t0).sum(axis=0))

    def _resolve(self, value: object, what: str) -> np.ndarray:
        """A number, a parameter's name or a function of p, for every lane."""
        system = self.settings.system
        if callable(value):
            return np.array([system.resolve(value, system.P(*p), what) for p in self.p.tolist()])
        if isinstance(value, str):
            return self.p[:, list(system.parameters).index(value)]
        return np.full(self.lanes, system.resolve(value, (), what))

    def _put(self, name: str, column: int, values: np.ndarray) -> None:
        rows = getattr(self.w, name)
        if self.code is not None:
            rows[:, column] = values
        else:
            for row, value in zip(rows, values.tolist(), strict=True):
                row[column] = value

    def run(self) -> None:
        w, status = self.w, core.PAUSE
        while not (status == core.FINISHED or (status not in (core.PAUSE, core.GROW) and w.i[core.LANE] == self.lanes)):
            if self.code is None:
                status = core.sweep(self.model, w, self.p_lanes, 10_000)
            else:  # in portions, so that an interrupt from the keyboard is heard
                if self.table is None:
                    self.table = addresses(self.code.model, self.p, 200_000, w)
                    self.address = self.table.ctypes.data
                status = self.code.run(self.address)
            if status == core.GROW:
                self._grow()
                w = self.w
            elif status == core.BAD_START:
                lane = w.i[core.LANE] - 1
                mode = self.settings.modes[w.i[core.MODE]]
                start = tuple(map(float, list(w.y)[: len(self.settings.system.states_of(mode))]))
                self.settings.check_start(start, mode, self.settings.system.P(*self.p[lane].tolist()))
                raise ModelError(f"the flow of mode {mode!r} or a guard there is not a number at the start {start}, t = {self.settings.t0:g}")
            elif status not in (core.PAUSE, core.FINISHED):
                self.reasons[w.i[core.LANE] - 1] = self._reason(status)

    def _grow(self) -> None:
        """More room for events, pieces or samples, whichever is short; what is there stays."""
        w = self.w
        for name, used in (("ledger", w.i[core.LEDGER] + 2), ("pieces", w.i[core.PIECES] + 1), ("out", w.i[core.OUT] + len(self.settings.grid) + 4)):
            if used > self.sizes[name]:
                self.sizes[name] = max(4 * self.sizes[name] if name != "out" else 2 * self.sizes[name], used)
        replaced = {}
        for name, _, shape in self._fields():
            if name in OUTPUTS and self.code is not None and len(old := getattr(w, name)) < shape[0]:
                replaced[name] = np.empty(shape)
                replaced[name][: len(old)] = old
        self.w, self.table = w._replace(**replaced), None
        self.w.room[:] = [self.sizes[name] for name in OUTPUTS]

    def reason(self, lane: int) -> str:
        if lane in self.reasons:
            return self.reasons[lane]
        status, last = self.w.done[lane][core.STATUS], self.w.done[lane][core.LAST]
        return "finished" if status == core.FINISHED else f'terminal event "{self.settings.system.transitions[last].name}"'

    def _reason(self, status: int) -> str:
        """Of the lane that has just ended, from its workspace."""
        system, w = self.settings.system, self.w
        name = system.transitions[w.i[core.WHO]].name if system.transitions else ""
        t = f"t = {w.f[core.T]:.6g}"
        if status == core.TERMINAL:
            return f'terminal event "{name}"'
        if status == core.ZENO:
            return f'Zeno at t = {w.f[core.ZENO_T]:.10g}: "{name}" repeats infinitely often before that instant (give its transition zeno="…", a mode to rest in)'
        if status == core.CONTACT:
            return f'resting contact at {t}: after "{name}" its guard does not leave zero (give its transition zeno="…", a mode to rest in)'
        if status == core.LOOP:
            return f'endless loop at {t}: {core.SAME_INSTANT} events at one instant, the last of them "{name}" (chattering: the flows on both sides of its guard push towards it)'
        if status == core.EVENTS_OUT:
            return f'too many events: {w.i[core.LEDGER]} by {t}, the last of them "{name}" (max_events={self.settings.max_events})'
        if status == core.STEPS_OUT:
            return f"too many steps: {w.i[core.STEPS] + w.i[core.REJECTED]} by {t} (max_steps={self.settings.max_steps})"
        if status == core.QUEUE_FULL:
            return f'too many dead-time transitions under way at {t}: "{name}"'
        if status == core.GUARD_NAN:
            return f'not a number: the guard of "{name}" at {t}'
        return self._why_no_step(t)

    def _why_no_step(self, t: str) -> str:
        """The step shrank to nothing (or a fixed step overflowed): a flow that is no number, a state out of hand, or a singular or stiff system."""
        system, mode = self.settings.system, self.settings.modes[self.w.i[core.MODE]]
        names = system.states_of(mode)
        y = [float(v) for v in list(self.w.y)[: len(names)]]
        # The last attempt's stages are still there: one that is no number tells more than the tiny step
        stages = np.array([] if self.settings.external else list(self.w.k), dtype=float).reshape(-1, self.settings.width)[: self.settings.table.stages + 1]
        if bad := [n for k, n in enumerate(names) if not np.all(np.isfinite(stages[:, k]))]:
            return f"not a number: the flow of mode {mode!r} gives no finite value for {listed(bad)} near {t}"
        biggest = max(range(len(names)), key=lambda k: abs(y[k]))
        if abs(y[biggest]) > 1e8 or self.settings.method in FIXED_STEP:
            return f"diverged: |{names[biggest]}| = {abs(y[biggest]):.3g} at {t}"
        return f"no step is short enough at {t} in mode {mode!r}: the flow is singular there, or stiff (try method='Radau')"

    def rows(self, name: str, count: int) -> np.ndarray:
        """The first rows of an output, copied."""
        rows = getattr(self.w, name)
        if self.code is not None:
            return rows[:count].copy()
        return np.array(rows.rows[:count], dtype=float).reshape(count, rows.width)

    def as_run(self, p: tuple, began: float) -> Run:
        st, i = self.settings, self.w.i
        out, ledger = self.rows("out", i[core.OUT]), self.rows("ledger", i[core.LEDGER])
        touches = np.array(self.w.touch)[: i[core.TOUCHES]].tolist()
        work = Work(int(i[core.STEPS]), int(i[core.REJECTED]), int(i[core.FLOWS]), int(i[core.GUARDS]), len(ledger), 0.0, st.method, "plain" if self.code is None else "compiled")
        run = Run(st.system, p, out[:, 0].copy(), out[:, 2].astype(int), out[:, 1].astype(int), out[:, 3:], Events(len(ledger), lambda: _events(st, ledger)),
                  self.reason(0), work, self.rows("pieces", i[core.PIECES]), [Touch(t, st.system.transitions[int(who)].name, by) for t, who, by in touches])
        object.__setattr__(work, "seconds", perf_counter() - began)
        return run


class _Rows:
    """A list of rows for the plain back end that makes a row when it is first touched."""

    def __init__(self, width: int):
        self.width, self.rows = width, []

    def __getitem__(self, index: int) -> list[float]:
        while len(self.rows) <= index:
            self.rows.append([0.0] * self.width)
        return self.rows[index]


def _events(settings: _Settings, ledger: np.ndarray) -> list[Event]:
    """The ledger's rows as events."""
    system, modes, width, events = settings.system, settings.modes, settings.width, []
    for line in ledger.tolist():
        tr = system.transitions[int(line[1])]
        source, target = ("sliding" if m == core.SLIDE else None if m < 0 else modes[int(m)] for m in line[3:5])
        one, other = (m if m in system.modes else tr.sources[0] for m in (source, target or source))
        before = dict(zip(system.states_of(one), line[5:], strict=False))
        after = dict(zip(system.states_of(other), line[5 + width :], strict=False))
        name = f"{tr.name} (sliding)" if "sliding" in (source, target) else tr.name
        events.append(Event(line[0], name, source, target, before, after, int(line[1])))
    return events


def _gather(settings: _Settings, p: np.ndarray, batches: list[_Batch], began: float) -> Runs:
    """The samples of all lanes, which stand one after the other, as rectangular arrays."""
    system = settings.system
    done = np.concatenate([np.array(batch.w.done) for batch in batches])
    out = np.concatenate([batch.rows("out", batch.w.i[core.OUT]) for batch in batches])
    counts = np.concatenate([np.diff([0, *np.array(batch.w.done)[:, core.END]]) for batch in batches])
    shape = len(counts), int(counts.max())
    lane, starts = np.repeat(np.arange(len(counts)), counts), np.cumsum(counts) - counts
    place = np.arange(len(out)) - np.repeat(starts, counts)
    t, modes, values = np.full(shape, np.nan), np.full(shape, -1), np.full((*shape, settings.width), np.nan)
    t[lane, place], modes[lane, place], values[lane, place] = out[:, 0], out[:, 1], out[:, 3:]
    total = done.sum(axis=0).tolist()
    work = Work(*(total[k] for k in (core.ACCEPTED, core.FAILED, core.RATES, core.LOOKS, core.EVENTS)), perf_counter() - began, settings.method, "plain" if batches[0].code is None else "compiled")
    reasons = [batch.reason(lane) for batch in batches for lane in range(batch.lanes)]
    return Runs(system, [system.P(*values) for values in p.tolist()], t, modes, values, done[:, core.EVENTS].copy(), reasons, work)
