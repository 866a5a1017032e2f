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

import numpy as np

from ..model import At, Every, ModelError, System, listed, number
from ..run import Event, Run, Runs, Work
from . import core
from .backend import addresses, compiled, core_is_kept, load_core
from .functions import Plain, check_functions, orientations
from .methods import DEGREE, FIXED_STEP, METHODS, explicit, proxy
from .scipy_step import SciPyStep

__all__ = ["METHODS", "simulate", "simulate_many", "warm"]

BACKENDS = ("auto", "compiled", "plain")


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
    settings = _Settings(system, t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events, max_steps)
    p = system.values(parameters)
    begin, first_mode = _start(system, {**system.start, **(start or {})}, mode, settings.t0, p)
    check_functions(system, p, settings.t0, begin, first_mode)
    code = settings.code()
    settings.ready(code is None)
    lane = _Lane(settings, p, begin, first_mode, code)
    status = lane.run()
    return lane.as_run(status, perf_counter() - began)


def simulate_many(system: System, t_end: float, *, t0: float = 0.0, start: Mapping[str, object] | None = None, mode: str | None = None,
                  method: str = "DOP853", rtol: float = 1e-6, atol: float = 1e-9, step: float | None = None, max_step: float | None = None,
                  points: int | np.ndarray = 300, locate: bool = True, backend: str = "auto", max_events: int = 10_000,
                  max_steps: int = 1_000_000, workers: int | None = None, **parameters: object) -> Runs:
    """simulate_many(system, 20.0, start={"x": array, "v": 0.0}, k=array) -> Runs, one run for each entry of the arrays.

    `start` and parameters take numbers or one-dimensional arrays of one common length; everything else is as in
    `simulate`. Compiled runs are shared out over all cores (`workers` threads). Raises ModelError as `simulate` does.
    """
    began = perf_counter()
    settings = _Settings(system, t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events, max_steps, dense=False)
    given = {**system.start, **(start or {})}
    columns = {**{("start", k): np.asarray(v, dtype=float) for k, v in given.items()}, **{("p", k): np.asarray(v, dtype=float) for k, v in parameters.items()}}
    lengths = {k[1]: len(v) for k, v in columns.items() if v.ndim == 1}
    if any(v.ndim > 1 for v in columns.values()) or len(set(lengths.values())) > 1:
        raise ModelError(f"simulate_many takes numbers and arrays of one common length; here {lengths or 'arrays of two dimensions'}")
    lanes = next(iter(lengths.values()), 1)
    full = {k: np.broadcast_to(v, (lanes,)).tolist() for k, v in columns.items()}
    code = settings.code(lanes)
    settings.ready(code is None)
    prepared = []
    for i in range(lanes):
        p = system.values({k[1]: v[i] for k, v in full.items() if k[0] == "p"})
        begin, first_mode = _start(system, {k[1]: v[i] for k, v in full.items() if k[0] == "start"}, mode, settings.t0, p)
        if i == 0:
            check_functions(system, p, settings.t0, begin, first_mode)
        prepared.append((p, begin, first_mode))

    def work(i: int) -> tuple:
        lane = _Lane(settings, *prepared[i], code)
        return lane, lane.run()

    if code is None or lanes == 1:
        done = [work(i) for i in range(lanes)]
    else:  # the compiled core lets go of the interpreter's lock
        with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
            done = list(pool.map(work, range(lanes)))
    return _gather(settings, done, perf_counter() - began)


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
    """What all lanes of a call share, checked: method tables, structure of the modes, options."""

    def __init__(self, system: System, t_end: float, t0: float, method: str, rtol: float, atol: float, step: float | None, max_step: float | None,
                 points: int | np.ndarray, locate: bool, backend: str, max_events: int, max_steps: int, dense: bool = True):
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
        self.width = max(len(system.states_of(m)) for m in self.modes)
        self.plans = [i for i, tr in enumerate(system.transitions) if tr.at is not None]
        self.fixed = self._fixed()

    def _fixed(self) -> dict[str, np.ndarray]:
        """The fields of the workspace that are the same for every lane: the method's table and the structure of the modes."""
        system, table, trs, modes = self.system, self.table, self.system.transitions, self.modes
        rows = table.A.shape[0]
        a_from, a_column, a_value = _sparse(table.A)
        w_from, w_row, w_value = _sparse(np.zeros((self.degree, rows)) if self.external else table.W.T)
        q = np.zeros((self.degree, self.degree)) if self.external else table.Q
        node, bernstein, test = proxy(self.proxy)
        leave = [[i for i in system.leaving[m] if trs[i].guard is not None] for m in modes]
        order = sorted(range(len(trs)), key=lambda i: (-trs[i].priority, i))
        fixed = {
            "a_from": a_from, "a_column": a_column, "a_value": a_value, "b": [*table.B, *[0.0] * (rows - len(table.B))], "c": table.C, "e": table.E,
            "w_from": w_from, "w_row": w_row, "w_value": w_value, "q": q, "node": node, "bernstein": bernstein, "test": test,
            "size": [len(system.states_of(m)) for m in modes], "leave_from": np.cumsum([0, *map(len, leave)]), "leave": sum(leave, []),
            "source": np.array([[m in tr.sources for m in modes] for tr in trs]).reshape(len(trs), len(modes)),
            "target": [-1 if tr.target is None else modes.index(tr.target) for tr in trs],
            "zeno": [-1 if tr.zeno is None else modes.index(tr.zeno) for tr in trs],
            "directed": [tr.direction != 0 for tr in trs], "urgent": [bool(tr.urgent) for tr in trs], "rank": np.argsort(order), "plan": self.plans, "grid": self.grid,
        }
        kinds = {name: kind for name, kind, _ in core.workspace(*[1] * 14)}
        return {name: np.ascontiguousarray(value, dtype=float if kinds[name] == "f" else np.int64) for name, value in fixed.items()}

    def ready(self, plain: bool) -> None:
        """Once before the first lane: lists for the plain back end, addresses for the compiled one."""
        self.shared = {name: array.tolist() if plain else array for name, array in self.fixed.items()}
        self.known = {} if plain else {name: array.ctypes.data for name, array in self.fixed.items()}

    def code(self, lanes: int = 1):
        if self.external or self.backend == "plain" or (self.backend == "auto" and os.environ.get("LABKIT_BACKEND") == "plain"):
            if self.external and self.backend == "compiled":
                raise ModelError(f"method {self.method!r} is SciPy's and runs with backend='plain' or 'auto' only")
            return None
        # many lanes in plain Python would take longer than the compiler needs for a model
        return compiled(self.system, wait=self.backend == "compiled", patience=0.0 if lanes < 10 else 3.0)


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


class _Lane:
    """One run under way: the workspace and what is needed to turn it into a result."""

    def __init__(self, settings: _Settings, p: tuple, start: tuple[float, ...], mode: str, code: object):
        self.settings, self.p, self.code = settings, p, code
        system = settings.system
        self.modes, self.width = settings.modes, settings.width
        self._check_guards(start, mode)
        self.sizes = {"events": 64, "pieces": 256 if settings.dense else 1}
        self.w = self._fill(start, mode)
        if code is None:
            self.model = Plain(system, p, orientations(system))
            if settings.external:
                self.model.stepper = SciPyStep(settings, self.model, self.width)
        else:
            self.model = code.model
            self.p_array = np.array(p, dtype=float)

    def _check_guards(self, start: tuple[float, ...], mode: str) -> None:
        """A start beyond a directed guard is refused: the mode would not hold there."""
        s, system = self.settings.system.S[mode](*start), self.settings.system
        for i in system.leaving[mode]:
            tr = system.transitions[i]
            if tr.guard is None or tr.direction == 0 or tr.urgent is not None:
                continue
            value = float(tr.guard(self.settings.t0, s, self.p))
            beyond = tr.direction * value - tr.tolerance
            if beyond > 1e-9 * (1 + max(map(abs, start))):
                side = "> 0" if tr.direction > 0 else "< 0"
                raise ModelError(
                    f"the start does not fit mode {mode!r}: the guard of {tr.name!r} is already {value:.6g} ({side}) at t = {self.settings.t0:g}. "
                    f"Start elsewhere, choose another mode{'' if tr.target in (None, mode) else f' (mode={tr.target!r}?)'}, or say what the transition "
                    f"shall do: urgent=True fires at once, urgent=False waits for the next crossing"
                )

    def _fill(self, start: tuple[float, ...], mode: str) -> core.Workspace:
        st, table, trs = self.settings, self.settings.table, self.settings.system.transitions
        instants = [self._instants(i) for i in st.plans]
        self.dimensions = (
            st.width, len(st.modes), len(trs), len(st.fixed["leave"]), table.A.shape[0], st.degree, st.proxy, sum(len(x[3]) for x in instants), len(st.plans), len(st.grid),
        )
        w = self._allocate({
            "delay": [self._delay(tr) for tr in trs], "plan_next": [x[0] for x in instants], "plan_first": [x[1] for x in instants],
            "plan_period": [x[2] for x in instants], "plan_from": np.cumsum([0, *(len(x[3]) for x in instants)]), "instant": sum((x[3] for x in instants), []),
            "last_t": [st.t0] * len(trs), "y": [*start, *[0.0] * (st.width - len(start))],
        })
        adaptive = 2 if st.external else 0 if st.method in FIXED_STEP else 1
        for place, value in {
            core.MODE: st.modes.index(mode), core.FRESH: 1, core.ENTRY: 1, core.STAGES: table.stages, core.DEGREE: st.degree, core.PROXY: st.proxy,
            core.ADAPTIVE: adaptive, core.TWO: st.method == "DOP853", core.LOCATE: st.locate, core.DENSE: st.dense,
            core.TRANSITIONS: len(trs), core.MAX_EVENTS: st.max_events, core.MAX_STEPS: st.max_steps, core.ORDER: table.order, core.ROWS: table.A.shape[0], core.WIDTH: st.width,
        }.items():
            w.i[place] = int(value)
        for place, value in {
            core.T: st.t0, core.H: st.step if adaptive == 0 else 0.0, core.T_END: st.t_end, core.RTOL: st.rtol, core.ATOL: st.atol,
            core.MAX_STEP: st.max_step, core.T0: st.t0, core.EVENT_T: -1e300, core.DUE_T: -1e300, core.SPAN: st.t_end - st.t0,
        }.items():
            w.f[place] = value
        return w

    def _delay(self, tr) -> float:
        value = self.settings.system.resolve(tr.delay, self.p, f"the delay of {tr.name!r}")
        if value < 0:
            raise ModelError(f"the delay of {tr.name!r} is {value:g}: a dead time cannot be negative")
        return value

    def _instants(self, i: int) -> tuple[int, float, float, list[float]]:
        """Of a scheduled transition: k, offset, period for instants t0 + offset + k·period; or 0, 0, 0 and a list (none before t0)."""
        system, tr = self.settings.system, self.settings.system.transitions[i]
        if isinstance(tr.at, Every):
            period = system.resolve(tr.at.period, self.p, f"the period of {tr.name!r}")
            first = 0.0 if tr.at.first is None else system.resolve(tr.at.first, self.p, f"the first instant of {tr.name!r}")
            if period <= 0 or first < 0:
                raise ModelError(f"the schedule of {tr.name!r} has period {period:g} and first instant {first:g}: a period must be positive, an instant not negative")
            return int(tr.at.first is None), first, period, []
        assert isinstance(tr.at, At)
        found = sorted(system.resolve(x, self.p, f"an instant of {tr.name!r}") for x in tr.at.instants)
        return 0, 0.0, 0.0, [x for x in found if x >= self.settings.t0]

    def _fields(self) -> tuple:
        n, modes, transitions, guards, rows, degree, top, instants, schedules, grid = self.dimensions
        nonzeros, weights = len(self.settings.fixed["a_value"]), len(self.settings.fixed["w_value"])
        return core.workspace(n, modes, transitions, guards, rows, degree, top, instants, schedules, grid, self.sizes["events"], self.sizes["pieces"], nonzeros, weights)

    def _allocate(self, values: Mapping[str, object]) -> core.Workspace:
        plain, shared, made = self.code is None, self.settings.shared, []
        for name, kind, shape in self._fields():
            if name in shared:
                made.append(shared[name])
            elif plain and name in ("out", "ledger", "pieces"):  # rows are added as they are needed
                made.append(_Rows(*shape))
            else:
                array = np.zeros(shape, dtype=float if kind == "f" else np.int64)
                if name in values and array.size:
                    array[:] = values[name]
                made.append(array.tolist() if plain else array)
        return core.Workspace(*made)

    def _grow(self) -> None:
        """Four times the room for events or pieces; what is there stays."""
        if self.w.i[core.LEDGER] + 2 > self.sizes["events"]:
            self.sizes["events"] *= 4
        if self.w.i[core.PIECES] + 1 > self.sizes["pieces"]:
            self.sizes["pieces"] *= 4
        replaced = {}
        for name, _, shape in self._fields():
            if name in ("out", "ledger", "pieces"):
                old = getattr(self.w, name)
                if self.code is None:
                    old.limit = shape[0]
                else:
                    replaced[name] = np.zeros(shape)
                    replaced[name][: len(old)] = old
        self.w = self.w._replace(**replaced)

    def run(self) -> int:
        status = core.PAUSE
        table = None
        while status in (core.PAUSE, core.GROW):
            if status == core.GROW:
                self._grow()
                table = None
            if self.code is None:
                status = core.advance(self.model, self.w, self.p, 10_000)
            else:  # in portions, so that an interrupt from the keyboard is heard
                if table is None:
                    table = addresses(self.model, self.p_array, 200_000, self.w, self.settings.known)
                status = self.code.run(table)
        w, mode = self.w, self.w.i[core.MODE]
        core.record(w, w.f[core.T], mode, w.size[mode], w.y)  # whatever stopped it, the last state reached is the last sample
        return status

    def reason(self, status: int) -> str:
        system, w = self.settings.system, self.w
        name = system.transitions[w.i[core.WHO]].name if system.transitions else ""
        t = f"t = {w.f[core.T]:.6g}"
        if status == core.FINISHED:
            return "finished"
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
        system, mode = self.settings.system, self.modes[self.w.i[core.MODE]]
        names = system.states_of(mode)
        y = [float(v) for v in list(self.w.y)[: len(names)]]
        # The last attempt's stages are still there: one that is no number tells more than the tiny step
        stages = np.array([] if self.settings.external else list(self.w.k), dtype=float).reshape(-1, self.width)[: self.settings.table.stages + 1]
        if bad := [n for k, n in enumerate(names) if not np.all(np.isfinite(stages[:, k]))]:
            return f"not a number: the flow of mode {mode!r} gives no finite value for {listed(bad)} near {t}"
        biggest = max(range(len(names)), key=lambda k: abs(y[k]))
        if abs(y[biggest]) > 1e8 or self.settings.method in FIXED_STEP:
            return f"diverged: |{names[biggest]}| = {abs(y[biggest]):.3g} at {t}"
        return f"no step is short enough at {t} in mode {mode!r}: the flow is singular there, or stiff (try method='Radau')"

    def _rows(self, name: str, count: int) -> np.ndarray:
        rows = getattr(self.w, name)
        if self.code is not None:
            return np.array(rows[:count])
        return np.array(rows.rows[:count], dtype=float).reshape(count, rows.width)

    def work(self, seconds: float) -> Work:
        i, st = self.w.i, self.settings
        return Work(int(i[core.STEPS]), int(i[core.REJECTED]), int(i[core.FLOWS]), int(i[core.GUARDS]), int(i[core.LEDGER]), seconds, st.method, "plain" if self.code is None else "compiled")

    def as_run(self, status: int, seconds: float) -> Run:
        system, w = self.settings.system, self.w
        out = self._rows("out", w.i[core.OUT])
        events = []
        for line in self._rows("ledger", w.i[core.LEDGER]):
            tr = system.transitions[int(line[1])]
            source, target = ("sliding" if m == core.SLIDE else None if m < 0 else self.modes[int(m)] for m in line[3:5])
            one, other = (m if m in system.modes else tr.sources[0] for m in (source, target or source))
            before = dict(zip(system.states_of(one), line[5:].tolist(), strict=False))
            after = dict(zip(system.states_of(other), line[5 + self.width :].tolist(), strict=False))
            name = f"{tr.name} (sliding)" if "sliding" in (source, target) else tr.name
            events.append(Event(float(line[0]), name, source, target, before, after, int(line[1])))
        pieces = self._rows("pieces", w.i[core.PIECES])
        return Run(system, self.p, out[:, 0].copy(), out[:, 2].astype(int), out[:, 1].astype(int), out[:, 3:], events, self.reason(status), self.work(seconds), pieces)


class _Rows:
    """A list of rows for the plain back end that makes a row when it is first touched; its len is the limit."""

    def __init__(self, limit: int, width: int):
        self.limit, self.width, self.rows = limit, width, []

    def __len__(self) -> int:
        return self.limit

    def __getitem__(self, index: int) -> list[float]:
        while len(self.rows) <= index:
            self.rows.append([0.0] * self.width)
        return self.rows[index]


def _sparse(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row starts, columns and values of the nonzeros, row by row."""
    rows, columns = np.nonzero(matrix)
    return np.searchsorted(rows, np.arange(matrix.shape[0] + 1)), columns, matrix[rows, columns]


def _gather(settings: _Settings, done: list[tuple[_Lane, int]], seconds: float) -> Runs:
    system = settings.system
    longest = max(lane.w.i[core.OUT] for lane, _ in done)
    width = done[0][0].width
    t = np.full((len(done), longest), np.nan)
    modes = np.full((len(done), longest), -1)
    values = np.full((len(done), longest, width), np.nan)
    for row, (lane, _) in enumerate(done):
        count = lane.w.i[core.OUT]
        out = lane._rows("out", count)
        t[row, :count], modes[row, :count], values[row, :count] = out[:, 0], out[:, 1].astype(int), out[:, 3:]
    works = [lane.work(0.0) for lane, _ in done]
    total = Work(*(sum(getattr(x, f) for x in works) for f in ("steps", "rejected", "evaluations", "guard_evaluations", "events")), seconds, works[0].method, works[0].backend)
    return Runs(system, [lane.p for lane, _ in done], t, modes, values, np.array([x.events for x in works]), [lane.reason(status) for lane, status in done], total)
