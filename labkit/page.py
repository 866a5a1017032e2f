"""A notebook as one page of HTML that needs no network: to read, to print, to hand out.

Formulas are written as MathML, which every browser shows by itself; pictures carry their
alternative texts; a cell whose source is hidden is folded. The page's form is in the template
labkit/jupyter/nbconvert/templates/labkit.
"""

from __future__ import annotations

import html
import os
import re
from collections import Counter
from pathlib import Path
from typing import Any

from jinja2 import pass_context
from math_core import LatexError, LatexToMathML
from nbconvert.exporters import HTMLExporter
from nbconvert.filters.markdown_mistune import IPythonRenderer, MarkdownWithMath

from .notebooks import FILTERS, TEMPLATES, read
from .run import write_whole

__all__ = ["Formulas", "Page", "formula", "markdown_to_html", "page", "typeset"]

_FORMULA = re.compile(r"\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
#: Code and tags of HTML, in which a $ is no formula
_NO_TEXT = re.compile(
    r"(<(?:pre|code|script|style)\b.*?</(?:pre|code|script|style)>|<[^>]*>)", re.DOTALL
)
_HEADING = re.compile(r'<h([1-6]) id="([^"]*)">(.*?)<a class="anchor-link" href="#[^"]*"')
_MATH = LatexToMathML(fancy_error=False)


def formula(latex: str, display: bool = False) -> str:
    """formula(r"\\\\frac{1}{2}") -> MathML; what it does not know is shown as it was written."""
    try:
        made = _MATH.convert_with_local_state(latex.strip(), displaystyle=display)
    except LatexError:
        mark = "$$" if display else "$"
        return f"<code>{html.escape(mark + latex + mark)}</code>"
    return made.replace("&ApplyFunction;", "\u2061")  # nbconvert reads headings as XML


class Formulas(IPythonRenderer):
    """nbconvert's writer of HTML for Markdown, its formulas as MathML."""

    def block_math(self, body: str) -> str:
        return formula(body, display=True)

    def inline_math(self, body: str) -> str:
        return formula(body)

    def latex_environment(self, name: str, body: str) -> str:
        return formula(rf"\begin{{{name}}}{body}\end{{{name}}}", display=True)


@pass_context
def markdown_to_html(context: Any, source: str) -> str:
    """The filter `markdown2html` of a template of nbconvert."""
    cell, resources = context.get("cell", {}), context.get("resources", {})
    writer = Formulas(
        escape=False,
        attachments=cell.get("attachments", {}),
        embed_images=True,
        path=resources.get("metadata", {}).get("path", ""),
    )
    return MarkdownWithMath(renderer=writer).render(source)


def typeset(text: str) -> str:
    """typeset("<td>$x^2$</td>") -> the same HTML, the formulas of its text as MathML; a filter."""
    pieces = _NO_TEXT.split(text)
    pieces[::2] = [
        _FORMULA.sub(lambda m: formula(html.unescape(m[1] or m[2]), bool(m[1])), piece)
        for piece in pieces[::2]
    ]
    return "".join(pieces)


def contents(text: str, levels: str = "2") -> str:
    """The filter `contents` of a template: before a page's cells links to headings of these levels.

    A heading that comes again, as in a report of several notebooks, gets a place of its own.
    """
    items, seen = [], Counter()

    def placed(found: re.Match) -> str:
        level, place, title = found.groups()
        seen[place] += 1
        place += f"-{seen[place]}" * (seen[place] > 1)
        if level in levels:
            items.append(f'<li class="labkit-h{level}"><a href="#{place}">{title}</a></li>')
        return f'<h{level} id="{place}">{title}<a class="anchor-link" href="#{place}"'

    text = _HEADING.sub(placed, text)
    links = "\n".join(items)
    nav = f'<nav class="labkit-contents" aria-label="Contents"><ol>\n{links}\n</ol></nav>\n'
    return nav * bool(levels) + text


class Page(HTMLExporter):
    """`jupyter nbconvert --to labkit.page.Page` does what `page` does."""

    def __init__(self, **options: Any):
        super().__init__(
            template_name="labkit",
            extra_template_basedirs=[str(TEMPLATES)],
            filters=FILTERS,
            **options,
        )


def page(notebook: str | os.PathLike, folder: str | os.PathLike = ".") -> Path:
    """page("notebooks/start.ipynb") -> path of start.html in the folder, from the saved results.

    Raises ModelError if it cannot be written there, and for a file that is no notebook.
    """
    path = Path(notebook)
    resources = {"metadata": {"name": path.stem, "path": str(path.parent)}}
    text, _ = Page().from_notebook_node(read(path), resources)
    return write_whole(Path(folder) / f"{path.stem}.html", text.encode())
