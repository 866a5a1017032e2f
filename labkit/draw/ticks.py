"""Numbers on axes and in words: ticks that never run together, seconds with prefixes, 10⁻⁴.

said(-1.2e-5)                    # "−1.2·10⁻⁵"
over_time(axes, "$t$", "s")      # "t [ms]" while the axis is shorter than 0.1 s
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import AutoLocator, Formatter, ScalarFormatter

from .private import tick_size

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Seconds: up to which end of the axis, its unit, and how many of it make a second
_UNITS = ((1e-7, "ns", 1e9), (1e-4, "µs", 1e6), (0.1, "ms", 1e3))


def said(value: float, digits: int = 4) -> str:
    """said(-1.2e-5) -> "−1.2·10⁻⁵": a number in a sentence or beside a mark."""
    text = f"{value:.{digits}g}"
    mantissa, e, power = text.partition("e")
    if e:
        raised = "10" + str(int(power)).translate(_RAISED)
        text = raised if mantissa == "1" else f"{mantissa}·{raised}"
    return text.replace("-", "−")


class Spaced(AutoLocator):
    """Ticks at round numbers, as many as have room beside each other with what is written there."""

    def tick_values(self, vmin: float, vmax: float) -> np.ndarray:
        axis = self.axis
        room = axis.axes.bbox.width / axis.axes.get_figure(root=True).dpi * 72  # points
        size = tick_size(axis)
        for bins in range(9, 0, -1):
            self.set_params(nbins=bins)
            ticks = super().tick_values(vmin, vmax)
            low, high = min(vmin, vmax), max(vmin, vmax)
            seen = ticks[(ticks >= low) & (ticks <= high)]
            if len(seen) < 2:
                return ticks
            words = axis.get_major_formatter().format_ticks(seen)
            wide = [size * _ems(word) for word in words]
            needed = max((a + b) / 2 for a, b in zip(wide, wide[1:], strict=False)) + size
            gap = room * (seen[1] - seen[0]) / (high - low)
            if gap >= needed:
                return ticks
        return seen[:: int(np.ceil(needed / gap))]  # two at least is what Matplotlib insists on


def _ems(word: str) -> float:
    """The width of a number in DejaVu Sans, in units of its size."""
    plain = re.sub(r"\\\w+|[${}]", "", word)
    return sum({".": 0.32, "−": 0.84, "-": 0.84}.get(letter, 0.64) for letter in plain)


class Numbers(ScalarFormatter):
    """Matplotlib's numbers, with ×10⁻⁵ at the end of the axis in place of 1e−5."""

    def get_offset(self) -> str:
        sign, _, power = super().get_offset().partition("1e")
        return f"×10{power.replace('−', '-').translate(_RAISED)}" if power else sign


class Between(Formatter):
    """Between the powers of ten of a logarithmic axis: 2 and 5, up to two decades.

    On an axis shorter than half a decade plain numbers. Matplotlib's 3 and 4 run together.
    """

    def __call__(self, x: float, pos: int | None = None) -> str:
        low, high = sorted(self.axis.get_view_interval())
        if high < 3 * low:
            return said(x, 6)  # 3.25, on an axis from 3.1 to 3.7
        power = int(np.floor(np.log10(x) + 1e-9))
        digit = round(x / 10.0**power)
        few = high < 100 * low and digit in (2, 5)
        return f"$\\mathdefault{{{digit}\\times10^{{{power}}}}}$" if few else ""


class Seconds(Formatter):
    """Ticks in s, ms, µs or ns, as the end of the axis asks; the unit stands in the label."""

    def __init__(self, axis: Any, name: str):
        self.named, self.name, self.factor, self.digits = axis, name, 1.0, 3
        self.named.set_label_text(f"{name} [s]")
        self.label = self.named.get_label_text()

    def _put(self) -> None:
        unit = "s"
        far = max(map(abs, self.named.get_view_interval()))
        self.factor = 1.0
        for end, prefixed, factor in _UNITS:
            if 0 < far <= end:
                unit, self.factor = prefixed, factor
                break
        label, shown = f"{self.name} [{unit}]", " ".join(self.named.get_label_text().split())
        if label != shown == self.label:  # else an author has written another
            self.named.set_label_text(label)
            self.label = label

    def set_locs(self, locs: Sequence[float]) -> None:
        self._put()
        values = np.asarray(locs, dtype=float) * self.factor
        gaps = np.diff(np.unique(values))
        gap = gaps.min() if len(gaps) else 1.0

        def exact(digits: int) -> bool:
            return bool(np.abs(values - values.round(digits)).max(initial=0.0) < 1e-3 * gap)

        self.digits = next(filter(exact, range(16)), 15)

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self.fix_minus(f"{x * self.factor + 0.0:.{self.digits}f}")


def over_time(axes: Axes, name: str, unit: str) -> None:
    """over_time(axes, "$t$", "s"): the label of the time axis; seconds get a prefix when short."""
    if unit == "s":
        axes.xaxis.set_major_formatter(Seconds(axes.xaxis, name))
    else:
        axes.set_xlabel(f"{name} [{unit}]" if unit else name)
