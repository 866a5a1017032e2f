"""Tables and the picture of the benchmarks."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from math import log10
from pathlib import Path

from labkit.draw import COLORS, figure
from labkit.draw.figure import style
from labkit.run import write_whole

from .measure import GOALS, Row, Trial
from .problems import PROBLEMS, Problem
from .scale import Scale
from .start import Start

HERE = Path(__file__).resolve().parent
PICTURE = HERE.parents[1] / "notebooks" / "images" / "benchmarks.png"
LABKIT = "labkit compiled"
MARKERS = {
    "labkit compiled": ("o", COLORS[1], 9),
    "labkit plain": ("o", COLORS[4], 7),
    "solve_ivp": ("s", COLORS[0], 7),
    "CyRK": ("^", COLORS[2], 7),
    "CyRK, own loop": ("v", COLORS[2], 7),
    "PathSim": ("D", COLORS[6], 6),
    "heyoka": ("P", COLORS[3], 8),
}


def milliseconds(seconds: float | None) -> str:
    return "–" if seconds is None or seconds != seconds else f"{1e3 * seconds:.3g}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose columns also line up on a terminal."""
    widths = [
        max(3, *(len(row[k]) for row in [head, *rows])) for k in range(len(head))
    ]  # a rule of a mere colon is no table
    rule = [("-" * w)[:-1] + ":" if k else "-" * w for k, w in enumerate(widths)]
    lines = [
        [
            cell.rjust(w) if k else cell.ljust(w)
            for k, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        for line in [head, rule, *rows]
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def events_cell(trials: Sequence[Trial]) -> str:
    """In how many of a tool's settings events were missed or invented.

    At 1e-2 an error of the solution can look like that.
    """
    fair = [t for t in trials if t.tolerance <= 1.001e-3]
    wrong = [t for t in fair if t.missed or t.invented]
    return f"{len(wrong)} of {len(fair)}" + (
        f" ({', '.join(dict.fromkeys(t.contestant.method for t in wrong))})" if wrong else ""
    )


def problem_table(problem: Problem, rows: Sequence[Row], trials: Sequence[Trial]) -> str:
    """One problem: time of each tool for each goal, its ratio to labkit, and in how many settings
    events were missed or invented.
    """
    cell = {(row.tool, row.goal): row for row in rows}
    lines = []
    for tool in dict.fromkeys(row.tool for row in rows):
        line = [tool]
        for goal in GOALS:
            row, own = cell[tool, goal], cell.get((LABKIT, goal))
            ratio = (
                f"{row.seconds / own.seconds:.3g}" if row.seconds and own and own.seconds else "–"
            )
            line += [
                milliseconds(row.seconds),
                ratio,
                row.trial.label if row.trial else "not reached",
            ]
        lines.append([*line, events_cell([t for t in trials if t.contestant.tool == tool])])
    head = [problem.title]
    for goal in GOALS:
        head += [f"ms, error ≤ {goal:.0e}", "ratio", "setting"]
    return table([*head, "wrong events"], lines) + "\n"


@dataclass
class Results:
    """Everything that one run of the benchmarks has found."""

    tables: dict[str, tuple[list[Row], list[Trial]]]
    scale: Scale
    start: list[Start]
    missing: list[str]
    seconds: float

    def text(self) -> str:
        """results.text() -> all tables in Markdown."""
        parts = ["# Benchmarks", _conditions(self), HOW, summary(self.tables)]
        for name, (rows, trials) in self.tables.items():
            parts.append(problem_table(PROBLEMS[name], rows, trials))
        parts.append("## Many runs at once")
        for what in dict.fromkeys(e.what for e in self.scale.ensembles):
            group = [e for e in self.scale.ensembles if e.what == what]
            own = next((e.seconds for e in group if e.tool == LABKIT), None)
            lines = [
                [
                    e.tool,
                    milliseconds(e.seconds),
                    f"{e.seconds / own:.3g}" if own else "–",
                    e.setting,
                    f"{e.error:.0e}",
                    "" if e.measured == e.lanes else f"scaled up from {e.measured}",
                ]
                for e in group
            ]
            parts.append(table([what, "ms", "ratio", "setting", "largest error", ""], lines) + "\n")
        parts.append(
            "## How cost grows\n\nThe exponent is that of the last three sizes (each four times "
            "the one before): 1 is linear.\n"
        )
        lines = []
        for g in self.scale.growth:
            times = "  ".join(
                f"{n}: {milliseconds(s)}" for n, s in zip(g.sizes, g.seconds, strict=True)
            )
            lines.append([g.what, g.tool, times, f"{g.exponent:.2f}"])
        parts.append(table(["cost over", "tool", "n: ms", "exponent"], lines) + "\n")
        lines = [
            [s.tool, milliseconds(s.imported), milliseconds(s.answered), s.remark]
            for s in self.start
        ]
        parts.append(
            "## Before the first answer\n\n"
            + table(["stick-slip, in a new process", "ms, import", "ms, first run", ""], lines)
            + "\n"
        )
        return "\n".join(part.rstrip() + "\n" for part in parts)


HOW = """\
Five problems with a known end state, each written for each tool as an expert of that tool would
write it (the files `with_….py`). Every method of a tool runs over tolerances from 1e-2 to 1e-12. A
setting counts for a goal if its final error keeps it, if every event is found and none invented,
and if the same is true of all tighter tolerances of that method (no lucky hit). The fastest
settings are then timed in turn, again and again, and the best time stands (processor time, so that
other work on the computer does not count; many runs at once by the clock on the wall, since they
use all cores). *Ratio*: how many times the time of compiled labkit. *Wrong events*: in how many of
the settings with a tolerance of 1e-3 or less an event was missed or invented, and by which methods.
"labkit" is a whole call of `simulate`, with its checks, its ledger of events and its dense output.
"CyRK, own loop" is not a call of a tool but a hybrid solver that a user would have to write around
CyRK: restart loop and event location compiled by Numba. References: closed forms with 30 digits,
and Taylor series with 30 digits where friction is not constant.
"""


def _conditions(results: Results) -> str:
    versions = []
    for name in ("numpy", "scipy", "numba", "CyRK", "pathsim", "heyoka"):
        try:
            versions.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            versions.append(f"{name} not installed")
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    computer = f"Python {platform.python_version()}, {machine}"
    missing = f" Left out: {'; '.join(results.missing)}." if results.missing else ""
    return (
        f"{date.today():%Y-%m-%d}, {computer}; {', '.join(versions)}. "
        f"The run took {results.seconds / 60:.0f} minutes.{missing}\n"
    )


def summary(tables: dict[str, tuple[list[Row], list[Trial]]]) -> str:
    """summary(results.tables) -> for each problem the time of compiled labkit and how many times as
    long each other tool takes.
    """
    tools = [tool for tool in MARKERS if tool != LABKIT]
    parts = []
    for goal in GOALS:
        lines = []
        for name, (rows, _) in tables.items():
            seconds = {row.tool: row.seconds for row in rows if row.goal == goal}
            own = seconds.get(LABKIT)
            ratios = [
                f"{seconds[tool] / own:.3g}" if own and seconds.get(tool) else "–" for tool in tools
            ]
            lines.append([PROBLEMS[name].title, milliseconds(own), *ratios])
        parts.append(
            table(
                [
                    f"final error ≤ {goal:.0e}",
                    f"{LABKIT}, ms",
                    *(f"{tool}, ratio" for tool in tools),
                ],
                lines,
            )
        )
    return "\n\n".join(parts)


def picture(results: Results):
    """picture(results) -> Figure.

    Time of one run for both goals, work and precision of one hybrid problem, growth of cost.
    """
    fig = figure(2, 2, width=10.0, height=7.4, heights=(5, 4))
    titles = [PROBLEMS[name].title for name in results.tables]
    for axes, goal in zip(fig.axes[:2], GOALS, strict=True):
        for number, (tool, (marker, color, size)) in enumerate(MARKERS.items()):
            shift = 0.09 * (number - len(MARKERS) / 2)  # so that none hides another
            rows = [
                (row, place)
                for place, (rows, _) in enumerate(results.tables.values())
                for row in rows
            ]
            found = [
                (row.seconds, place) for row, place in rows if (row.tool, row.goal) == (tool, goal)
            ]
            if points := [(1e3 * seconds, place + shift) for seconds, place in found if seconds]:
                axes.plot(
                    *zip(*points, strict=True),
                    marker,
                    color=color,
                    markersize=size,
                    label=tool,
                    markeredgecolor="white",
                    markeredgewidth=0.7,
                )
        axes.set(xscale="log", xlabel="time of one run [ms]", ylim=(len(titles) - 0.5, -0.5))
        axes.set(yticks=range(len(titles)), yticklabels=titles if goal == GOALS[0] else [])
        axes.margins(x=0.05)
        axes.set_title(f"final error ≤ $10^{{{round(log10(goal))}}}$")
    handles, labels = fig.axes[0].get_legend_handles_labels()
    with style():
        fig.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    work, cost = fig.axes[2:]
    if "relay" in results.tables:
        trials = results.tables["relay"][1]
        for tool, (marker, color, _) in MARKERS.items():
            own = [t for t in trials if t.contestant.tool == tool and not t.missed + t.invented]
            front = [
                t for t in own if not any(o.seconds < t.seconds and o.error < t.error for o in own)
            ]
            front.sort(key=lambda t: t.seconds)
            work.loglog(
                [1e3 * t.seconds for t in front],
                [t.error for t in front],
                marker + "-",
                color=color,
                markersize=4,
                linewidth=1,
            )
        work.set(
            title="hysteresis relay, best of all settings",
            xlabel="time of one run [ms]",
            ylabel="final error",
            ylim=(1e-12, 1),
        )
        work.margins(x=0.05)
    styles = {"length": "-", "events": "--", "lanes": ":"}
    for g in results.scale.growth:
        kind = g.what.split()[0]
        marker, color, _ = MARKERS[g.tool]
        cost.loglog(
            g.sizes,
            [1e3 * s for s in g.seconds],
            marker + styles[kind],
            color=color,
            markersize=4,
            linewidth=1.2,
        )
    for kind, dashes in styles.items():
        cost.plot([], [], dashes, color="#555555", label=kind)
    cost.set(title="cost over n", xlabel="n", ylabel="time [ms]")
    cost.margins(x=0.05)
    cost.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    return fig


def write(results: Results) -> None:
    """write(results): results.md beside this file and the picture that README.md shows, each whole
    or not at all.
    """
    drawn = picture(results)
    write_whole(HERE / "results.md", results.text().encode())
    drawn.save_png(PICTURE)
