"""What each tool costs before its first answer.

Its import, and the first run of the stick-slip problem in a new process.

start_up(quick, log) -> list of Start
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

#: (tool, what is said of it, module, name of the contestant, starts with an empty cache)
FIRST = (
    (
        "labkit plain",
        "nothing to compile: what a first run uses by itself",
        "with_labkit",
        "labkit plain",
        False,
    ),
    (
        "labkit compiled",
        "model and engine kept from an earlier session",
        "with_labkit",
        "labkit compiled",
        False,
    ),
    (
        "labkit compiled",
        "nothing kept: the engine, once on a computer, and the model",
        "with_labkit",
        "labkit compiled",
        True,
    ),
    ("solve_ivp", "", "with_scipy", "solve_ivp", False),
    ("CyRK", "right side compiled by Numba, in each session", "with_cyrk", "CyRK", False),
    (
        "CyRK, own loop",
        "solver call and loop compiled by Numba, in each session",
        "with_cyrk",
        "CyRK, own loop",
        False,
    ),
    ("PathSim", "", "with_pathsim", "PathSim", False),
    (
        "heyoka",
        "compiled by LLVM, in each session and for each tolerance",
        "with_heyoka",
        "heyoka",
        False,
    ),
)

CHILD = """
from time import perf_counter
from tests.benchmarks.problems import PROBLEMS
began = perf_counter()
from tests.benchmarks.{module} import contestants
imported = perf_counter()
methods = ("DOP853", "Taylor", "RKDP87")
found = (c for c in contestants(PROBLEMS["stick_slip"]) if c.tool == {tool!r})
contestant = next(c for c in found if c.method in methods)
contestant.make(1e-6)()
print(imported - began, perf_counter() - imported)
"""


@dataclass
class Start:
    """Seconds for the import of a tool (NumPy and what states the problem are there already) and
    from there to its first answer.
    """

    tool: str
    remark: str
    imported: float
    answered: float


def _child(code: str, **environment: str) -> tuple[float, float]:
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), **environment}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=root,
        env=environment,
    )
    return (
        tuple(map(float, done.stdout.split()))
        if done.returncode == 0
        else (float("nan"), float("nan"))
    )


def start_up(quick: bool, log: Callable = print) -> list[Start]:
    """start_up(quick, print) -> list of Start.

    The best of three processes each, one where nothing is kept; NaN for a tool that is not there.
    """
    log("start-up …")
    found = []
    for tool, remark, module, name, empty in FIRST:
        if quick and empty:
            continue
        times = []
        for _ in range(1 if empty or quick else 3):
            with tempfile.TemporaryDirectory() as folder:
                times.append(
                    _child(
                        CHILD.format(module=module, tool=name),
                        **({"LABKIT_CACHE": folder} if empty else {}),
                    )
                )
        found.append(Start(tool, remark, *min(times, key=sum)))
        log(f"    {tool}: {sum(min(times)):.3f} s {remark}")
    return found
