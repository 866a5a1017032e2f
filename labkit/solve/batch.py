"""A batch of runs of one model: their memory, what they begin with, and what becomes of them.

batch = Batch(settings, code, lanes); batch.load(p, start, modes, clocks); batch.run()
samples(batch.out), batch.endings, batch.ledger(), …     the results
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from threading import Event as Flag
from types import SimpleNamespace

import numpy as np

from ..model import ModelError
from ..run import Ended, Touch
from ..runs import Samples
from . import core
from .backend import addresses
from .endings import ending
from .lanes import sweep
from .layout import workspace
from .plain import Plain, orientations
from .scipy_step import SciPyStep
from .settings import Settings
from .starts import check_start

__all__ = ["Batch", "samples"]

OUTPUTS = ("out", "ledger", "pieces")  # the fields that grow, in the order of w.room
# Steps between two looks at the keyboard: some milliseconds when compiled, with a slow flow up to
# half a second; to come back into Python costs a few microseconds
PORTION = 20_000


class Batch:
    """Batch(settings, code, lanes): runs under way, one after the other, in one workspace.

    settings, code   what all have in common; code is None for the plain back end
    endings          of each lane, an Ended and a sentence
    touches, notes   of the lanes that have some
    """

    def __init__(self, settings: Settings, code: object, lanes: int):
        self.settings, self.code, self.lanes = settings, code, lanes
        # behind a lane's parameters compiled code says what it cannot reckon with
        self.p = np.zeros((lanes, len(settings.system.parameters) + 1))
        self._allocate()

    def _allocate(self) -> None:
        lanes, settings = self.lanes, self.settings
        self.sizes = {
            **settings.sizes,
            "lanes": lanes,
            "ledger": 64,
            "pieces": 256 if settings.options.dense else 1,
        }
        self.sizes["out"] = lanes * (len(settings.options.grid) + 8) + 200
        made, plain = [], self.code is None
        for name, kind, shape in self._fields():
            if plain and name in OUTPUTS:  # rows are added as they are needed
                made.append(_Rows(shape[1]))
                continue
            array = settings.fixed.get(name)
            if array is None:
                make = np.empty if name == "out" else np.zeros
                array = make(shape, dtype=float if kind == "f" else np.int64)
            made.append(array.tolist() if plain else array)
        self.w = core.Workspace(*made)
        self.w.room[:] = [self.sizes[name] for name in OUTPUTS]
        self.table: np.ndarray | None = None

    def _fields(self) -> tuple:
        return workspace(SimpleNamespace(**self.sizes))

    def load(
        self, p: np.ndarray, start: np.ndarray, modes: np.ndarray, clocks: Mapping[str, np.ndarray]
    ) -> None:
        """What the lanes begin with: p (lanes, parameters), start (lanes, length of a state),
        modes (lanes,) by place, clocks: further fields (lanes, …)."""
        w, st, plain = self.w, self.settings, self.code is None
        self.p[:, :-1], self.p[:, -1] = p, 0.0
        self._loaded = p, start, modes, clocks
        if plain:
            self.model = Plain(st.system, orientations(st.system))
            if st.external:
                self.model.stepper = SciPyStep(st, self.model, st.width)
            self.p_lanes = [*map(self._values, range(self.lanes))]
        for name, values in {"y0": start, "mode0": modes, **clocks}.items():
            getattr(w, name)[:] = values.tolist() if plain else values
        w.i[core.LANE] = w.i[core.BEGUN] = w.i[core.OUT] = 0

    @property
    def nbytes(self) -> int:
        """Of the samples that there is room for."""
        return 8 * len(self.w.out) * (5 + self.settings.length)

    def run(self, stop: Flag | None = None) -> None:
        """batch.run(): all lanes, one after the other; returns early when `stop` is set."""
        self.endings: list[tuple[Ended, str]] = []
        self.touches: dict[int, list[Touch]] = {}
        self.notes: dict[int, list[str]] = {}
        self._ledger: list[np.ndarray] = []
        for lane in range(self.lanes):
            self.w.i[core.LANES] = lane + 1  # so that the core comes back after each
            status = core.PAUSE
            while status in (core.PAUSE, core.GROW):
                if stop is not None and stop.is_set():
                    return
                status = self._advance()
                if status == core.GROW:
                    self._grow()
            if place := int(self.p[lane, -1]):  # whole numbers that compiled code cannot hold
                why = f"{self.settings.system.name!r} runs in plain Python, because "
                warnings.warn(why + self.code.places[place - 1], stacklevel=2)
                self.code = None
                self._allocate()
                self.load(*self._loaded)
                return self.run(stop)
            self._keep(lane)

    def _advance(self) -> int:
        """A portion of the lane under way."""
        if self.code is None:
            return sweep(self.model, self.w, self.p_lanes, PORTION)
        if self.table is None:
            self.table = addresses(self.code.model, self.p, PORTION, self.w)
            self.address = self.table.ctypes.data
        return self.code.run(self.address)

    def _values(self, lane: int) -> tuple:
        return self.settings.system.P(*self.p[lane, :-1].tolist())

    def _keep(self, lane: int) -> None:
        """What the next lane would overwrite."""
        w, st = self.w, self.settings
        done = w.done[lane] if self.code is None else w.done[lane].tolist()
        status = done[core.STATUS]
        if status == core.BAD_START:
            self.endings.append((Ended.REFUSED, self._refused(lane)))
        elif status == core.FINISHED:
            self.endings.append(_FINISHED)
        else:
            p = self._values(lane)
            self.endings.append(ending(status, st, w, p))
        if count := done[core.EVENTS]:
            self._ledger.append(self._rows("ledger", count, copy=True))
        if count := w.i[core.TOUCHES]:
            self.touches[lane] = [
                Touch(float(t), st.system.transitions[int(who)].name, float(by))
                for t, who, by in w.touch[:count]
            ]
        if done[core.JUMPED] and status != core.HIDDEN_JUMP:  # then its ending says it
            self.notes[lane] = self._notes()

    def _notes(self) -> list[str]:
        """Of the lane that has just ended: sentences about what was done but should be known."""
        w = self.w
        places = w.i[core.JUMPS]
        more = f" and at {places - 1} more places" if places > 1 else ""
        return [
            f"the flow seems to jump near t = {w.f[core.JUMP_T]:.6g}{more}: steps got shorter and "
            "shorter there. Make the jump an event (a Transition with a guard, or at=), then "
            "nothing of it is missed"
        ]

    def _refused(self, lane: int) -> str:
        mode = int(self.w.mode0[lane])
        try:
            p = self._values(lane)
            check_start(self.settings, self.w.y0[lane], mode, p)
        except ModelError as error:
            return str(error)
        return (
            f"the flow of mode {self.settings.modes[mode]!r} or a guard there is not a number at "
            f"the start, t = {self.settings.options.t0:g}"
        )

    def _grow(self) -> None:
        """More room for events, pieces or samples, whichever is short; what is there stays."""
        w = self.w
        for name, used in (
            ("ledger", w.i[core.LEDGER] + 2),
            ("pieces", w.i[core.PIECES] + 2),
            ("out", w.i[core.OUT] + len(self.settings.options.grid) + 4),
        ):
            if used > self.sizes[name]:
                self.sizes[name] = max((2 if name == "out" else 4) * self.sizes[name], used)
        replaced = {}
        for name, _, shape in self._fields() if self.code is not None else ():
            if name in OUTPUTS and len(old := getattr(w, name)) < shape[0]:
                replaced[name] = np.empty(shape)
                replaced[name][: len(old)] = old
        self.w, self.table = w._replace(**replaced), None
        self.w.room[:] = [self.sizes[name] for name in OUTPUTS]

    # -- results --------------------------------------------------------------------------------

    def _rows(self, name: str, count: int, copy: bool = False) -> np.ndarray:
        """The first rows of an output; compiled, they lie in memory that the next run writes to."""
        rows = getattr(self.w, name)
        if self.code is not None:
            return rows[:count].copy() if copy else rows[:count]
        return np.array(rows.rows[:count], dtype=float).reshape(count, rows.width)

    @property
    def out(self) -> np.ndarray:
        """(samples, columns) of all lanes, one after the other, until the next run."""
        return self._rows("out", self.w.i[core.OUT])

    @property
    def done(self) -> np.ndarray:
        """(lanes, …) what the core keeps of a lane, until the next run: see layout.py."""
        return np.asarray(self.w.done)

    def ledger(self) -> np.ndarray:
        """The rows of all lanes' events, one lane after the other; see Events."""
        if len(self._ledger) == 1:
            return self._ledger[0]
        nothing = np.empty((0, 5 + 2 * self.settings.length))
        return np.concatenate([nothing, *self._ledger]) if self._ledger else nothing

    def pieces(self) -> np.ndarray:
        """Of the last lane: see Run.pieces."""
        return self._rows("pieces", self.w.i[core.PIECES], copy=True)


_FINISHED = (Ended.FINISHED, str(Ended.FINISHED))


def samples(*parts: np.ndarray) -> Samples:
    """samples(rows, …) -> rows of t, mode, j, other mode (or −1), its part, state… as Samples.

    In memory of their own, copied once.
    """
    if len(parts) == 1:
        columns = parts[0].T.copy()
    else:
        columns = np.empty((parts[0].shape[1], sum(map(len, parts))))
        np.concatenate(parts, out=columns.T)
    modes, j, other = columns[1:4].astype(int)
    return Samples(columns[0], modes, j, columns[5:].T, other, columns[4])


class _Rows:
    """A list of rows for the plain back end that makes a row when it is first touched."""

    def __init__(self, width: int):
        self.width, self.rows = width, []

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> list[float]:
        while len(self.rows) <= index:
            self.rows.append([0.0] * self.width)
        return self.rows[index]
