"""Newton's method on the map of one period, its derivative, and linear maps column by column.

`periodic` and `monodromy` of cycles.py say what it is for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .model import Function, ModelError, System
from .run import Ended, Run, between
from .solve import simulate, simulate_many

__all__ = ["Cycle", "Monodromy", "linear", "near"]

SHARES = (1e-4, 1e-5, 1e-6)  # steps of the differences, of the size of a state on the cycle
LINEAR = 1e-8  # how far a map may be from an affine one to be called linear
TURNS = 40  # the most steps of Newton's method
GOAL = 1e-9  # how well a cycle closes, of the size of its states
REST = 1e-4  # of the size at the start: what is smaller has come to rest
STILL = 1e-7  # of the size of a state: what moves less in a period does not move


@dataclass(frozen=True, repr=False, eq=False)
class Monodromy:
    """What becomes of small deviations in one period: after it they are matrix @ deviations.

    names        of the states, then the held variables: rows and columns of the matrix
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

    def at(self, t: float | np.ndarray) -> dict[str, float | np.ndarray]:
        """cycle.at(0.3)["x"]: states, outputs and "mode" at any times, as run.at gives them."""
        return self.run.at(self.t0 + np.mod(np.asarray(t, dtype=float) - self.t0, self.period))

    def __repr__(self) -> str:
        word = "stable" if self.stable else "unstable"
        return (
            f"Cycle of {self.run.system.name!r}: period {self.period:.10g} "
            f"{self.run.system.time}, {len(self.run.events)} events, {word}"
        )


class Flow:
    """Flow(system, t0, "flight", options, p): φ_T, from the state at t0 to that at t0 + T.

    In one mode at both ends; the vector x (n,) is its states, then the held variables.
    """

    def __init__(self, system: System, t0: float, mode: str, options: dict, p: Mapping[str, float]):
        self.system, self.t0, self.mode = system, t0, mode
        self.options, self.p = options, p
        self.names = (*system.states_of(mode), *system.held)

    def start(self, x: np.ndarray) -> dict[str, Any]:
        return dict(zip(self.names, x.tolist() if x.ndim == 1 else list(x), strict=True))

    def run(self, x: np.ndarray, T: float) -> Run:
        end = self.t0 + T
        return simulate(
            self.system,
            end,
            t0=self.t0,
            start=self.start(x),
            mode=self.mode,
            **self.options,
            **self.p,
        )

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
        many = simulate_many(
            self.system,
            self.t0 + T,
            t0=self.t0,
            start=self.start(x.T),
            mode=self.mode,
            **{**self.options, "points": 2},
            **self.p,
        )
        runs = list(many)  # each is made once
        events = [[(e.transition, e.target) for e in run.events] for run in runs]
        return np.array([self.end(run) for run in runs]), events

    def derivative(self, x: np.ndarray, T: float, size: np.ndarray) -> tuple[np.ndarray, float]:
        """Dφ by central differences with two steps and Richardson's extrapolation; its error."""
        n, why = len(x), ""
        for share in SHARES:
            shift = np.diag(share * size)
            starts = np.vstack([x[None], x + shift, x - shift, x + 2 * shift, x - 2 * shift])
            try:
                ends, events = self.ends(starts, T)
            except ModelError as error:
                why = str(error)
                continue
            if any(each != events[0] for each in events[1:]):
                why = "neighbours of the cycle have other events than it has (a touch of a guard?)"
                continue
            rows = ends[1:].reshape(4, n, n)
            one = (rows[0] - rows[1]) / (2 * np.diag(shift))[:, None]
            two = (rows[2] - rows[3]) / (4 * np.diag(shift))[:, None]
            noise = float(self.options["rtol"]) * 10 / share
            return ((4 * one - two) / 3).T, float(np.abs(one - two).max() / 3 + noise)
        raise ModelError(f"the map has no derivative there: {why}")


def near(
    system: System,
    g: Function | None,
    t0: float,
    begin: Mapping[str, float],
    mode: str,
    period: float,
    options: dict,
    p: Mapping[str, float],
) -> Cycle:
    """near(…) -> the cycle near a start; g is the section, or None where the period is known.

    Where neighbours cannot start, it begins in the middle of the longest flight of the cycle.
    """
    try:
        return _newton(Flow(system, t0, mode, options, p), g, begin, period)
    except _Elsewhere as error:
        if g is not None:
            raise ModelError(f"{error}. A section must be no guard of the system") from None
        run = Flow(system, t0, mode, options, p).run(np.array(list(begin.values())), period)
        ends = np.unique([run.t[0], *(event.t for event in run.events), run.t[-1]])
        k = int(np.argmax(np.diff(ends)))
        when = float(ends[k] + ends[k + 1]) / 2
        at = run.at(when)
        mode = str(at["mode"])
        begin = {key: float(at[key]) for key in (*system.states_of(mode), *system.held)}  # type: ignore[arg-type]
        return _newton(Flow(system, when, mode, options, p), None, begin, period)


class _Elsewhere(ModelError):
    """Neighbours cannot start here."""


def _newton(flow: Flow, g: Function | None, begin: Mapping[str, float], period: float) -> Cycle:
    x, T = np.array([begin[name] for name in flow.names]), period
    kind = flow.system.S[flow.mode]
    values = flow.system.values(flow.p)

    def beside(x: np.ndarray) -> float:
        return 0.0 if g is None else float(g(flow.t0, kind(*x.tolist()), values))  # type: ignore[arg-type]

    def gap(x: np.ndarray, T: float) -> tuple[Run, np.ndarray]:
        run = flow.run(x, T)
        return run, flow.end(run) - x

    run, miss = gap(x, T)
    first, worst = _sizes(run, flow), np.inf
    for _ in range(TURNS):
        size = np.clip(_sizes(run, flow), REST * first, first / REST)
        worst = float(np.abs(miss / size).max())
        M, error = _neighbours(flow, x, T, size)
        if worst <= GOAL:
            break
        slope = _slope(run, flow)
        A, b = M - np.eye(len(x)), -miss
        if g is not None:
            steps = np.diag(1e-6 * size)
            normal = [(beside(x + h) - beside(x - h)) / (2 * h.max()) for h in steps]
            A = np.block([[A, slope[:, None]], [np.array([*normal, 0.0])]])
            b = np.append(b, -beside(x))
        scale = np.append(size, T)[: len(b)]
        step = scale * np.linalg.lstsq(A * scale, b, rcond=1e-11)[0]
        for share in 0.5 ** np.arange(12):
            x_new, T_new = x + share * step[: len(x)], T + (share * step[-1] if g else 0.0)
            try:
                run_new, miss_new = gap(x_new, T_new) if T_new > 0 else (run, miss)
            except ModelError:
                continue
            if np.abs(miss_new / size).max() < worst:
                x, T, run, miss = x_new, T_new, run_new, miss_new
                break
        else:
            break
    if worst > max(GOAL, 1e3 * float(flow.options["rtol"])):
        raise ModelError(
            f"no cycle was found: Newton's method stops where one period (of {T:.6g} "
            f"{flow.system.time}) misses its start by {worst:.1e} of the size of the states. "
            "Start nearer to the cycle, or let it settle=… longer if it is stable; a system that "
            "the clock does not drive needs a section instead of a period"
        )
    sizes = _sizes(run, flow)
    still = np.array([np.ptp(run[name]) for name in flow.names]) <= STILL * np.maximum(
        sizes, REST * first
    )
    if np.all(still) or (g is not None and np.all(sizes <= REST * first)):
        raise ModelError(f"what was found is at rest, not a cycle: {_words(run)}")
    if g is not None:
        again = flow.run(x, 2 * T)
        if again.ended is not Ended.FINISHED or np.abs((flow.end(again) - x) / size).max() > 1e-5:
            raise ModelError(
                "the state returns once but not again: the clock drives this system, so give its "
                "period instead of a section"
            )
    slope = _slope(run, flow)
    trivial = bool(
        np.any(slope)
        and np.linalg.norm((M @ slope - slope) / size) <= (1e-4 * np.linalg.norm(slope / size))
    )
    made = Monodromy(flow.names, M, error, float(T), trivial)
    return Cycle(float(T), run, flow.mode, worst, made)


def _neighbours(flow: Flow, x: np.ndarray, T: float, size: np.ndarray) -> tuple[np.ndarray, float]:
    try:
        return flow.derivative(x, T, size)
    except ModelError as error:
        raise _Elsewhere(str(error)) from None


def _sizes(run: Run, flow: Flow) -> np.ndarray:
    """How large each state becomes; of one that stays zero, the largest of them."""
    found = [np.nanmax(np.abs(run[name])) for name in flow.names]
    return np.array([size or max(found) or 1.0 for size in found])


def _slope(run: Run, flow: Flow) -> np.ndarray:
    """dx/dt at the end, of held variables 0."""
    places = list(flow.system.places(flow.mode).values())
    piece = run._pieces[-1:]
    theta = (run.t[-1] - piece[:, 0]) / piece[:, 1]
    _, slope = between(piece, theta, flow.system.width, len(flow.system.held))
    return np.append(slope[0], np.zeros(len(flow.system.held)))[places]


def _words(run: Run) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in run.final.items())


def linear(
    system: System,
    T: float,
    *,
    start: Mapping[str, float] | None,
    mode: str | None,
    t0: float,
    options: dict,
    p: Mapping[str, float],
) -> Monodromy | None:
    """Of a system whose map is affine in a box ten times as large as its run; else None."""
    try:
        run = simulate(system, t0 + T, t0=t0, start=start, mode=mode, **options, **p)
        flow = Flow(system, t0, str(run.mode[0]), options, p)
        n = len(flow.names)
        size = np.array([10 * np.nanmax(np.abs(run[name])) or 1.0 for name in flow.names])
        mixed = size * np.cos(1.0 + np.arange(n))
        units = np.diag(size)
        ends, _ = flow.ends(np.vstack([np.zeros(n), units, -units, mixed]), T)
    except ModelError:
        return None
    rest, up, down, last = ends[0], ends[1 : n + 1], ends[n + 1 : 2 * n + 1], ends[-1]
    M = ((up - down) / (2 * size[:, None])).T
    largest = np.abs(ends).max(axis=0) + 1e-300
    bent = np.abs(np.vstack([up + down - 2 * rest, last - rest - M @ mixed])) / largest
    if not np.isfinite(ends).all() or bent.max() > LINEAR:
        return None
    error = (np.abs(up + down - 2 * rest).max(axis=0) / size.min()).max()
    return Monodromy(flow.names, M, float(error) + float(options["rtol"]), float(T))
