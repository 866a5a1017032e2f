"""Small tables of results: columns with names and units, numbers that can be read.

    Table({"T": "s", "mean output": ("V", ".3f"), "error": ("V", "<"), "events": ""}, rows, "Runs")

shows itself as HTML at the end of a cell; print(table) is plain text for a checked cell.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real

from .arguments import asked
from .model import ModelError

__all__ = ["Table", "prefixed"]

Column = str | tuple[str, ...]

PREFIXES = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"]  # 1e-15 … 1e12
#: Units that take a prefix; also at the head of a quotient or a product, V/s or N·m
BASES = frozenset(["s", "m", "V", "A", "Ω", "H", "F", "W", "J", "N", "Hz", "Pa", "K", "C", "T"])
DIGITS, FEW = 4, 2  # significant ones where a column spans little, and where it spans much
PLAIN = (0.01, 1e4)  # the largest number of a column for which its unit stays as it is
WIDE = 1e4  # ratio of the largest number to the smallest from which powers of ten are written
FLOOR = 1e-15  # the smallest bound that "<" shows
NOTHING = "–"
NUMBER = re.compile(r"[<≤±+−-]? ?\d[\d.]*(e[+−-]?\d+)?( ?[^\s\d]\S*)?|–")


@dataclass(frozen=True, repr=False)
class Table:
    """Table({"T": "s", "gain": ""}, rows, "Caption") -> a table that shows itself.

        Table(("method", ("error", "m"), ("time", "s", ".1f")), rows)

    columns   one entry a column: head, or (head, unit), or (head, unit, form); or a mapping
              head -> unit, or (unit, form)
    rows      one sequence a row: text, numbers, True or False, None; NaN and None are shown as –
    caption   stands above it

    Numbers of a column have one prefix of the unit (100 µs, 5 km), four significant digits and
    equally many decimals; where they span more than four decades, powers of ten with two digits.
    A form is a number of significant digits, or a format of Python (".3f", ".1e"), which is taken
    in the unit as it stands; "<" shows only the next power of ten above, of an error that differs
    from machine to machine. Columns of numbers stand at the right, others at the left. In HTML
    a cell may have $formulas$, `code` and **bold** words.

    Raises ModelError for a row that is not as long as the columns are many, and for an unknown
    form.
    """

    columns: Sequence[Column] | Mapping[str, Column]
    rows: Iterable[Sequence[object]]
    caption: str = ""

    def __post_init__(self) -> None:
        def parts(what: Column) -> tuple:
            return (what,) if isinstance(what, str) else tuple(what)

        columns = self.columns
        if isinstance(columns, Mapping):
            columns = [(head, *parts(what)) for head, what in columns.items()]
        full = [(*what, *("", None)[len(what) - 1 :])[:3] for what in map(parts, columns)]
        rows = [tuple(row) for row in self.rows]
        for place, row in enumerate(rows):
            if len(row) != len(full):
                raise ModelError(
                    f"row {place} of the table {self.caption!r} has {len(row)} cells, but there "
                    f"are {len(full)} columns: {row!r:.80}"
                )
        object.__setattr__(self, "columns", tuple(full))
        object.__setattr__(self, "rows", tuple(rows))

    @property
    def cells(self) -> list[list[str]]:
        """What is shown: a list for the heads, then one for each row."""
        made = []
        for place, (head, unit, form) in enumerate(self.columns):
            unit, shown = _shown([row[place] for row in self.rows], unit, form, head)
            made.append([f"{head} [{unit}]" if unit else head, *shown])
        return [list(row) for row in zip(*made, strict=True)]

    def _right(self, cells: list[list[str]]) -> list[bool]:
        """Which columns are numbers."""
        columns = zip(*cells[1:], strict=True)
        return [all(map(NUMBER.fullmatch, column)) for column in columns] or [False] * len(cells[0])

    def _repr_html_(self) -> str:
        cells = self.cells
        side = ["right" if right else "left" for right in self._right(cells)]

        def row(what: list[str], tag: str, more: str = "") -> str:
            inner = (
                f'<{tag}{more} style="text-align:{where}">{_rich(cell)}</{tag}>'
                for cell, where in zip(what, side, strict=True)
            )
            return f"<tr>{''.join(inner)}</tr>"

        above = 'style="caption-side:top;text-align:left;font-weight:bold;color:inherit"'
        caption = f"<caption {above}>{_rich(self.caption)}</caption>\n" if self.caption else ""
        body = "\n".join(row(what, "td") for what in cells[1:])
        head = row(cells[0], "th", ' scope="col"')
        return (
            f'<table class="labkit-table">\n{caption}<thead>\n{head}\n</thead>\n'
            f"<tbody>\n{body}\n</tbody>\n</table>"
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        cells, lines = self.cells, [self.caption] if self.caption else []
        right, wide = self._right(cells), [max(map(len, c)) for c in zip(*cells, strict=True)]
        for row in cells:
            places = zip(row, wide, right, strict=True)
            words = (cell.rjust(w) if end else cell.ljust(w) for cell, w, end in places)
            lines.append("  ".join(words).rstrip())
        return "\n".join(lines)


Table.__init__ = asked(Table.__init__)  # type: ignore[method-assign]


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """prefixed(1e-4, "s") -> (1e-6, "µs"): what to divide by, and the unit with its prefix.

    (1.0, unit) for sizes of 0.01 … 10,000, and where the unit takes no prefix (kg, °C, m², m**2).
    """
    first = re.split(r"[/·]|(?<!\*)\*(?!\*)", unit)[0]  # m**2 stays whole: (µm)² is no millionth
    if first not in BASES or not 0 < size < math.inf or PLAIN[0] <= size < PLAIN[1]:
        return 1.0, unit
    place = min(max(math.floor(math.log10(size) / 3 + 1e-9), -5), 4)
    return 1000.0**place, PREFIXES[place + 5] + unit


def _shown(values: list, unit: str, form: object, head: str) -> tuple[str, list[str]]:
    """The unit of a column, with its prefix, and its cells."""
    numbers = [v for v in values if _is_number(v)]
    sizes = [abs(float(v)) for v in numbers if v and math.isfinite(v)]
    write = None
    if isinstance(form, str) and form != "<":
        write = form
        try:
            format(1.0, form)
        except ValueError:
            raise ModelError(
                f"column {head!r} has the form {form!r}: give a number of digits, a format of "
                'numbers like ".3f", or "<"'
            ) from None
    elif form is None and sizes and all(isinstance(v, Integral) for v in numbers):
        write = ".0f"
    elif form != "<":
        if not (form is None or (isinstance(form, Integral) and form > 0)):
            raise ModelError(f"column {head!r} has the form {form!r}: give a number of digits")
        if sizes and max(sizes) > WIDE * min(sizes):
            write = f".{(form or FEW) - 1}e"
        elif sizes:
            scale, unit = prefixed(max(sizes), unit)
            values = [v / scale if _is_number(v) else v for v in values]
            write = _decimals([size / scale for size in sizes], form or DIGITS)
    return unit, [_cell(v, write, form == "<") for v in values]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | str)


def _decimals(sizes: list[float], digits: int) -> str:
    """A format with as many decimals as the numbers need, at most two digits more than asked."""

    def places(size: float, digits: int) -> int:
        return digits - 1 - math.floor(math.log10(size))

    if max(sizes) >= 1e15 or max(sizes) < 1e-4:
        return f".{digits - 1}e"
    need = [
        len(f"{round(size, places(size, digits)):.12f}".rstrip("0").partition(".")[2])
        for size in sizes
    ]
    return f".{max(0, min(max(need), places(max(sizes), digits + 2)))}f"


def _cell(value: object, write: str | None, bound: bool) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool) or type(value).__name__ == "bool":  # NumPy's is no bool
        return "yes" if value else "no"
    if not _is_number(value):
        return str(value)
    if not math.isfinite(value):
        return NOTHING if math.isnan(value) else "∞" if value > 0 else "−∞"
    if bound:
        return f"< 1e{math.ceil(math.log10(max(abs(value), FLOOR)) - 1e-9):+03d}".replace("-", "−")
    if not value and (write or "").endswith("e"):
        return "0"
    text = format(value, write or "g")
    if not text.strip("-0.e+%"):
        text = text.removeprefix("-")  # never −0
    return text.replace("-", "−")


def _rich(text: str) -> str:
    """Escaped HTML; formulas stay between dollars, for the page's typesetter."""
    text = html.escape(text, quote=False)
    text = re.sub(r"`([^`]*)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", text)
