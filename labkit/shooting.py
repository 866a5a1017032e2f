"""Newton's method on the map of one period, its derivative, and linear maps column by column.

`periodic` and `monodromy` of cycles.py say what it is for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .arguments import asked
from .model import Function, ModelError, System, listed, number
from .run import Ended, Run
from .solve import simulate, simulate_many

__all__ = ["Cycle", "Monodromy", "linear", "near"]

SHARES = (1e-4, 1e-5, 1e-6)  # steps of the differences, of the size of a state on the cycle
LINEAR = 1e-8  # how far a map may be from an affine one to be called linear
TURNS = 40  # the most steps of Newton's method
GOAL = 1e-9  # how well a cycle closes, and its last step of Newton's, of the size of its states
REST = 1e-4  # of the size at the start: what is smaller has come to rest
STILL = 1e-7  # of the size of a state: what moves less in a period does not move


@dataclass(frozen=True, repr=False, eq=False)
class Monodromy:
    """What becomes of small deviations in one period: after it they are matrix @ deviations.

    names        of rows and columns of the matrix: the states, then those held variables that
                 events set from states (samples); one that toggles or counts has no neighbours
    matrix       (n, n) derivative of the state at t0 + period by the state at t0
    error        an estimate of the largest error of its entries
    multipliers  (n,) its eigenvalues, Floquet's multipliers, the largest first
    trivial      whether one of them is the 1 of a shift in time, as for every autonomous system
    stable       whether no other one lies outside the unit circle (by more than 1e-6 and the error)
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    error: float
    period: float
    trivial: bool = False

    @cached_property
    def multipliers(self) -> np.ndarray:
        found = np.linalg.eigvals(self.matrix)
        found = found[np.argsort(-np.abs(found), kind="stable")]
        return found.real if np.all(found.imag == 0) else found

    @property
    def stable(self) -> bool:
        others = self.multipliers
        if self.trivial:
            others = np.delete(others, np.argmin(np.abs(others - 1)))
        return bool(np.all(np.abs(others) <= 1 + max(1e-6, 10 * self.error)))

    def __repr__(self) -> str:
        shown = ", ".join(f"{m:.6g}" for m in self.multipliers)
        word = "stable" if self.stable else "unstable"
        return f"Monodromy over {self.period:.10g}: multipliers {shown}; {word}"


@dataclass(frozen=True, repr=False, eq=False)
class Cycle:
    """A periodic solution: cycle.period, cycle.run (one period), cycle.at(t)["x"] at any time.

    start, mode, t0     from where cycle.run goes round;  miss: by how much it does not close,
                        as a share of the size of its states
    monodromy           its Monodromy; also cycle.matrix, cycle.multipliers, cycle.stable
    """

    period: float
    run: Run
    mode: str
    miss: float
    monodromy: Monodromy

    @property
    def t0(self) -> float:
        return float(self.run.t[0])

    @property
    def start(self) -> dict[str, float]:
        return self.run.start

    @property
    def matrix(self) -> np.ndarray:
        return self.monodromy.matrix

    @property
    def multipliers(self) -> np.ndarray:
        return self.monodromy.multipliers

    @property
    def stable(self) -> bool:
        return self.monodromy.stable

    @asked
    def at(self, t: float | np.ndarray) -> dict[str, float | np.ndarray]:
        """cycle.at(0.3)["x"]: states, outputs and "mode" at any times, as run.at gives them."""
        return self.run.at(self.t0 + np.mod(np.asarray(t, dtype=float) - self.t0, self.period))

    def __repr__(self) -> str:
        word = "stable" if self.stable else "unstable"
        system, count = self.run.system, len(self.run.events)
        period = f"{self.period:.10g} {system.time}"
        return f"Cycle of {system.name!r}: period {period}, {count} events, {word}"


class Flow:
    """Flow(system, t0, "flight", options, p): φ_T, from the state at t0 to that at t0 + T.

    In one mode at both ends; the vector x (n,) is its states, then the held variables.
    moves    places in x of what has neighbours: the states, and the held variables that events set
             from them, which the first derivative finds; the others keep their values
    """

    def __init__(self, system: System, t0: float, mode: str, options: dict, p: Mapping[str, float]):
        self.system, self.t0, self.mode = system, t0, mode
        self.options, self.p = options, p
        self.names = (*system.states_of(mode), *system.held)
        self.count = len(system.states_of(mode))
        self.moves = list(range(self.count))
        self.values = system.values(p)

    def slope(self, t: float, x: np.ndarray) -> np.ndarray:
        """dx/dt, of held variables 0."""
        mode, kind = self.system.modes[self.mode], self.system.S[self.mode]
        slope = mode.flow(t, kind(*x.tolist()), self.values)
        return np.append(np.array(slope, dtype=float), np.zeros(len(x) - self.count))

    @property
    def moving(self) -> tuple[str, ...]:
        return tuple(self.names[k] for k in self.moves)

    def made(self, make: Callable, x: np.ndarray, T: float, **more: Any) -> Any:
        """By simulate a run from x (n,), by simulate_many some from x (n, k)."""
        start = dict(zip(self.names, x.tolist() if x.ndim == 1 else list(x), strict=True))
        how = {"t0": self.t0, "start": start, "mode": self.mode, **self.options, **more}
        return make(self.system, self.t0 + T, **how, **self.p)

    def run(self, x: np.ndarray, T: float) -> Run:
        return self.made(simulate, x, T)

    def end(self, run: Run) -> np.ndarray:
        """The state at the end; ModelError if the run did not come there in its first mode."""
        if run.ended is not Ended.FINISHED:
            raise ModelError(f"a run of one period ended early: {run.stopped}")
        if run.mode[-1] != self.mode:
            raise ModelError(
                f"after one period, from t = {self.t0:g}, the mode is {run.mode[-1]!r} and not "
                f"{self.mode!r} as at its start"
            )
        return np.array([run.final[name] for name in self.names])

    def ends(self, x: np.ndarray, T: float) -> tuple[np.ndarray, list[list]]:
        """The ends (k, n) of starts (k, n), and which events each run had."""
        runs = list(self.made(simulate_many, x.T, T, points=2))  # each is made once
        events = [[(e.transition, e.target) for e in run.events] for run in runs]
        return np.array([self.end(run) for run in runs]), events

    def joined(self, ends: np.ndarray) -> bool:
        """Whether neighbours (k, n) end with different values of a held variable: it moves, too."""
        more = [k for k in np.flatnonzero(np.ptp(ends, axis=0)) if k not in self.moves]
        self.moves = sorted(self.moves + more)
        return bool(more)

    def derivative(self, x: np.ndarray, T: float, size: np.ndarray) -> tuple[np.ndarray, float]:
        """Dφ by central differences with two steps and Richardson's extrapolation; its error."""
        why = ""
        for share in SHARES:
            places, n = self.moves, len(self.moves)
            shift = np.diag(share * size)[places]
            starts = np.vstack([x[None], x + shift, x - shift, x + 2 * shift, x - 2 * shift])
            try:
                ends, events = self.ends(starts, T)
            except ModelError as error:
                why = str(error)
                continue
            if any(each != events[0] for each in events[1:]):
                why = "neighbours of the cycle have other events than it has (a touch of a guard?)"
                continue
            if self.joined(ends):
                return self.derivative(x, T, size)
            up, down, up_two, down_two = ends[1:, places].reshape(4, n, n)
            one = (up - down) / (2 * share * size[places])[:, None]
            two = (up_two - down_two) / (4 * share * size[places])[:, None]
            noise = float(self.options["rtol"]) * 10 / share
            return ((4 * one - two) / 3).T, float(np.abs(one - two).max() / 3 + noise)
        raise ModelError(f"the map has no derivative there: {why}")


def near(begun: Run, g: Function | None, t0: float, period: float, options: dict) -> Cycle:
    """near(run, g, t0, period, options) -> the cycle near one period of a run from t0 on.

    g is the section, or None where the period is known. Where neighbours cannot start, on a guard,
    it begins in the middle of the longest flight, and the section is the plane across the flow.
    """
    system, p = begun.system, begun.p._asdict()

    def flow_at(when: float) -> tuple[Flow, np.ndarray]:
        at: dict[str, Any] = begun.at(when)
        flow = Flow(system, when, at["mode"], options, p)
        return flow, np.array([at[name] for name in flow.names])

    times = np.array([event.t for event in begun.events])
    try:
        if g is not None and np.any(np.abs(times - t0) <= GOAL * period):
            raise _Elsewhere("the section is a guard")
        flow, x = flow_at(t0)
        kind = system.S[flow.mode]
        beside = g and (lambda x: number(g(t0, kind(*x.tolist()), begun.p), "the section"))
        return _newton(flow, beside, x, period)
    except _Elsewhere:
        inside = times[(times > t0) & (times < t0 + period)]
        ends = np.array([t0, *inside, t0 + period])
        k = int(np.argmax(np.diff(ends)))
        flow, x = flow_at(float(ends[k] + ends[k + 1]) / 2)
        across = flow.slope(flow.t0, x)
        return _newton(flow, g and (lambda y: float(across @ (y - x))), x, period)


class _Elsewhere(ModelError):
    """Neighbours cannot start here."""


def _newton(flow: Flow, beside: Callable | None, x: np.ndarray, T: float) -> Cycle:
    """The cycle from a start and a period near it; beside(x), if given, is 0 on the section."""

    def gap(x: np.ndarray, T: float) -> tuple[Run, np.ndarray]:
        run = flow.run(x, T)
        return run, flow.end(run) - x

    run, miss = gap(x, T)
    first, worst = _sizes(run, flow), np.inf
    for _ in range(TURNS):
        size = np.clip(_sizes(run, flow), REST * first, first / REST)
        try:
            M, error = flow.derivative(x, T, size)
        except ModelError as why:
            raise _Elsewhere(str(why)) from None
        moves, n = flow.moves, len(flow.moves)
        if left := [flow.names[k] for k in np.flatnonzero(miss) if k not in moves]:
            raise ModelError(
                f"what events do to the held variable(s) {listed(left)} does not return after one "
                f"period of {T:.6g} {flow.system.time}: from {_words(run.start, left)} to "
                f"{_words(run.final, left)}. Take a multiple of the period, or a variant without"
            )
        worst = float(np.abs(miss / size)[moves].max())
        A, b = M - np.eye(n), -miss[moves]
        if beside is not None:
            steps = np.diag(1e-6 * size)[moves]
            normal = [(beside(x + h) - beside(x - h)) / (2 * h.max()) for h in steps]
            slope = flow.slope(flow.t0 + T, x + miss)[moves]
            A = np.block([[A, slope[:, None]], [np.array([*normal, 0.0])]])
            b = np.append(b, -beside(x))
        scale = np.append(size[moves], T)[: len(b)]
        step = np.linalg.lstsq(A * scale, b, rcond=1e-11)[0]
        last = np.abs(step).max() <= GOAL
        for share in 0.5 ** np.arange(1 if last else 12):
            x_new, T_new = x.copy(), T
            x_new[moves] += (share * scale * step)[:n]
            T_new += share * T * step[-1] if beside else 0.0
            try:
                run_new, miss_new = gap(x_new, T_new) if T_new > 0 else (run, miss)
            except ModelError:
                continue
            if (found := np.abs(miss_new / size)[moves].max()) < worst:
                x, T, run, miss, worst = x_new, T_new, run_new, miss_new, float(found)
                break
        else:
            break
        if last:
            break
    if worst > max(GOAL, 1e3 * float(flow.options["rtol"])):
        raise ModelError(
            f"no cycle was found: Newton's method stops where one period (of {T:.6g} "
            f"{flow.system.time}) misses its start by {worst:.1e} of the size of the states. "
            "Start nearer to the cycle, or let it settle=… longer if it is stable; a system that "
            "the clock does not drive needs a section instead of a period"
        )
    sizes = _sizes(run, flow)
    widths = np.array([np.ptp(run[name]) for name in flow.names])
    still = np.all(widths <= STILL * np.maximum(sizes, REST * first))
    if still or (beside and np.all((sizes <= REST * first)[moves])):
        said = _words(run.final, flow.names)
        raise ModelError(f"what was found is at rest, not a cycle: {said}")
    if beside is not None:
        again = flow.run(x, 2 * T)
        if again.ended is not Ended.FINISHED or np.abs((flow.end(again) - x) / size).max() > 1e-5:
            raise ModelError(
                "the state returns once but not again: the clock drives this system, so give its "
                "period instead of a section"
            )
    slope, size = flow.slope(flow.t0 + T, x + miss)[moves], size[moves]
    turned, along = np.linalg.norm((M @ slope - slope) / size), np.linalg.norm(slope / size)
    trivial = bool(along > 0 and turned <= 1e-4 * along)
    made = Monodromy(flow.moving, M, error, float(T), trivial)
    return Cycle(float(T), run, flow.mode, worst, made)


def _sizes(run: Run, flow: Flow) -> np.ndarray:
    """How large each state becomes; of one that stays zero, the largest of them."""
    found = [np.nanmax(np.abs(run[name])) for name in flow.names]
    return np.array([size or max(found[: flow.count]) or 1.0 for size in found])


def _words(values: Mapping[str, float], names: Iterable[str]) -> str:
    return ", ".join(f"{name} = {values[name]:.6g}" for name in names)


def linear(
    system: System, T: float, begin: dict, options: dict, p: Mapping[str, float]
) -> Monodromy | None:
    """Of a system whose map is affine in a box ten times as large as its run; else None.

    begin: its start, mode and t0.
    """
    t0 = begin["t0"]
    try:
        run = simulate(system, t0 + T, **begin, **options, **p)
        flow = Flow(system, t0, str(run.mode[0]), options, p)
        size = np.array([10 * np.nanmax(np.abs(run[name])) or 1.0 for name in flow.names])
        x = np.array([run.start[name] for name in flow.names])
        while True:
            moves, n = flow.moves, len(flow.moves)
            x[moves] = 0.0
            units, mixed = np.diag(size[moves]), size[moves] * np.cos(1.0 + np.arange(n))
            starts = np.tile(x, (2 * n + 2, 1))
            starts[1:, moves] = np.vstack([units, -units, mixed])
            ends, _ = flow.ends(starts, T)
            if not flow.joined(ends):
                break
    except ModelError:
        return None
    kept = [k for k in range(len(x)) if k not in moves]
    if np.any(ends[:, kept] != x[kept]):
        return None  # periodic says what does not return
    ends, size = ends[:, moves], size[moves]
    rest, up, down, last = ends[0], ends[1 : n + 1], ends[n + 1 : 2 * n + 1], ends[-1]
    M = ((up - down) / (2 * size[:, None])).T
    bent = np.abs(up + down - 2 * rest)
    largest = np.abs(ends).max(axis=0) + 1e-300
    far = np.vstack([bent, np.abs(last - rest - M @ mixed)]) / largest
    if not np.isfinite(ends).all() or far.max() > LINEAR:
        return None
    error = float(bent.max() / size.min()) + float(options["rtol"])
    return Monodromy(flow.moving, M, error, float(T))
