"""Sliders and selects made from a model: their ranges, steps and names. Used by `explore`."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .draw.figure import symbol
from .model import ModelError, System, listed, number
from .run import Run
from .solve import METHODS

__all__ = ["SETTINGS", "Control", "controls_of", "rounded", "symbol_and_index"]

SETTINGS = ("t_end", "method", "rtol", "step")


@dataclass
class Control:
    """One slider or select. `key` is "p.g", "start.y", "choice.…" or an option of simulate.

    A log slider has `step` in decades. The grid of a slider's values begins at `base`: at `low`
    where the author gave the step, else at 0, so that the values are round numbers.
    """

    key: str
    group: str
    name: str
    index: str  # subscript of the name
    value: float | str
    kind: str = "slider"  # "slider", "log" or "select"
    low: float = 0.0
    high: float = 1.0
    step: float = 0.01
    unit: str = ""
    meaning: str = ""
    options: tuple[str, ...] = ()
    only: str = ""  # shown with "fixed" or with "adaptive" methods only
    base: float = 0.0
    apart: bool = False  # of models that begin with different values

    @property
    def ends(self) -> tuple[float | str, ...]:
        return self.options if self.kind == "select" else (self.low, self.high)

    def nearest(self, value: float) -> float:
        """control.nearest(0.123) -> 0.12: on the slider's grid; panel.js has the same formula."""
        log = self.kind == "log"
        at = math.log10(value) if log else value
        on = self.base + math.floor((at - self.base) / self.step + 0.5) * self.step
        digits = (2 if self.step < 1 else 1) if log else 12
        return min(max(float(f"{10**on if log else on:.{digits}g}"), self.low), self.high)

    def __str__(self) -> str:
        value = self.value if isinstance(self.value, str) else f"{self.value:.6g}".replace("-", "−")
        index = f"_{self.index}" if self.index and not self.index.isdigit() else self.index
        return f"{self.name}{index} = {value} {self.unit}".strip()


def controls_of(
    system: System,
    p: Mapping[str, float],
    begin: Mapping[str, float],
    settings: Mapping[str, Any],
    sliders: object,
    taken: set[str],
    run: Run,
    startable: Callable[[str, float], bool],
) -> list[Control]:
    """The sliders in their groups; author, Parameter or default run give each its range."""
    only = (
        None
        if sliders is None or isinstance(sliders, Mapping)
        else [sliders]
        if isinstance(sliders, str)
        else list(sliders)
    )
    ranges = {} if only is not None or sliders is None else dict(sliders)
    known = [*system.parameters, *system.units, *SETTINGS]
    if unknown := [name for name in (only or ranges) if name not in known]:
        raise ModelError(
            f"sliders names {listed(unknown)}, which {system.name!r} does not have; there are "
            f"{listed(known)}"
        )
    wanted = [
        name
        for name in known
        if (only is None or name in (*only, *SETTINGS))
        and ranges.get(name, True) is not False
        and name not in taken
    ]
    controls = []
    for name in (name for name in p if name in wanted):
        made = system.parameters[name]
        low, high = _span(p[name], made.low, made.high)
        controls.append(
            Control(
                f"p.{name}",
                "parameters",
                *symbol_and_index(name, made.symbol),
                p[name],
                low=low,
                high=high,
                unit=made.unit,
                meaning=made.meaning,
            )
        )
    for name in (name for name in begin if name in wanted):
        seen = np.append(run[name][np.isfinite(run[name])], begin[name])
        reach = rounded(1.5 * np.abs(seen).max(), 1) or 1.0
        wide = (
            (-reach if seen.min() < -1e-6 * reach else 0.0),
            (reach if seen.max() > 1e-6 * reach or seen.min() >= 0 else 0.0),
        )  # a sign that is kept
        here = np.append(
            run[name][run.mode_index == run.mode_index[0]], begin[name]
        )  # where the run was in its first mode
        low, high = (
            next(end for end in ends if end == begin[name] or startable(name, end))
            for ends in (
                (wide[0], rounded(here.min(), 3), float(here.min()), begin[name]),
                (wide[1], rounded(here.max(), 3), float(here.max()), begin[name]),
            )
        )
        meaning = system.meanings[name] or "at the start"
        controls.append(
            Control(
                f"start.{name}",
                "start",
                *symbol_and_index(name),
                begin[name],
                low=low,
                high=high,
                unit=system.unit(name),
                meaning=meaning,
            )
        )
    if settings:
        end = settings["t_end"]
        controls += [
            Control(
                "t_end",
                "algorithm",
                "t",
                "end",
                end,
                low=rounded(end / 10, 1),
                high=rounded(2 * end, 2),
                unit=system.time,
                meaning="end of the run",
            ),
            Control(
                "method",
                "algorithm",
                "method",
                "",
                settings["method"],
                "select",
                options=tuple(METHODS),
                meaning="how a step is made",
            ),
            Control(
                "rtol",
                "algorithm",
                "rtol",
                "",
                settings["rtol"],
                "log",
                1e-12,
                1e-2,
                1.0,
                meaning="relative tolerance",
                only="adaptive",
            ),
            Control(
                "step",
                "algorithm",
                "h",
                "",
                settings["step"],
                "log",
                rounded(end / 20_000, 1),
                rounded(end / 20, 1),
                0.1,
                system.time,
                "size of a step",
                only="fixed",
            ),
        ]
    for control in controls:
        name = control.key.rpartition(".")[2]
        step = None
        if not isinstance(ranges.get(name, True), bool):
            try:
                control.low, control.high, *step = (
                    number(limit, f"slider of {name!r}") for limit in ranges[name]
                )
            except TypeError:
                raise ModelError(
                    f"slider of {name!r} must be (low, high), (low, high, step) or False, "
                    f"not {ranges[name]!r}"
                ) from None
        low = control.low
        if control.kind != "select":
            control.low, control.high = (
                min(control.low, control.value),
                max(control.high, control.value),
            )
            if control.low >= control.high or (control.kind == "log" and control.low <= 0):
                raise ModelError(
                    f"the slider of {name!r} cannot run from {control.low:g} to {control.high:g}: "
                    f"give sliders={{{name!r}: (low, high)}}"
                )
        if control.kind == "slider" and step:
            if not step[0] > 0:
                raise ModelError(
                    f"the slider of {name!r} has the step {step[0]:g}: a step must be above 0"
                )
            control.step, control.base = step[0], low
        elif control.kind == "slider":
            control.step = _nice((control.high - control.low) / 250)
    return [control for control in controls if control.key.rpartition(".")[2] in wanted]


def _span(value: float, low: float | None, high: float | None) -> tuple[float, float]:
    """The declared range.

    An end that is not declared lies near the value and, unless that is 0, on its side of zero.
    """
    near = sorted((rounded(0.2 * value, 1), rounded(2.5 * value, 2))) if value else (-1.0, 1.0)
    reach = max(near[1] - near[0], abs(value))
    below, above = (
        (near[0] if high is None else min(near[0], high - reach)),
        (near[1] if low is None else max(near[1], low + reach)),
    )
    return (below if low is None else low), (above if high is None else high)


def rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")


def _nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return rounded(
        power * max(factor for factor in (1, 2, 5) if factor <= value / power * (1 + 1e-12)), 1
    )


def symbol_and_index(name: str, latex: str | None = None) -> tuple[str, str]:
    """symbol_and_index("omega0") -> ("ω", "0"): letter and index as plain text for the page.

    From the symbol that equations and axes use.
    """
    text = re.sub(
        r"\\(?:mathrm|text|mathit)\{([^{}]*)\}", r"\1", (latex or symbol(name)).strip("$")
    )
    text = re.sub(r"\\([A-Za-z]+) ?", lambda found: _greek(found[1]), text)
    base, _, index = text.partition("_")
    index = index.strip("{}")
    return (name, "") if re.search(r"[\\{}^]", base + index) else (base, index)


def _greek(word: str) -> str:
    size = "CAPITAL" if word[0].isupper() else "SMALL"
    try:
        return unicodedata.lookup(
            f"GREEK {size} LETTER {word.upper().replace('LAMBDA', 'LAMDA').removeprefix('VAR')}"
        )
    except KeyError:
        return "\\" + word
