"""python -m tests.benchmarks.old_and_new PATH [problem …] [--rounds 40].

This checkout beside the one at PATH, one after the other.

Each checkout answers in a process of its own and is asked in turn, a few calls at a time, so that
what else the computer does counts against both. Ratios are of the least and of the median time of a
`simulate` call, new over old.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

RTOL = 1e-8
SETTINGS = (
    {"rtol": RTOL, "atol": 1e-10},
    {"rtol": RTOL},
)  # the same for both, and each by its own default
BACKENDS = ("compiled", "plain")
COUNTS = ("steps", "rejected", "evaluations", "guard_evaluations", "events")


def answer() -> None:
    """One checkout.

    Lines of JSON go in, [problem, options, calls] or null for the counts; seconds a call, or
    counts, come out.
    """
    import numpy as np

    from labkit import simulate, simulate_many

    from .measure import CLOCK
    from .problems import PROBLEMS

    def call(name: str, options: dict) -> object:
        if name == "lanes":
            return simulate_many(
                PROBLEMS["ball"].system, 12.0, start={"y": heights}, workers=1, **options
            )
        return simulate(PROBLEMS[name].system, PROBLEMS[name].t_end, **options)

    heights = np.linspace(5.0, 15.0, 1000)
    for line in sys.stdin:
        name, options, calls = json.loads(line)
        if calls is None:
            work = call(name, options).work
            print(json.dumps([getattr(work, count) for count in COUNTS]), flush=True)
            continue
        times = []
        for _ in range(calls):
            began = CLOCK()
            call(name, options)
            times.append(CLOCK() - began)
        print(json.dumps(times), flush=True)


class Checkout:
    def __init__(self, path: Path, cache: str | None):
        program = (
            f"import sys; sys.path.insert(0, {str(path)!r}); import importlib.util as u; import "
            "tests.benchmarks; "
            f"spec = u.spec_from_file_location('tests.benchmarks.old_and_new', {__file__!r}); "
            "module = u.module_from_spec(spec); spec.loader.exec_module(module); module.answer()"
        )
        environment = {**os.environ, **({"LABKIT_CACHE": cache} if cache else {})}
        self.process = subprocess.Popen(
            [sys.executable, "-c", program],
            cwd=path,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def ask(self, *question: object) -> list:
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())


def main() -> None:
    from .problems import PROBLEMS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path, help="the other checkout, the old one")
    parser.add_argument(
        "problems",
        nargs="*",
        help=f"some of {', '.join(PROBLEMS)}, lanes (1,000 balls at once); default: all",
    )
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--backend", choices=BACKENDS, help="default: both")
    parser.add_argument("--old-cache", help="where the old one keeps compiled code, if elsewhere")
    given = parser.parse_args()
    both = (
        Checkout(given.path.resolve(), given.old_cache),
        Checkout(Path(__file__).resolve().parents[2], None),
    )
    cases = []
    for name in given.problems or [*PROBLEMS, "lanes"]:
        for backend in (
            ([given.backend] if given.backend else BACKENDS) if name != "lanes" else ["compiled"]
        ):
            for options in SETTINGS:
                options = {**options, "backend": backend}
                counts = [side.ask(name, options, None) for side in both]
                least = min(side.ask(name, options, 3)[-1] for side in both)
                calls = max(1, min(50, int(0.02 / least)))
                cases.append((name, options, calls, counts, ([], [])))
    for _ in range(given.rounds):
        for name, options, calls, _, times in cases:
            if calls > 1 or len(times[0]) < 12:
                for side, found in zip(both, times, strict=True):
                    found.append(side.ask(name, options, calls))
    print(
        f"{'problem':10} {'back end':9} {'atol':7} {'old µs':>9} {'new µs':>9}  least  median   "
        f"{', '.join(COUNTS)}: old | new"
    )
    for name, options, _, counts, times in cases:
        old, new = ([t for call in found for t in call] for found in times)
        middles = [median(a) / median(b) for a, b in zip(times[1], times[0], strict=True)]
        print(
            f"{name:10} {options['backend']:9} {options.get('atol', 'default'):<7} "
            f"{1e6 * min(old):9.1f} {1e6 * min(new):9.1f}  "
            f"{min(new) / min(old):5.3f}  {median(middles):6.3f}   "
            + " | ".join(" ".join(map(str, each)) for each in counts)
        )


if __name__ == "__main__":
    main()
