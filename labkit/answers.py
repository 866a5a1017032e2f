"""Answers of a student, looked at: predictions before a result, and tasks that check themselves.

my_period = None                                         # the student writes 4.7 here
check(my_period, 4.7475, rel=1e-2, hint="The block rests, too: add the time of sticking.")
"""

from __future__ import annotations

import cmath
import math
import os
from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Any

__all__ = ["Check", "check"]

MIME = "application/vnd.labkit.check+json"
MARKS = {True: "✓", False: "✗", None: "…"}


@dataclass(frozen=True)
class Check:
    """What `check` found: `ok` is True, False, or None (no answer yet); `text` says it.

    `within` is what it allowed, as the report says it: "1 %"; nothing for words.
    It shows itself as the last line of a cell, and `bool(found)` is True only for a right answer.
    """

    answer: Any
    right: Any
    ok: bool | None
    text: str
    within: str = ""

    def __bool__(self) -> bool:
        return self.ok is True

    def __repr__(self) -> str:
        return f"{MARKS[self.ok]} {self.text}"

    def _repr_markdown_(self) -> str:
        return f"**{MARKS[self.ok]}** {self.text}"

    def _repr_mimebundle_(self, **_: object) -> dict[str, Any]:
        """Beside it, while a report is being made, what that lists."""
        if not os.environ.get("LABKIT_RECORD"):
            return {}
        said = {"answer": _short(self.answer), "right": _short(self.right), "within": self.within}
        return {MIME: {"ok": self.ok, **said}}


def check(answer: Any, right: Any, *, rel: float = 1e-2, abs: float = 0.0, hint: str = "") -> Check:
    """check(my_period, 4.7475, rel=1e-2, hint="…") -> ✓, ✗ with the hint, or "no answer yet".

    right   a number (complex, too); a word; True or False; a list of them, to be answered by as
            many in this order; or a set of words that are all right
    rel     how far a number may be from the right one, as a part of the right one's size
    abs     the same in the right one's unit; the larger of both counts. A right answer of 0
            needs it
    hint    a sentence for who is wrong; Markdown and formulas may be in it

    An answer of None is no answer yet. Upper and lower case, blanks and a full stop do not matter
    in words. A wrong number is compared with the right one's opposite and with powers of ten of
    it, since a sign or a unit is what is most often wrong. Whatever the answer is, a sentence comes
    back and never an exception, so that the cells below still run.
    """
    try:
        ok, text = _judged(answer, right, rel, abs)
        within = _within(right, rel, abs)
    except Exception as error:  # an answer may be any object, with an == of its own
        ok, within = False, ""
        text = f"this answer cannot be compared ({type(error).__name__}: {error})."
    text = f"{text} {hint}".strip() if ok is False else text
    return Check(answer, right, ok, text, within)


def _judged(answer: Any, right: Any, rel: float, abs: float) -> tuple[bool | None, str]:
    if answer is None or answer is Ellipsis or (isinstance(answer, str) and not answer.strip()):
        return None, "No answer yet: write yours in place of `None` and run the cell again."
    if isinstance(right, str | Set):
        return _word(answer, {right} if isinstance(right, str) else right)
    if _yes_or_no(right):
        if _yes_or_no(answer):
            return _verdict(bool(answer) == bool(right), answer)
        return False, f"{_said(answer)} is neither `True` nor `False`."
    return (_several if _many(right) else _number)(answer, right, rel, abs)


def _within(right: Any, rel: float, abs: float) -> str:
    """What is allowed, the larger of both; of several values each that is allowed for one."""
    if _many(right) and not isinstance(right, Set):
        return " or ".join(dict.fromkeys(filter(None, (_within(x, rel, abs) for x in right))))
    size = None if _plain(right) else _complex(right)
    if size is None:
        return ""
    return f"{abs:.3g}" if abs > rel * _size(size) else f"{100 * rel:.3g} %"


def _word(answer: Any, right: Set[str]) -> tuple[bool, str]:
    if not isinstance(answer, str):
        return False, f"{_said(answer)} is no word: write it in quotes."
    word, *plain = (" ".join(w.lower().strip(" .!").split()) for w in (answer, *right))
    return _verdict(word in plain, answer)


def _several(answer: Any, right: Any, rel: float, abs: float) -> tuple[bool | None, str]:
    if not _many(answer):
        return False, f"{_said(answer)} is one value; here are {len(right)} asked for, in brackets."
    if len(answer) != len(right):
        return False, f"There are {len(right)} values asked for, not {len(answer)}."
    found = [_judged(*pair, rel, abs) for pair in zip(answer, right, strict=True)]
    if any(ok is None for ok, _ in found):
        return None, "No answer yet: one of the values is still missing."
    wrong = [number for number, (ok, _) in enumerate(found, 1) if not ok]
    if not wrong:
        return _verdict(True, answer)
    which = f"value{'s' * (len(wrong) > 1)} {', '.join(map(str, wrong))} of {len(right)}"
    return False, f"Not yet: {which}."


def _number(answer: Any, right: Any, rel: float, abs: float) -> tuple[bool, str]:
    if isinstance(answer, str):
        if any(letter.isdigit() for letter in answer):
            return False, f"{_said(answer)} is a text: write the number without quotes."
        return _verdict(False, answer)  # a word where words, too, were asked for
    if isinstance(answer, bool) or _many(answer):
        return False, f"{_said(answer)} is not one number."
    value, goal = _complex(answer), _complex(right)
    if value is None:
        return False, f"{_said(answer)} is no number."
    if goal is None or not cmath.isfinite(goal):
        return False, f"There is nothing to compare with: the right answer came out as {right!r}."
    if not cmath.isfinite(value):
        return False, f"{_said(answer)} is not a finite number."
    near = max(rel * _size(goal), abs)

    def close(other: complex) -> bool:
        return _size(other - goal) <= near * (1 + 1e-12)

    if close(value):
        return _verdict(True, answer)
    if goal and close(-value):
        return False, f"{_said(answer)} has the right size, but not the right sign."
    if goal and value:
        power = round(math.log10(_size(value) / _size(goal)))
        if power and close(value * 10.0**-power):
            times = f"$10^{{{power}}}$".replace("-", "−")
            return False, f"{_said(answer)} is {times} times the right number."
    return _verdict(False, answer)


def _verdict(ok: bool, answer: Any) -> tuple[bool, str]:
    return ok, f"{_said(answer)} is {'right' if ok else 'not right yet'}."


def _many(value: Any) -> bool:
    """Whether it is a list, a tuple, an array or a matrix of values."""
    if isinstance(value, Sequence | Set):
        return not isinstance(value, str)
    return getattr(value, "shape", ()) != () and hasattr(value, "__iter__")


def _complex(value: Any) -> complex | None:
    """As a complex number, for everything that is a number: of Python, NumPy or SymPy."""
    if isinstance(value, str):
        return None
    try:
        return complex(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _size(value: complex) -> float:
    """Infinite where the built-in abs raises OverflowError."""
    return math.hypot(value.real, value.imag)


def _short(value: Any) -> str:
    """A value in a table: numbers with six digits."""
    if _many(value):
        words = map(_short, value)
        return ", ".join(sorted(words) if isinstance(value, Set) else words)
    number = None if _plain(value) else _complex(value)
    if number is None:
        return str(value)
    return f"{number.real:.6g}" if not number.imag else f"{number:.6g}"


def _plain(value: Any) -> bool:
    return isinstance(value, str | None) or _yes_or_no(value)


def _yes_or_no(value: Any) -> bool:
    """True or False, of Python or of any NumPy."""
    return isinstance(value, bool) or type(value).__name__ in ("bool_", "bool")


def _said(answer: Any) -> str:
    text = repr(answer.item() if hasattr(answer, "item") and not _many(answer) else answer)
    return f"`{text if len(text) <= 60 else text[:57] + '…'}`".replace("\n", " ")
