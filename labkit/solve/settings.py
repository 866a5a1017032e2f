"""What runs with the same options share: method tables and structure of the modes, for the core."""

from __future__ import annotations

from collections.abc import Mapping
from types import FunctionType

import numpy as np

from ..model import At, Every, Transition
from . import core
from .kinks import kinks
from .methods import DEGREE, FIXED_STEP, explicit, proxy
from .options import Options

__all__ = ["Settings"]

SCALE_FREE = -1.0  # in `absolute`: the tolerance follows from the state's own size


def _told(at: object) -> object:
    """What makes a schedule equal to another: functions are, if their text and what it stands for
    are, so that a formula written out twice is one clock.
    """
    if isinstance(at, Every):
        return Every, _told(at.period), _told(at.first)
    if isinstance(at, At):
        return At, *map(_told, at.instants)
    if not isinstance(at, FunctionType):
        return at
    code, held = at.__code__, [*(at.__defaults__ or ()), *(at.__kwdefaults__ or {}).values()]
    for cell in at.__closure__ or ():
        try:
            held.append(cell.cell_contents)
        except ValueError:  # a name not given yet
            held.append(cell)
    held = [each if isinstance(each, int | float | str) else id(each) for each in held]
    return code.co_code, code.co_consts, code.co_names, held, id(at.__globals__)


class Settings:
    """Settings(options): made once for many runs, and never changed.

    width, length   most states of any mode; these and the held variables: a state's vector
    places          mode -> where its states and the held variables stand in it: an index
    timed           whether there are dead times or schedules
    absolute        (modes, width) the part of a tolerance that does not grow with the state, or −1
    fixed, sizes    fields of the workspace that are the same for every run; what the others' sizes
                    follow from
    """

    def __init__(self, options: Options):
        system = options.system
        self.options, self.system, self.method = options, system, options.method
        span = options.t_end - options.t0
        self.step = span / 1000 if options.step is None else options.step
        self.max_step = float("inf") if options.max_step is None else options.max_step
        self.external = self.method in DEGREE
        self.table = explicit("RK45") if self.external else explicit(self.method)
        self.degree = DEGREE[self.method] if self.external else self.table.Q.shape[0]
        self.proxy = min(max(self.degree + 1, 4), 8)
        self.modes = list(system.modes)
        self.place = {mode: index for index, mode in enumerate(self.modes)}
        self.width, self.length = system.width, system.width + len(system.held)
        self.places = {mode: _run_of([*system.places(mode).values()]) for mode in self.modes}
        self.plans = [tr for tr in system.transitions if tr.at is not None]
        self.timed = bool(self.plans) or any(tr.delay != 0 for tr in system.transitions)
        self.absolute = self._absolute()
        self.rtol = options.rtol
        self.fixed = self._fixed()

    def _absolute(self) -> np.ndarray:
        atol = self.options.atol
        found = np.full((len(self.modes), self.width), SCALE_FREE)
        for row, mode in zip(found, self.modes, strict=True):
            for place, name in enumerate(self.system.states_of(mode)):
                given = atol.get(name) if isinstance(atol, Mapping) else atol
                row[place] = SCALE_FREE if given is None else given
        return found

    def _acts(self, tr: Transition) -> bool:
        """May the reset change a state, not held variables alone?"""
        names = tr.reset if isinstance(tr.reset, Mapping) else self.system.units
        return tr.reset is not None and not {*names} <= {*self.system.held}

    def _kinds(self) -> np.ndarray:
        """(modes, width): states of one unit have one number, each without a unit has its own."""
        units = self.system.units
        kinds = [*dict.fromkeys(unit or (name,) for name, unit in units.items())]
        found = np.zeros((len(self.modes), self.width), dtype=int)
        for row, mode in zip(found, self.modes, strict=True):
            for place, name in enumerate(self.system.states_of(mode)):
                row[place] = kinds.index(units[name] or (name,))
        return found

    def _kinks(self) -> np.ndarray:
        """Times at which tables of the time bend.

        Looked for at the model's own start and parameters.
        """
        system, options = self.system, self.options
        states = {
            mode: system.S[mode](*(system.start.get(name, 1.0) for name in system.S[mode]._fields))
            for mode in self.modes
        }
        return kinks(system, system.values(), options.t0, options.t_end, states)

    def _fixed(self) -> dict[str, np.ndarray]:
        """The fields of the workspace that are the same for every run.

        How it begins, the method's table, the structure of the modes.
        """
        options, system, table = self.options, self.system, self.table
        trs, modes = system.transitions, self.modes
        leave = [[i for i in system.leaving[m] if trs[i].guard is not None] for m in modes]
        order = sorted(range(len(trs)), key=lambda i: (-trs[i].priority, i))
        urgent = {None: core.REFUSE, False: core.NO, True: core.YES}
        instants = [len(tr.at.instants) if isinstance(tr.at, At) else 0 for tr in self.plans]
        clocks = [_told(tr.at) for tr in self.plans]
        bends = self._kinks()
        i0, f0 = np.zeros(core.INTEGERS, dtype=np.int64), np.zeros(core.FLOATS)
        for place, value in {
            core.FRESH: 1,
            core.ENTRY: 1,
            core.BUSY: 1,
            core.STAGES: table.stages,
            core.DEGREE: self.degree,
            core.PROXY: self.proxy,
            core.ADAPTIVE: 2 if self.external else 0 if self.method in FIXED_STEP else 1,
            core.TWO: self.method == "DOP853",
            core.LOCATE: options.locate,
            core.DENSE: options.dense,
            core.TRANSITIONS: len(trs),
            core.MAX_EVENTS: options.max_events,
            core.MAX_STEPS: options.max_steps,
            core.ORDER: table.order,
            core.ROWS: len(table.A),
            core.WIDTH: self.width,
            core.HELD: self.length - self.width,
            core.MODES: len(modes),
            core.PARAMETERS: len(system.parameters) + 1,  # behind them: see source.py
            core.SAMPLES: len(options.grid),
            core.KINKS: len(bends),
            core.SCHEDULES: len(self.plans),
            core.POWERS: not table.Q.any(),
            core.UNSEEN: max(
                (s + 1 for s in range(table.stages) if not table.E[:, s].any()), default=0
            ),
            core.OWN_SIZE: (self.absolute < 0).any(),
        }.items():
            i0[place] = value
        for place, value in {
            core.T: options.t0,
            core.H: self.step if self.method in FIXED_STEP else 0.0,
            core.T_END: options.t_end,
            core.RTOL: options.rtol,
            core.MAX_STEP: self.max_step,
            core.T0: options.t0,
            core.EVENT_T: -1e300,
            core.CAP: 1e300,
            core.BEFORE: options.t0,
            core.UNTIL: options.t0 + core.TICKS * core.EPS * abs(options.t0),
        }.items():
            f0[place] = value
        states = [system.states_of(m) for m in modes]
        fixed = {
            "i0": i0,
            "f0": f0,
            "c": table.C,
            "grid": options.grid,
            "kink": bends,
            "size": [len(names) for names in states],
            "family": [states.index(names) for names in states],
            "leave_from": np.cumsum([0, *map(len, leave)]),
            "leave": sum(leave, []),
            "source": np.array([[m in tr.sources for m in modes] for tr in trs]).reshape(
                len(trs), len(modes)
            ),
            "target": [-1 if tr.target is None else self.place[tr.target] for tr in trs],
            "zeno": [-1 if tr.zeno is None else self.place[tr.zeno] for tr in trs],
            "directed": [tr.direction != 0 for tr in trs],
            "acts": [self._acts(tr) for tr in trs],
            "urgent": [urgent[tr.urgent] for tr in trs],
            "rank": np.argsort(order),
            "tolerance": [tr.tolerance for tr in trs],
            "plan": [system.transitions.index(tr) for tr in self.plans],
            "plan_from": np.cumsum([0, *instants]),
            "clock": [clocks.index(clock) for clock in clocks],
            "absolute": self.absolute,
            "kind": self._kinds(),
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
            "width": self.width,
            "held": self.length - self.width,
            "modes": len(modes),
            "transitions": len(trs),
            "guards": len(fixed["leave"]),
            "rows": len(table.A),
            "degree": self.degree,
            "proxy": self.proxy,
            "instants": sum(instants),
            "schedules": len(self.plans),
            "grid": len(options.grid),
            "kinks": len(bends),
            "kinds": 1 + int(fixed["kind"].max(initial=0)),
            **{name: len(fixed[f"{name}_value"]) for name in "aewq"},
        }
        kinds = {name: kind for name, kind, _ in core.FIELDS}
        return {
            name: np.ascontiguousarray(value, dtype=float if kinds[name] == "f" else np.int64)
            for name, value in fixed.items()
        }


def _run_of(places: list[int]) -> slice | list[int]:
    """Places as a slice where they are the first ones: assigned to in a third of the time."""
    return slice(len(places)) if places == [*range(len(places))] else places
