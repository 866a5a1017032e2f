"""Time at equal accuracy.

Every tool and method over a range of tolerances, then the fastest of each tool side by side.

trials = sweep(problem, contestants)   # error, events missed and invented, rough time of each
rows = race({name: trials, …})         # best time of each tool for each goal, measured in turn
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import get_clock_info, perf_counter, thread_time

from .contest import Answer, Contestant, judge
from .problems import Problem

GOALS = (1e-5, 1e-9)
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
#: The thread's own processor time where it is fine enough: what else the computer does then does
#: not count against a slow tool.
CLOCK = thread_time if get_clock_info("thread_time").resolution < 1e-6 else perf_counter
PATIENCE = (
    1.0  # s, after a run that takes longer the tolerances of a method are not tightened further
)


@dataclass
class Trial:
    """One setting: how wrong it is, how long one run took in the sweep, and (`first`) how long
    preparing it and its first run took.
    """

    contestant: Contestant
    tolerance: float
    run: Callable[[], Answer]
    error: float
    missed: int
    invented: int
    seconds: float
    first: float

    @property
    def label(self) -> str:
        return f"{self.contestant.method}, {self.tolerance:.0e}"


@dataclass
class Row:
    """Result of a tool for a goal: None stands for a goal that it did not reach."""

    tool: str
    goal: float
    trial: Trial | None
    seconds: float | None


def timed(run: Callable[[], object], least: float = 2e-3, most: int = 1000) -> float:
    """timed(run) -> seconds for one call, from as many calls as fill `least` seconds (at least
    one).
    """
    count, began = 0, CLOCK()
    while count < most:
        run()
        count += 1
        if CLOCK() - began >= least:
            break
    return (CLOCK() - began) / count


def sweep(
    problem: Problem,
    contestants: Sequence[Contestant],
    tolerances: Sequence[float] = TOLERANCES,
    log: Callable = print,
) -> list[Trial]:
    """sweep(problem, contestants) -> one Trial a setting, tolerances falling until both goals are
    kept twice or patience ends.
    """
    trials = []
    for contestant in contestants:
        good = 0
        for tolerance in tolerances:
            began = perf_counter()
            try:
                run = contestant.make(tolerance)
                answer = run()
            except (
                Exception
            ) as error:  # a tool that gives up at a tolerance is no reason to end the benchmark
                log(
                    f"    {contestant.tool}, {contestant.method}, {tolerance:.0e}: "
                    f"{type(error).__name__}: {error}"
                )
                continue
            first = perf_counter() - began
            seconds = min(timed(run) for _ in range(1 if first > 0.2 else 3))
            trials.append(
                Trial(contestant, tolerance, run, *judge(problem, answer), seconds, first)
            )
            good = (
                good + 1
                if trials[-1].error <= 0.1 * min(GOALS)
                and not trials[-1].missed + trials[-1].invented
                else 0
            )
            if good == 2 or seconds > PATIENCE:
                break
    for _ in range(3):  # once more, in turn: these times choose who races
        for trial in trials:
            if trial.seconds < 0.05:
                trial.seconds = min(trial.seconds, timed(trial.run))
    return trials


def settled(trials: Sequence[Trial], goal: float) -> list[Trial]:
    """The trials that keep a goal with every event found, and whose method also keeps it at each
    tighter tolerance that was tried: no luck.
    """
    kept = []
    for trial in trials:
        tighter = [
            t for t in trials if t.contestant is trial.contestant and t.tolerance <= trial.tolerance
        ]
        if all(t.error <= goal and t.missed == t.invented == 0 for t in tighter):
            kept.append(trial)
    return kept


def race(
    fields: Mapping[str, Sequence[Trial]], rounds: int = 30, finalists: int = 3, budget: float = 4.0
) -> dict[str, list[Row]]:
    """race({problem: trials}) -> {problem: one Row a tool and goal}.

    The fastest settings of each tool, timed in turn, best of the rounds.

    In turn, and all problems in each round, so that a computer that is busy for a minute is so for
    everybody; slow settings get fewer rounds (`budget` seconds, but at least 8, or all).
    """
    chosen: dict[tuple[str, str, float], list[Trial]] = {}
    for problem, trials in fields.items():
        for tool in dict.fromkeys(t.contestant.tool for t in trials):
            own = [t for t in trials if t.contestant.tool == tool]
            for goal in GOALS:
                chosen[problem, tool, goal] = sorted(settled(own, goal), key=lambda t: t.seconds)[
                    :finalists
                ]
    field = {id(t): t for group in chosen.values() for t in group}
    best = dict.fromkeys(field, float("inf"))
    pauses = {
        key: max(1, rounds // max(8, int(budget / max(trial.seconds, 1e-3))))
        for key, trial in field.items()
    }
    for number in range(rounds):
        for key, trial in field.items():
            if number % pauses[key] == 0:
                trial.run()  # the first run after another tool's finds the processor's caches cold
                best[key] = min(best[key], timed(trial.run, 4e-3))
    rows: dict[str, list[Row]] = {problem: [] for problem in fields}
    for (problem, tool, goal), group in chosen.items():
        winner = min(group, key=lambda t: best[id(t)], default=None)
        rows[problem].append(Row(tool, goal, winner, best[id(winner)] if winner else None))
    return rows
