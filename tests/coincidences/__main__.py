"""The long run by hand:

    python -m tests.coincidences 10000                    so many random cases of every kind
    python -m tests.coincidences 500 bodies billiard      of these kinds
    python -m tests.coincidences 1 bodies --seed 17       one case, told in full

Cases go round back ends and methods by their seed. A table says what was found and where.
"""

from __future__ import annotations

import argparse
import random
import traceback
from collections import Counter
from importlib import import_module
from time import perf_counter

from . import KINDS
from .findings import INVENTED, LOST, OTHER, SCIPY, THROUGH, Complaint

SHOWN = 8


def ways(kind) -> list[tuple[str, str]]:
    """All pairs of back end and method of a kind."""
    both = [(b, m) for m in kind.METHODS for b in ("plain", "compiled")]
    return [(b, m) for b, m in both if b == "plain" or m not in SCIPY]


def examine(kind, seed: int) -> tuple[int, list[Complaint], str]:
    """(events, complaints, what was tried) of one case; an exception of labkit's is a
    complaint.
    """
    case = kind.generate(random.Random(seed))
    backend, method = ways(kind)[seed % len(ways(kind))]
    try:
        complaints = kind.check(case, backend, method)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"
        complaints = [Complaint(OTHER, text)]
    return kind.expected(case), complaints, f"{backend}, {method}: {case}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.coincidences")
    parser.add_argument("cases", type=int, nargs="?", default=100)
    parser.add_argument("kinds", nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    given = parser.parse_args()
    columns = (LOST, INVENTED, THROUGH, OTHER)
    print(f"{'kind':10} {'cases':>6} {'failed':>6} {'events':>8}", end=" ")
    print(*(f"{name:>8}" for name in columns), f"{'s':>6}  first seeds that failed")
    for name in given.kinds or KINDS:
        kind = import_module(f".{name}", __package__)
        began, events, counts, failed = perf_counter(), 0, Counter(), []
        for seed in range(given.seed, given.seed + given.cases):
            some, complaints, tried = examine(kind, seed)
            events += some
            for complaint in complaints:
                counts[complaint.what] += complaint.count
            if complaints:
                failed.append((seed, complaints[0].text, tried))
            if given.cases == 1:
                print(tried, *complaints, sep="\n")
        print(f"{name:10} {given.cases:6} {len(failed):6} {events:8}", end=" ")
        print(
            *(f"{counts[what]:8}" for what in columns), f"{perf_counter() - began:6.1f}", end="  "
        )
        print(*(seed for seed, _, _ in failed[:SHOWN]), flush=True)
        for seed, text, tried in failed[:3] if given.cases > 1 else []:
            print(f"    {seed}: {text[:200]}\n        {tried[:300]}", flush=True)


if __name__ == "__main__":
    main()
