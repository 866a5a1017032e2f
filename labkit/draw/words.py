"""Pictures in words, made from what they show: the alternative text of a figure.

    described(figure)       # "y [m] over t [s]; 0 to 5 across, −1 to 11 up; 4 events"

In a notebook it stands in the picture's metadata, `"image/png": {"alt": …}`, where nbconvert's
templates look for it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from .ticks import said

#: What an artist says of itself by its gid: a mode's sample in a legend, the instants of events
MODE, EVENTS = "mode", "events"
_LIKE = {
    r"\uparrow": "↑",
    r"\downarrow": "↓",
    r"\leq": "≤",
    r"\geq": "≥",
    r"\cdot": "·",
    r"\times": "×",
    r"\infty": "∞",
    r"\pm": "±",
}


def plain(text: str) -> str:
    """plain("$\\\\theta_{1}$ [m]") -> "θ1 [m]": words without the signs of formulas."""
    text = re.sub(r"\\(?:mathrm|text|mathit|mathbf|dot|hat|bar|sqrt)\b", "", text)
    text = re.sub(r"\\d?frac\{([^{}]*)\}\{([^{}]*)\}", r"\1/\2", text)
    text = re.sub(r"\\[A-Za-z]+", _symbol, text).replace("\\,", "")
    return " ".join(re.sub(r"[\\${}_^]", "", text).split())


def _symbol(found: re.Match) -> str:
    if found[0] in _LIKE:
        return _LIKE[found[0]]
    word = found[0][1:].removeprefix("var")
    size = "CAPITAL" if word[:1].isupper() else "SMALL"
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {word.upper().replace('LAMBDA', 'LAMDA')}")
    except KeyError:
        return " "


def described(figure: Any) -> str:
    """described(figure) -> its axes with their ranges, curves, modes and events, in words."""
    parts = [_panel(axes) for axes in figure.axes if axes.get_visible()]
    title = figure.get_suptitle() if hasattr(figure, "get_suptitle") else ""
    return ". ".join(filter(None, [plain(title), *parts])) or "picture"


def _panel(axes: Axes) -> str:
    title = plain(axes.get_title("left") or axes.get_title())
    legend, headed = axes.get_legend(), getattr(axes, "headed", None)
    texts = legend.get_texts() if legend is not None else []
    entries = [" ".join(text.get_text().split()) for text in texts]  # of one line or two
    samples = {name: sample for sample, name in headed[1]} if headed else {}
    of_mode = [name for name in entries if name in samples and samples[name].get_gid() == MODE]
    modes = [plain(name) for name in of_mode]
    curves = [plain(name) for name in entries if name not in of_mode]
    written = [t for t in axes.texts if t.get_visible() and t.get_text().strip()]
    words = _once(plain(text.get_text()) for text in written)
    events = sum(
        int(np.isnan(line.get_xdata()).sum())
        for line in axes.get_children()
        if line.get_gid() == EVENTS
    )
    about = [
        _axes(axes) if axes.axison else "",
        f"curves {', '.join(curves)}" if curves else "",
        f"modes {', '.join(modes)}" if modes else "",
        f"{events} event{'s' * (events != 1)}" if events else "",
        f"in words: {', '.join(words)}" if words else "",
    ]
    text = "; ".join(filter(None, about))
    return f"{title}: {text}" if title and text else title or text


def _axes(axes: Axes) -> str:
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    across, up = plain(axes.get_xlabel()), plain(axes.get_ylabel())
    factor = getattr(axes.xaxis.get_major_formatter(), "factor", 1.0)  # seconds as ms
    across_to = f"{said(x0 * factor, 3)} to {said(x1 * factor, 3)}"
    up_to = f"{said(y0, 3)} to {said(y1, 3)}"
    log = [way for way in "xy" if getattr(axes, f"get_{way}scale")() == "log"]
    named = f"{up} over {across}; " if up and across else f"{up or across}; " if up + across else ""
    words = f"{named}{across_to} across, {up_to} up"
    return words + (f", logarithmic in {' and '.join(log)}" if log else "")


def _once(words: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(word for word in words if word))[:30]
