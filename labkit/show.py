"""How names are shown: one rule for equations, tables and axes. It needs no other package."""

from __future__ import annotations

import re
import unicodedata

__all__ = ["latex_name", "split_name"]

_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau "
    "upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
)
GREEK = frozenset(_GREEK.split())
_SHORT = {"lam": "lambda", "lamda": "lambda", "eps": "epsilon", "om": "omega"}
# The forms that a course on mechanics prints
_VARIANT = {"epsilon": "\\varepsilon", "phi": "\\varphi"}
# What an index is often called
_WORDS = {"max", "min", "ref", "low", "high", "in", "out", "eq", "crit", "rest", "set", "off", "on"}


def latex_name(name: str) -> str:
    """latex_name("F_s") -> "F_{s}": LaTeX of the Python name of a state, parameter or helper."""
    head, index = split_name(name)
    return f"{head}_{{{index}}}" if index else head


def split_name(name: str) -> tuple[str, str]:
    """split_name("omega1") -> ("\\\\omega", "1"): the letter, and the index below it ("" if none).

    The letter may carry a dot. Greek letters are spelled (omega, phi1, lambda_) or written (ω);
    what follows _ or is a number is an index, and so is the second part of a short name like Vp,
    iL, Td, kr, Cmax, vref. Other names of several letters are words: mass, restitution.
    """
    first, *rest = [part for part in _spelled(name).split("_") if part] or [name]
    head, below = first, ""
    if first not in GREEK and first not in _WORDS and len(first) > 1:
        greek = next((first[:k] for k in range(len(first) - 1, 1, -1) if first[:k] in GREEK), "")
        tail = first[len(greek) :] if greek else first[1:]
        index = len(tail) == 1 if greek else _is_index(first[0], tail)
        if index or tail.isdigit() or tail in _WORDS:
            head, below = first[: len(first) - len(tail)], tail
        elif match := re.fullmatch(r"(\D{2,})(\d+)", first):  # mass2
            head, below = match.groups()
    return _letter(head), ",".join(_letter(part) for part in [below, *rest] if part)


def _is_index(letter: str, tail: str) -> bool:
    """Vp, iL, Fs, kw, Hst, ktr are a letter with an index; gap and rod are words."""
    if len(tail) == 2:
        vowels = set(tail.lower()) & set("aeiouy")
        return not vowels or (letter.isupper() and tail.islower())
    return len(tail) == 1


def _spelled(name: str) -> str:
    """Greek letters written as such become their names: ω0 -> omega0."""
    parts = []
    for char in name:
        words = unicodedata.name(char, "").split()
        if words[:1] == ["GREEK"] and words[-2:-1] == ["LETTER"]:
            word = {"LAMDA": "lambda"}.get(words[-1], words[-1].lower())
            parts.append(word.capitalize() if words[1] == "CAPITAL" else word)
        else:
            parts.append(char)
    return "".join(parts)


def _letter(part: str) -> str:
    part = _SHORT.get(part, part)
    if part in GREEK:
        return _VARIANT.get(part, f"\\{part}")
    short = len(part) == 1 or part.isdigit() or (len(part) == 2 and part[1].isdigit())
    return part if short else f"\\mathrm{{{part}}}"
