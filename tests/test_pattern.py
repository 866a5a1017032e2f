"""The pattern of a notebook, as far as a test can hold it.

Predictions come before what gives them away and are compared afterwards; tasks check themselves;
the model is what one sees, drawing is folded; lines fit the page; links lead on and back.
"""

import ast
import re

import pytest

from .helpers import ASSIGNMENTS, CONCEPTS, read, source

WIDTH = 100
TALLEST = 30  # lines of a cell in sight: what a student sees at once
# As much as a student reads in an evening: lines of code in sight, words of prose
MOST = {name: (172, 1840) for name in [*ASSIGNMENTS, "guide"]}
MOST |= {name: (290, 2530) for name in CONCEPTS}
DRAWS = re.compile(r"\b(ax\w*|axes(\[\d\])?|sketch|plt|fig\w*|picture)\.\w+\(|\bax\.set\b")

pytestmark = pytest.mark.parametrize("name", MOST)  # the guide shows how, and keeps to it


def cells(name, kind):
    """[(place, source, folded)] of all cells of a kind."""
    return [
        (place, source(cell), cell["metadata"].get("jupyter", {}).get("source_hidden", False))
        for place, cell in enumerate(read(name)["cells"])
        if cell["cell_type"] == kind
    ]


def answers(name):
    """{my_…: (place where it is None, places where it is checked)}."""
    asked, checked = {}, {}
    for place, text, _ in cells(name, "code"):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Assign) and ast.unparse(node.value) == "None":
                for target in node.targets:
                    if isinstance(target, ast.Name) and target.id.startswith("my_"):
                        asked[target.id] = place
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "check":
                for part in ast.walk(node.args[0]):
                    if isinstance(part, ast.Name) and part.id.startswith("my_"):
                        checked.setdefault(part.id, []).append(place)
    return {key: (place, checked.get(key, [])) for key, place in asked.items()}


def test_what_is_asked_is_checked_later(name):
    for key, (asked, checked) in answers(name).items():
        assert checked and min(checked) >= asked, f"{key} is asked in cell {asked}"


def test_at_least_two_predictions_come_before_what_gives_them_away(name):
    """Asked in a cell of their own, after the words that ask; checked in a later one."""
    text = {place: words for place, words, _ in cells(name, "markdown")}
    before = [
        key
        for key, (asked, checked) in answers(name).items()
        if checked and min(checked) > asked and "> **Predict" in text.get(asked - 1, "")
    ]
    assert len(before) >= 2, before


def test_at_least_two_tasks_check_themselves_and_one_asks_for_a_judgement(name):
    tasks = max(
        place
        for place, text, _ in cells(name, "markdown")
        if re.search(r"^## \d.*[Tt]ask", text, re.M)
    )
    own = [key for key, (asked, _) in answers(name).items() if asked > tasks]
    assert len(own) >= 2, own
    words = " ".join(text for place, text, _ in cells(name, "markdown") if place >= tasks)
    assert re.search(r"\b[Jj]udge", words), "a task asks for a judgement of the tool"


def test_lines_fit_the_page(name):
    for place, text, _ in cells(name, "code"):
        for line in text.splitlines():
            assert len(line) <= WIDTH, f"cell {place}: {line}"


def test_a_cell_is_seen_at_once(name):
    tall = {
        place: len(text.splitlines()) for place, text, folded in cells(name, "code") if not folded
    }
    assert max(tall.values()) <= TALLEST, tall


def test_it_is_an_evenings_reading(name):
    lines = sum(len(text.splitlines()) for _, text, folded in cells(name, "code") if not folded)
    words = sum(len(text.split()) for _, text, _ in cells(name, "markdown"))
    assert lines <= MOST[name][0] and words <= MOST[name][1], (lines, words)


def test_drawing_is_folded(name):
    for place, text, folded in cells(name, "code"):
        drawn = [line for line in text.splitlines() if DRAWS.search(line)]
        assert folded or len(drawn) <= 3, f"cell {place} draws: " + "\n".join(drawn)
        assert folded or not re.search(r"^class \w*", text, re.M), f"cell {place} has a class"


def test_links_lead_to_a_concept_and_back_to_the_start(name):
    words = [text for _, text, _ in cells(name, "markdown")]
    assert re.search(r"\]\(((\.\./)?concepts/)?[a-z_]+\.ipynb\)", " ".join(words[:2])), (
        "Before you start"
    )
    assert re.search(r"\]\((\.\./)?start\.ipynb\)$", words[-1]), "the last line leads back"


def test_a_run_is_exported_and_a_length_is_varied(name):
    code = "\n".join(text for _, text, _ in cells(name, "code"))
    assert re.search(r"\.to_(csv|npz)\(", code)
