"""Simulation: simulate(system, t_end) and simulate_many(system, t_end, start={"x": array}).

    run = simulate(ball, 12.0, e=0.9, start={"y": 5.0}, method="DOP853", rtol=1e-8)

What is asked for is checked in options.py and turned into the core's numbers in settings.py;
starts.py says where runs begin, endings.py why they ended. The work is done by lanes.py and
core.py, compiled (backend.py) or as plain Python from the same source, on the memory of a Batch
(batch.py), which pool.py keeps for the next run and shares out over threads. methods.py has the
tables, plain.py and source.py turn a model's functions into what the core calls, scipy_step.py lets
SciPy's implicit methods take the steps.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from time import perf_counter
from types import MappingProxyType

import numpy as np

from ..arguments import asked
from ..ledger import Events
from ..model import ModelError, System, listed
from ..run import Ended, Run, Work
from ..runs import Runs
from . import core
from .backend import core_is_kept, load_core
from .batch import Batch, samples
from .faded import faded
from .methods import FIXED_STEP, METHODS
from .options import count
from .pool import Pool, pool_of, together
from .starts import Refused, clocks, start_of, starts_of, try_functions

__all__ = ["FIXED_STEP", "METHODS", "simulate", "simulate_many", "warm"]


@asked
def simulate(
    system: System,
    t_end: float,
    *,
    t0: float = 0.0,
    start: Mapping[str, float] | None = None,
    mode: str | None = None,
    method: str = "DOP853",
    rtol: float = 1e-8,
    atol: float | None | Mapping[str, float] = None,
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

    t_end, t0     end and start time; start: states and held variables that differ from
                  system.start; mode: start mode
    method        "Euler", "Heun", "RK4" (with a fixed `step`, default a thousandth of the time),
                  "RK45" (Dormand–Prince 5(4)), "DOP853", or SciPy's "LSODA", "Radau", "BDF" for
                  stiff systems
    rtol, atol    the error of a step is kept below atol + rtol·|state|. atol is a number in the
                  unit of the states, or state name -> number; None (also for states that are not
                  named): a hundredth of rtol times the largest size that the state has had, so
                  that no unit matters
    max_step      bounds the step. A flow that is quiet and then pulses by itself (if 3 < t < 3.1)
                  may be stepped over unnoticed: make the pulse events (at=), or bound the step by
                  its length. Tables, np.interp(t, …), are never stepped over
    points        number of equidistant samples, or an array of times; every event adds one before
                  and one after
    locate        False: events are noticed only at the end of a step, as by a solver that knows
                  nothing of them
    backend       "auto" (compiled once that is ready), "compiled", "plain": the same numbers; a
                  model
                  that cannot be compiled runs plain, and a warning names the line
    max_events    when to give up, as after max_steps; the run then keeps what there is and says so
                  in run.ended and run.stopped
    parameters    any of the system's parameters by name

    Raises ModelError for bad input, for a start that does not fit its mode, and for a model whose
    functions do not fit it. A run that cannot go on is no error: it ends early, run.ended tells why
    and run.stopped says it in a sentence. From a start on the very edge of two basins tolerance and
    rounding decide where it goes, and nothing tells so: compare two tolerances.
    """
    began = perf_counter()
    options = (t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events)
    pool = pool_of(system, (*options, max_steps), dense=True)
    st, p = pool.settings, system.values(parameters)
    start = {**system.start, **({} if start is None else start)}
    values, name = start_of(st.options, start, mode, p)
    state, first = np.zeros((1, st.length)), st.place[name]
    state[0, st.places[name]] = values
    clock, refused = clocks(st, np.array([p], dtype=float)) if st.timed else ({}, {})
    if refused:
        raise refused[0]
    batch = pool.take(pool.code(1, lambda: try_functions(st, state[0], first, p)), 1)
    batch.load(p, state, np.array([first]), clock)
    batch.run()
    ended, stopped = batch.endings[0]
    if ended is Ended.REFUSED:
        raise ModelError(stopped)
    out = samples(batch.out)
    ledger, pieces = batch.ledger(), batch.pieces()
    work = Work(
        *batch.done[0, _COSTS].tolist(),
        len(ledger),
        perf_counter() - began,
        st.method,
        "plain" if batch.code is None else "compiled",
    )
    run = Run.__new__(Run)  # __init__ of a frozen dataclass takes a fortieth of a short run's time
    vars(run).update(
        system=system,
        p=p,
        t=out.t,
        j=out.j,
        mode_index=out.mode_index,
        values=out.values,
        events=Events(system, ledger),
        stopped=stopped,
        work=work,
        pieces=pieces,
        touches=batch.touches.get(0, []),
        ended=ended,
        said=batch.notes.get(0, []),
        options=MappingProxyType({**st.options.given, "start": start, "mode": mode}),
        make=simulate,
        other=out.other,
        part=out.part,
        look=lambda: faded(st, pieces, p),
    )
    pool.give_back(batch)
    return run


_COSTS = slice(core.ACCEPTED, core.LOOKS + 1)  # steps, refused ones, flows, guards


@asked
def simulate_many(
    system: System,
    t_end: float,
    *,
    t0: float = 0.0,
    start: Mapping[str, object] | None = None,
    mode: str | None = None,
    method: str = "DOP853",
    rtol: float = 1e-6,
    atol: float | None | Mapping[str, float] = None,
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
    """simulate_many(system, 20.0, start={"x": array, "v": 0.0}, k=array) -> Runs, one run an entry.

    start, parameters   numbers, or one-dimensional arrays of one common length
    workers             threads that compiled runs are shared out over; left out: one a processor
    the others          as in `simulate`, but with coarser rtol, atol and points, and fewer
                        max_events; a single `simulate` with these gives the same numbers

    A start that does not fit is that run's reason (Ended.REFUSED, and the sentence); its only
    sample is the start. Raises ModelError for bad input, and when no run at all can start. An
    interrupt from the keyboard is heard within a second.
    """
    began = perf_counter()
    options = (t_end, t0, method, rtol, atol, step, max_step, points, locate, backend, max_events)
    pool = pool_of(system, (*options, max_steps), dense=False)
    st = pool.settings
    given, starting = _arrays(parameters), _arrays({} if start is None else start)
    p = _parameters(system, given, _lanes(given, starting))
    starting = {**{key: np.array(value) for key, value in system.start.items()}, **starting}
    states, modes, refused = starts_of(st, starting, mode, p)
    clock, more = clocks(st, p)
    refused = more | refused

    def check() -> None:
        """The model's functions are tried where the first lane begins that can."""
        for lane in range(len(p)):
            if lane not in refused:
                try:
                    try_functions(st, states[lane], modes[lane], system.P(*p[lane].tolist()))
                    return
                except ModelError as error:
                    refused[lane] = error

    code = pool.code(len(p), check)
    able = np.setdiff1d(np.arange(len(p)), list(refused))
    threads = 1 if code is None else min(_workers(workers), max(len(able), 1))
    blocks = np.array_split(able, 1 if threads == 1 else min(4 * threads, len(able)))
    batches = []
    for block in blocks if len(able) else ():
        batch = pool.take(code, len(block))
        mine = {name: values[block] for name, values in clock.items()}
        batch.load(p[block], states[block], modes[block], mine)
        batches.append(batch)
    if batches:
        together(batches, threads)
    if all(ended is Ended.REFUSED for batch in batches for ended, _ in batch.endings):
        first = batches[0].endings[0][1] if batches and able[0] == 0 else refused[0]
        raise first if isinstance(first, ModelError) else ModelError(first)

    def how(lane: int) -> Mapping[str, object]:
        values = {key: np.broadcast_to(value, len(p))[lane] for key, value in starting.items()}
        begin = {key: float(value) for key, value in values.items()}
        return MappingProxyType({**st.options.given, "start": begin, "mode": mode})

    runs = _gather(pool, p, states, modes, refused, batches, how, began)
    for batch in batches:
        pool.give_back(batch)
    return runs


def _arrays(given: Mapping[str, object]) -> dict[str, np.ndarray]:
    found = {}
    for key, value in given.items():
        try:
            found[key] = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ModelError(f"{key!r} must be a number or an array, not {value!r:.60}") from None
    return found


def _lanes(*given: Mapping[str, np.ndarray]) -> int:
    """The common length of all arrays; 1 when there are none."""
    columns = [item for some in given for item in some.items()]
    lengths = {key: len(value) for key, value in columns if value.ndim == 1}
    if any(value.ndim > 1 for _, value in columns) or len(set(lengths.values())) > 1:
        raise ModelError(
            "simulate_many takes numbers and arrays of one common length; "
            f"here {lengths or 'arrays of two dimensions'}"
        )
    if 0 in lengths.values():
        raise ModelError(
            f"simulate_many got arrays without entries for {listed(lengths)}: "
            "there is nothing to simulate"
        )
    return next(iter(lengths.values()), 1)


def _parameters(system: System, given: Mapping[str, np.ndarray], lanes: int) -> np.ndarray:
    """(lanes, parameters); ModelError for one that is unknown, no number or out of range."""
    for key, value in given.items():
        for extreme in (value.min(), value.max()):  # NaN where there is one; the rest lies between
            system.values({key: float(extreme)})
    p = np.empty((lanes, len(system.parameters)))
    for place, (key, parameter) in enumerate(system.parameters.items()):
        p[:, place] = given.get(key, parameter.value)
    return p


def _workers(workers: object) -> int:
    return (os.cpu_count() or 1) if workers is None else count(workers, "workers")


def _gather(
    pool: Pool,
    p: np.ndarray,
    states: np.ndarray,
    modes: np.ndarray,
    refused: Refused,
    batches: list[Batch],
    how: Callable[[int], Mapping[str, object]],
    began: float,
) -> Runs:
    """The results of all batches; of lanes that could not begin, the start is the only sample."""
    st, lanes = pool.settings, len(p)
    able = np.ones(lanes, dtype=bool)
    able[list(refused)] = False
    done = np.concatenate([batch.done for batch in batches])
    counts, parts = np.ones(lanes, dtype=int), [batch.out for batch in batches]
    counts[able] = np.concatenate(
        [np.diff(batch.done[:, core.END], prepend=0) for batch in batches]
    )
    ends = np.cumsum(counts)
    kept = np.zeros((lanes, done.shape[1]), dtype=int)
    kept[able] = done
    costs, events = kept[:, _COSTS], kept[:, core.EVENTS]
    endings = iter([each for batch in batches for each in batch.endings])
    touches, notes, lane_of, before = {}, {}, np.flatnonzero(able).tolist(), 0
    for batch in batches:
        touches |= {lane_of[before + k]: found for k, found in batch.touches.items()}
        notes |= {lane_of[before + k]: found for k, found in batch.notes.items()}
        before += batch.lanes
    if refused:
        starts = np.zeros((lanes - before, parts[0].shape[1]))
        starts[:, 0], starts[:, 1] = st.options.t0, modes[~able]
        starts[:, 3], starts[:, 5:] = -1, states[~able]
        places = (ends - counts)[~able] - np.arange(len(starts))
        parts = [np.insert(np.concatenate(parts), places, starts, axis=0)]
    backend = "compiled" if all(batch.code for batch in batches) else "plain"
    return Runs(
        st.system,
        p,
        samples(*parts),
        ends,
        [
            (Ended.REFUSED, str(refused[lane])) if lane in refused else next(endings)
            for lane in range(lanes)
        ],
        events,
        np.concatenate([batch.ledger() for batch in batches]),
        costs,
        Work(
            *costs.sum(axis=0).tolist(),
            int(events.sum()),
            perf_counter() - began,
            st.method,
            backend,
        ),
        touches,
        notes,
        how,
        simulate,
    )


def warm(progress: Callable[[str], object] = print) -> bool:
    """warm() -> True when the engine is compiled: once a machine; `progress` is told meanwhile."""
    from .backend import llvm

    if llvm is None:
        progress("Numba is not installed: simulations run in plain Python")
        return False
    if not core_is_kept():
        progress("compiling the engine, once on this machine (about 20 s) …")
    load_core()
    return True
