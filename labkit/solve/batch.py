"""A batch of runs of one model: their memory, what they begin with, and what becomes of them.

batch = Batch(settings, code, lanes); batch.load(p, start, modes); batch.run(); batch.as_run(p, began)
"""

from __future__ import annotations

from time import perf_counter
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from ..model import Every, ModelError, listed
from ..run import Event, Events, Run, Runs, Touch, Work
from . import core
from .backend import addresses
from .check import trouble
from .lanes import sweep
from .layout import workspace
from .methods import FIXED_STEP
from .plain import Plain, orientations
from .scipy_step import SciPyStep

if TYPE_CHECKING:
    from . import Settings

OUTPUTS = ("out", "ledger", "pieces")  # the fields that grow, in the order of w.room


class Batch:
    """Runs under way, one after the other: their workspace, and what is needed to turn it into results."""

    def __init__(self, settings: Settings, code: object, lanes: int):
        self.settings, self.code, self.lanes = settings, code, lanes
        self.sizes = {
            **settings.sizes,
            "lanes": lanes,
            "ledger": 64,
            "pieces": 256 if settings.dense else 1,
        }
        self.sizes["out"] = lanes * (len(settings.grid) + 8) + 200
        made, plain = [], code is None
        for name, kind, shape in self._fields():
            if plain and name in OUTPUTS:  # rows are added as they are needed
                made.append(_Rows(shape[1]))
            elif name in settings.fixed:
                made.append(settings.fixed[name].tolist() if plain else settings.fixed[name])
            else:
                array = (np.empty if name == "out" else np.zeros)(
                    shape, dtype=float if kind == "f" else np.int64
                )
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
                    raise ModelError(
                        f"the delay of {tr.name!r} is {delay.min():g}: a dead time cannot be negative"
                    )
                self._put("delay", i, delay)
        for k, tr in enumerate(st.plans):
            self._load_schedule(k, tr)
        w.i[core.LANE] = w.i[core.BEGUN] = w.i[core.OUT] = 0
        w.i[core.LANES] = self.lanes

    def _load_schedule(self, k: int, tr) -> None:
        """Of a scheduled transition: instants t0 + first + m·period for m = 0 or 1, 2, …; or a list of instants, none before t0."""
        if isinstance(tr.at, Every):
            period = self._resolve(tr.at.period, f"the period of {tr.name!r}")
            first = self._resolve(
                0.0 if tr.at.first is None else tr.at.first, f"the first instant of {tr.name!r}"
            )
            if period.min() <= 0 or first.min() < 0:
                raise ModelError(
                    f"the schedule of {tr.name!r} has period {period.min():g} and first instant {first.min():g}: a period must be positive, an instant not negative"
                )
            self._put("plan_first", k, first)
            self._put("plan_period", k, period)
            self._put("plan_next0", k, np.full(self.lanes, int(tr.at.first is None)))
        elif tr.at.instants:
            found = np.sort(
                [self._resolve(x, f"an instant of {tr.name!r}") for x in tr.at.instants], axis=0
            )
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
        while not (
            status == core.FINISHED
            or (status not in (core.PAUSE, core.GROW) and w.i[core.LANE] == self.lanes)
        ):
            if self.code is None:
                status = sweep(self.model, w, self.p_lanes, 10_000)
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
                self.settings.check_start(
                    start, mode, self.settings.system.P(*self.p[lane].tolist())
                )
                raise ModelError(
                    f"the flow of mode {mode!r} or a guard there is not a number at the start {start}, t = {self.settings.t0:g}"
                )
            elif status not in (core.PAUSE, core.FINISHED):
                self.reasons[w.i[core.LANE] - 1] = self._reason(status)

    def _grow(self) -> None:
        """More room for events, pieces or samples, whichever is short; what is there stays."""
        w = self.w
        for name, used in (
            ("ledger", w.i[core.LEDGER] + 2),
            ("pieces", w.i[core.PIECES] + 1),
            ("out", w.i[core.OUT] + len(self.settings.grid) + 4),
        ):
            if used > self.sizes[name]:
                self.sizes[name] = max(
                    4 * self.sizes[name] if name != "out" else 2 * self.sizes[name], used
                )
        replaced = {}
        for name, _, shape in self._fields():
            if (
                name in OUTPUTS
                and self.code is not None
                and len(old := getattr(w, name)) < shape[0]
            ):
                replaced[name] = np.empty(shape)
                replaced[name][: len(old)] = old
        self.w, self.table = w._replace(**replaced), None
        self.w.room[:] = [self.sizes[name] for name in OUTPUTS]

    def reason(self, lane: int) -> str:
        if lane in self.reasons:
            return self.reasons[lane]
        status, last = self.w.done[lane][core.STATUS], self.w.done[lane][core.LAST]
        return (
            "finished"
            if status == core.FINISHED
            else f'terminal event "{self.settings.system.transitions[last].name}"'
        )

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
            mode = self.settings.modes[w.i[core.MODE]]
            why = trouble(system, mode, float(w.f[core.T]), self.state(mode), self.parameters())
            text = f'not a number: the guard of "{name}" at {t}'
            return f"{text} ({why})" if why else text
        return self._why_no_step(t)

    def _why_no_step(self, t: str) -> str:
        """The step shrank to nothing (or a fixed step overflowed): a flow that is no number, a state out of hand, or a singular or stiff system."""
        system, mode = self.settings.system, self.settings.modes[self.w.i[core.MODE]]
        names = system.states_of(mode)
        y = [float(v) for v in list(self.w.y)[: len(names)]]
        why = trouble(system, mode, float(self.w.f[core.T]), self.state(mode), self.parameters())
        # The last attempt's stages are still there: one that is no number tells more than the tiny step
        stages = np.array([] if self.settings.external else list(self.w.k), dtype=float).reshape(
            -1, self.settings.width
        )[: self.settings.table.stages + 1]
        if bad := [n for k, n in enumerate(names) if not np.all(np.isfinite(stages[:, k]))]:
            text = f"not a number: the flow of mode {mode!r} gives no finite value for {listed(bad)} near {t}"
            return f"{text} ({why})" if why else text
        if why:
            return f"not a number: {why}"
        biggest = max(range(len(names)), key=lambda k: abs(y[k]))
        if abs(y[biggest]) > 1e8 or self.settings.method in FIXED_STEP:
            return f"diverged: |{names[biggest]}| = {abs(y[biggest]):.3g} at {t}"
        return f"no step is short enough at {t} in mode {mode!r}: the flow is singular there, or stiff (try method='Radau')"

    def state(self, mode: str) -> list[float]:
        """The state of the lane under way, in the order of S[mode]."""
        y = list(self.w.y)
        return [
            float(y[place])
            for place in self.settings.system.places(mode).values()
            if place < len(y)
        ]

    def parameters(self) -> tuple:
        """Those of the lane that has just ended."""
        return self.settings.system.P(*self.p[self.w.i[core.LANE] - 1].tolist())

    def rows(self, name: str, count: int) -> np.ndarray:
        """The first rows of an output; compiled, they lie in memory that the next run writes to."""
        rows = getattr(self.w, name)
        if self.code is not None:
            return rows[:count]
        return np.array(rows.rows[:count], dtype=float).reshape(count, rows.width)

    def as_run(self, p: tuple, began: float) -> Run:
        st, i = self.settings, self.w.i
        out, ledger, pieces = (
            self.rows(name, i[count]).copy()
            for name, count in (("out", core.OUT), ("ledger", core.LEDGER), ("pieces", core.PIECES))
        )
        touches = np.array(self.w.touch)[: i[core.TOUCHES]].tolist()
        work = Work(
            int(i[core.STEPS]),
            int(i[core.REJECTED]),
            int(i[core.FLOWS]),
            int(i[core.GUARDS]),
            len(ledger),
            perf_counter() - began,
            st.method,
            "plain" if self.code is None else "compiled",
        )
        return Run(
            st.system,
            p,
            out[:, 0].copy(),
            out[:, 2].astype(int),
            out[:, 1].astype(int),
            out[:, 3:],
            Events(len(ledger), lambda: _events(st, ledger)),
            self.reason(0),
            work,
            pieces,
            [Touch(t, st.system.transitions[int(who)].name, by) for t, who, by in touches],
        )


class _Rows:
    """A list of rows for the plain back end that makes a row when it is first touched."""

    def __init__(self, width: int):
        self.width, self.rows = width, []

    def __getitem__(self, index: int) -> list[float]:
        while len(self.rows) <= index:
            self.rows.append([0.0] * self.width)
        return self.rows[index]


def _events(settings: Settings, ledger: np.ndarray) -> list[Event]:
    """The ledger's rows as events."""
    system, modes, width, events = settings.system, settings.modes, settings.width, []
    for line in ledger.tolist():
        tr = system.transitions[int(line[1])]
        source, target = (
            "sliding" if m == core.SLIDE else None if m < 0 else modes[int(m)] for m in line[3:5]
        )
        one, other = (m if m in system.modes else tr.sources[0] for m in (source, target or source))
        before = dict(zip(system.states_of(one), line[5:], strict=False))
        after = dict(zip(system.states_of(other), line[5 + width :], strict=False))
        name = f"{tr.name} (sliding)" if "sliding" in (source, target) else tr.name
        events.append(Event(line[0], name, source, target, before, after, int(line[1])))
    return events


def gather(settings: Settings, p: np.ndarray, batches: list[Batch], began: float) -> Runs:
    """The samples of all lanes, which stand one after the other, as rectangular arrays."""
    system = settings.system
    done = np.concatenate([np.array(batch.w.done) for batch in batches])
    out = np.concatenate([batch.rows("out", batch.w.i[core.OUT]) for batch in batches])
    counts = np.concatenate(
        [np.diff([0, *np.array(batch.w.done)[:, core.END]]) for batch in batches]
    )
    shape = len(counts), int(counts.max())
    if len(out) == shape[0] * shape[1]:  # no lane had an event, or all had as many
        out = out.reshape(*shape, -1)
        t, modes, values = out[..., 0].copy(), out[..., 1].astype(int), out[..., 3:]
    else:
        lane, starts = np.repeat(np.arange(len(counts)), counts), np.cumsum(counts) - counts
        place = np.arange(len(out)) - np.repeat(starts, counts)
        t, modes, values = (
            np.full(shape, np.nan),
            np.full(shape, -1),
            np.full((*shape, settings.width), np.nan),
        )
        t[lane, place], modes[lane, place], values[lane, place] = out[:, 0], out[:, 1], out[:, 3:]
    total = done.sum(axis=0).tolist()
    work = Work(
        *(total[k] for k in (core.ACCEPTED, core.FAILED, core.RATES, core.LOOKS, core.EVENTS)),
        perf_counter() - began,
        settings.method,
        "plain" if batches[0].code is None else "compiled",
    )
    reasons = [batch.reason(lane) for batch in batches for lane in range(batch.lanes)]
    return Runs(
        system,
        [system.P(*values) for values in p.tolist()],
        t,
        modes,
        values,
        done[:, core.EVENTS].copy(),
        reasons,
        work,
    )
