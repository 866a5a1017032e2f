"""python -m tests.benchmarks [--quick] [problem …]: labkit beside other solvers.

python -m tests.benchmarks latency: the live figure. python -m tests.benchmarks recorded: one that
plays in a page without Python.

Writes tests/benchmarks/results.md and notebooks/images/benchmarks.png, whole runs only (no --quick,
all problems). The other solvers: pip install ".[benchmarks]"; one that is missing is named and left
out.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from time import perf_counter

from .measure import TOLERANCES, race, sweep
from .problems import PROBLEMS

TOOLS = {
    "labkit": "with_labkit",
    "SciPy": "with_scipy",
    "CyRK": "with_cyrk",
    "PathSim": "with_pathsim",
    "heyoka": "with_heyoka",
}


def load_tools() -> tuple[list, list[str]]:
    """load_tools() -> (modules of the tools that are there, names of those that are not)."""
    there, missing = [], []
    for name, module in TOOLS.items():
        try:
            there.append(importlib.import_module(f".{module}", __package__))
        except ImportError as error:
            missing.append(f"{name} ({error})")
    return there, missing


def say(text: str = "") -> None:
    print(text, flush=True)


def main() -> int:
    if sys.argv[1:2] in (["latency"], ["recorded"]):
        return importlib.import_module(f".{sys.argv[1]}", __package__).main()
    parser = argparse.ArgumentParser(
        prog="python -m tests.benchmarks", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "problems",
        nargs="*",
        choices=[[], *PROBLEMS],
        help=f"some of {', '.join(PROBLEMS)} (default: all)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="few tolerances, few rounds, small ensembles: to try it; writes no files",
    )
    options = parser.parse_args()
    names = options.problems or list(PROBLEMS)
    modules, missing = load_tools()
    for name in missing:
        say(f"left out: {name}")
    from . import report
    from .scale import scale
    from .start import start_up

    began = perf_counter()
    tolerances = TOLERANCES[1::3] if options.quick else TOLERANCES
    trials = {}
    for name in names:
        say(f"{PROBLEMS[name].title} …")
        trials[name] = sweep(
            PROBLEMS[name],
            [c for module in modules for c in module.contestants(PROBLEMS[name])],
            tolerances,
            say,
        )
    say("the fastest of them, in turn …")
    tables = {
        name: (rows, trials[name])
        for name, rows in race(trials, rounds=4 if options.quick else 30).items()
    }
    for name in names:
        say(report.problem_table(PROBLEMS[name], *tables[name]))
    results = report.Results(
        tables,
        scale(options.quick, say),
        start_up(options.quick, say),
        missing,
        perf_counter() - began,
    )
    say(results.text())
    if not options.quick and len(names) == len(PROBLEMS):
        report.write(results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
