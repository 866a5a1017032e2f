"""What a sweep gains from threads, processes and a cluster of Dask, and what a lane of it costs.

python -m tests.benchmarks.executors            # all in one run on this computer

The overhead of a lane is what its portion takes beyond the run itself: lanes so short that the run
is next to nothing.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from time import perf_counter

import numpy as np

from labkit import Mode, Parameter, System, simulate, sweep

system = System(
    "oscillator",
    {"x": "m", "v": "m/s"},
    {"d": Parameter(0.1, "1/s", "damping", 0, 5), "w": Parameter(3.0, "1/s", "frequency", 0.1, 10)},
    [Mode("swings", lambda t, s, p: (s.v, -2 * p.d * s.v - p.w**2 * s.x))],
    start={"x": 1.0, "v": 0.0},
)


@contextlib.contextmanager
def dask(workers: int) -> Iterator[Executor]:
    from distributed import Client, LocalCluster

    with (
        LocalCluster(workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield client.get_executor()


def timed(horizon: float, lanes: int, executor: Executor | None) -> tuple[float, np.ndarray]:
    begin = perf_counter()
    options = {"w": np.linspace(1, 9, lanes), "points": 50, "workers": 1, "executor": executor}
    found = sweep(system, horizon, lambda run: run.final["x"], progress=False, **options)
    return perf_counter() - begin, found.values


def main() -> None:
    workers = os.cpu_count() or 1
    simulate(system, 1.0)
    kinds = {
        "here, one thread": lambda: contextlib.nullcontext(None),
        f"{workers} threads": lambda: ThreadPoolExecutor(workers),
        f"{workers} processes": lambda: ProcessPoolExecutor(workers),
        f"Dask, {workers} workers": lambda: dask(workers),
    }
    first, same = 0.0, None
    for name, make in kinds.items():
        with make() as executor:
            timed(0.01, 64, executor)  # workers start, the model is compiled or read
            heavy, values = min((timed(3000.0, 64, executor) for _ in range(3)), key=lambda t: t[0])
            light = min(timed(0.01, 2000, executor)[0] for _ in range(3))
        first, same = first or heavy, values if same is None else same
        assert np.array_equal(values, same), "the same numbers everywhere"
        print(
            f"{name:20} 64 long lanes {heavy:.2f} s, speed-up {first / heavy:.2f}; "
            f"{1e3 * light / 2000:.3f} ms a short lane",
            flush=True,
        )


if __name__ == "__main__":
    main()
