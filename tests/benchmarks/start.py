"""What each tool costs before its first answer: importing it, and the first run of the stick-slip problem in a new process.

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
from time import perf_counter

IMPORTS = {"labkit": "import labkit", "SciPy": "from scipy.integrate import solve_ivp", "CyRK": "import CyRK", "PathSim": "import pathsim", "heyoka": "import heyoka"}

#: (tool, what is said of it, module, name of the contestant, starts with an empty cache)
FIRST = (
    ("labkit plain", "nothing to compile: what a first run uses by itself", "with_labkit", "labkit plain", False),
    ("labkit compiled", "model and engine kept from an earlier session", "with_labkit", "labkit compiled", False),
    ("labkit compiled", "nothing kept: the engine, once on a computer, and the model", "with_labkit", "labkit compiled", True),
    ("solve_ivp", "", "with_scipy", "solve_ivp", False),
    ("CyRK", "right side compiled by Numba, in each session", "with_cyrk", "CyRK", False),
    ("CyRK, own loop", "solver call and loop compiled by Numba, in each session", "with_cyrk", "CyRK, own loop", False),
    ("PathSim", "", "with_pathsim", "PathSim", False),
    ("heyoka", "compiled by LLVM, in each session and for each tolerance", "with_heyoka", "heyoka", False),
)

CHILD = """
from time import perf_counter
from tests.benchmarks.problems import PROBLEMS
from tests.benchmarks.{module} import contestants
contestant = next(c for c in contestants(PROBLEMS["stick_slip"]) if c.tool == {tool!r} and c.method in ("DOP853", "Taylor", "RKDP87"))
began = perf_counter()
contestant.make(1e-6)()
print(perf_counter() - began)
"""


@dataclass
class Start:
    """Seconds to import a tool (over a bare interpreter) or to its first answer (without the import)."""

    tool: str
    remark: str
    seconds: float


def _child(code: str, **environment: str) -> tuple[float, str]:
    began = perf_counter()
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, cwd=root, env={**os.environ, "PYTHONPATH": str(root), **environment})
    return (perf_counter() - began, done.stdout.strip()) if done.returncode == 0 else (float("nan"), "nan")


def start_up(quick: bool, log: Callable = print) -> tuple[list[Start], list[Start]]:
    """start_up(quick, print) -> (imports, first answers); best of three processes each, one where it compiles for long. NaN: not there."""
    log("start-up …")
    rounds = 1 if quick else 3
    bare = min(_child("pass")[0] for _ in range(rounds))
    imports = [Start(tool, code, min(_child(code)[0] for _ in range(rounds)) - bare) for tool, code in IMPORTS.items()]
    firsts = []
    for tool, remark, module, name, empty in FIRST:
        seconds = []
        for _ in range(1 if empty else rounds):
            if empty and quick:
                seconds.append(float("nan"))
                continue
            with tempfile.TemporaryDirectory() as folder:
                seconds.append(float(_child(CHILD.format(module=module, tool=name), **({"LABKIT_CACHE": folder} if empty else {}))[1]))
        firsts.append(Start(tool, remark, min(seconds)))
        log(f"    {tool}: {firsts[-1].seconds:.3f} s {remark}")
    return imports, firsts
