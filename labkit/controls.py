"""Sliders and selects made from a model: their ranges, steps and names. Used by `explore`."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .draw.figure import symbol
from .model import ModelError, System, number
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
    def sets(self) -> str:
        """The name of what it sets, as the notebook says it."""
        return self.key.partition(".")[2] or self.key

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
    wanted: Collection[str],
    ranges: Mapping[str, Any],
    run: Run,
    startable: Callable[[str, float], bool],
) -> list[Control]:
    """The sliders that are wanted; author, Parameter or default run give each its range."""
    controls = []
    for name in p:
        made = system.parameters[name]
        low, high = _span(p[name], made.low, made.high)
        more = {"low": low, "high": high, "unit": made.unit, "meaning": made.meaning}
        letters = symbol_and_index(name, made.symbol)
        controls.append(Control(f"p.{name}", "parameters", *letters, p[name], **more))
    for name in begin:
        if name in wanted:
            low, high = _starts(name, begin[name], run, startable)
            meaning = system.meanings[name] or "at the start"
            more = {"low": low, "high": high, "unit": system.unit(name), "meaning": meaning}
            letters = symbol_and_index(name)
            controls.append(Control(f"start.{name}", "start", *letters, begin[name], **more))
    if settings:
        begun, (end, method, rtol, step) = float(run.t[0]), (settings[one] for one in SETTINGS)
        wide, of, time = end - begun, "algorithm", system.time
        low, high = begun + rounded(wide / 10, 1), begun + rounded(2 * wide, 2)
        fine, coarse = rounded(wide / 20_000, 1), rounded(wide / 20, 1)
        finish = Control("t_end", of, "t", "end", end, "slider", low, high, unit=time)
        select = Control("method", of, "method", "", method, "select", options=tuple(METHODS))
        tolerance = Control("rtol", of, "rtol", "", rtol, "log", 1e-12, 1e-2, 1.0, only="adaptive")
        size = Control("step", of, "h", "", step, "log", fine, coarse, 0.1, time, only="fixed")
        finish.meaning, select.meaning = "end of the run", "how a step is made"
        tolerance.meaning, size.meaning = "relative tolerance", "size of a step"
        controls += [finish, select, tolerance, size]
    controls = [control for control in controls if control.sets in wanted]
    for control in controls:
        if control.kind != "select":
            _ranged(control, ranges.get(control.sets, True))
    return controls


def _starts(
    name: str, value: float, run: Run, startable: Callable[[str, float], bool]
) -> tuple[float, float]:
    """From where to where a state can start.

    As far as the run went, and half as far again; with one sign where it kept it. If the model does
    not start there, as far as the run was in its first mode.
    """
    seen = np.append(run[name][np.isfinite(run[name])], value)
    reach = rounded(1.5 * np.abs(seen).max(), 1) or 1.0
    low = -reach if seen.min() < -1e-6 * reach else 0.0
    high = reach if seen.max() > 1e-6 * reach or seen.min() >= 0 else 0.0
    here = np.append(run[name][run.mode_index == run.mode_index[0]], value)
    lows, highs = (
        (wide, rounded(near, 3), float(near), value)
        for wide, near in ((low, here.min()), (high, here.max()))
    )
    low, high = (
        next(end for end in ends if end == value or startable(name, end)) for ends in (lows, highs)
    )
    return low, high


def _ranged(control: Control, given: Any) -> None:
    """Ends and step of a slider: the author's (low, high) or (low, high, step), or round ones."""
    name, low, high, step = control.sets, control.low, control.high, []
    if not isinstance(given, bool):
        try:
            limits = [number(limit, f"slider of {name!r}") for limit in given]
        except TypeError:
            limits = []
        if len(limits) not in (2, 3):
            raise ModelError(
                f"slider of {name!r} must be (low, high), (low, high, step) or False, not {given!r}"
            )
        low, high, *step = limits
    log = control.kind == "log"
    control.low, control.high = min(low, control.value), max(high, control.value)
    if control.low >= control.high or (log and control.low <= 0):
        raise ModelError(
            f"the slider of {name!r} cannot run from {low:g} to {high:g}: "
            f"give sliders={{{name!r}: (low, high)}}"
        )
    if step:
        if not step[0] > 0:
            raise ModelError(
                f"the slider of {name!r} has the step {step[0]:g}: a step must be above 0"
            )
        control.step, control.base = step[0], math.log10(low) if log else low
    elif not log:
        control.step = _nice((control.high - control.low) / 250)


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
    factor = max(each for each in (1, 2, 5) if each <= value / power * (1 + 1e-12))
    return rounded(power * factor, 1)


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
    letter = word.upper().replace("LAMBDA", "LAMDA").removeprefix("VAR")
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {letter}")
    except KeyError:
        return "\\" + word
