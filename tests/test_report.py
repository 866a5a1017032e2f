"""Report and slides of a folder: numbered, self-contained, what fails is said and the rest kept."""

import json
import re
from pathlib import Path

import nbformat
import pytest

from labkit import ModelError
from labkit.browser import find_browser
from labkit.report import Ran, _report, _slides, report

MODEL = """\
from labkit import Mode, Parameter, System, check, explore, simulate, time_plot

system = System("swing", {"x": "m", "v": "m/s"}, {"k": Parameter(4.0, "1/s²", "stiffness", 1, 9)},
                [Mode("swings", lambda t, s, p: (s.v, -p.k * s.x))], start={"x": 1.0, "v": 0.0})"""
ONE = [
    "# First: a swing\n\nOne sentence about it.",
    "## 1 The model\n\nIt is $\\ddot x = -k x$.",
    MODEL,
    "## 2 The run",
    'time_plot(simulate(system, 5.0), "x", title="A swing")',
    "my_period = 3.0",
    'check(my_period, 3.14159, rel=0.1, hint="2π/√k")',
    "my_word = None",
    'check(my_word, "longer")',
    "## 3 Explore",
    'explore(system, 5.0, lambda run: time_plot(run, "x"), sliders=["k"], start=False,\n'
    "        method=False)",
]
TWO = ["# Second\n\nWords.", "## 1 Broken", "number = 1", "number / 0", "print(number)"]


def write(path, cells):
    made = []
    for k, text in enumerate(cells):
        kind = "markdown" if text.startswith("#") else "code"
        cell = {"cell_type": kind, "id": f"c{k}", "metadata": {}, "source": text}
        if kind == "code":
            cell |= {"outputs": [], "execution_count": None}
        made.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    page = {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    path.write_text(json.dumps(page), encoding="utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a project")
    write(folder / "one.ipynb", ONE)
    write(folder / "two.ipynb", TWO)
    said = []
    paths = report(folder, said.append)
    return folder, paths, said


def test_it_says_what_it_does_and_what_failed(made):
    folder, paths, said = made
    assert [path.name for path in paths][:2] == ["report.html", "slides.html"]
    assert ("report.pdf" in [path.name for path in paths]) == (find_browser() is not None)
    assert {line.partition(" of 2: ")[2][:13] for line in said} == {"one.ipynb", "two.ipynb, wh"}
    assert said[0][:7] == "1 of 2:" and "division by zero" in "".join(said)
    text = paths[0].read_text(encoding="utf-8")
    assert "two.ipynb, what failed: cell 4: ZeroDivisionError: division by zero" in text
    assert "This cell failed. ZeroDivisionError" in text and "Traceback" not in text
    assert "First: a swing" in text and "Second" in text


def test_the_report_has_contents_figures_formulas_and_answers(made):
    text = made[1][0].read_text(encoding="utf-8")
    contents = text[text.index("<nav") : text.index("</nav>")]
    assert contents.count("<li") == 6 and "First: a swing" in contents
    assert "<b>Figure 1.</b> A swing" in text and 'id="figure-2"' in text and "<math>" in text
    assert "Predictions and answers" in text and "1 of 2 right" in text
    row = text[text.index("<td>my_period</td>") :]
    assert row.startswith("<td>my_period</td><td>3</td><td>3.14159</td><td>10 %</td><td>✓</td>")
    assert "<td>my_word</td><td>–</td><td></td><td></td><td>…</td>" in text
    assert "labkit-recording" not in text[text.index("<main") :]
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_only_what_has_changed_runs_again(made, monkeypatch):
    folder, paths, _ = made
    ran = []
    monkeypatch.setattr(
        "labkit.report.executed",
        lambda path, **_: ran.append(path.name) or (_ for _ in ()).throw(AssertionError),
    )
    write(folder / "two.ipynb", TWO[:3])  # the failing one has run, too, and is not run again
    with pytest.raises(AssertionError):
        report(folder, lambda text: None)
    assert ran == ["two.ipynb"]
    write(folder / "two.ipynb", TWO)


def test_slides_follow_the_marks_or_what_is_worth_showing(made, browser):
    view = browser.new_context(viewport={"width": 1280, "height": 720}, offline=True).new_page()
    problems = []
    view.on("pageerror", lambda error: problems.append(str(error)))
    view.goto(made[1][1].as_uri())
    assert view.locator(".labkit-count").inner_text() == "1 / 4"
    assert view.locator("section.labkit-now").inner_text().startswith("First: a swing")
    view.keyboard.press("End")
    view.keyboard.press("ArrowLeft")
    assert view.locator(".labkit-count").inner_text() == "3 / 4"
    view.locator("section.labkit-now canvas[data-seq]").wait_for()
    view.get_by_label("k stiffness").focus()
    view.keyboard.press("ArrowRight")  # moves the slider, not the slides
    assert view.locator(".labkit-count").inner_text() == "3 / 4"
    assert view.get_by_label("value of k").input_value() == "4.4"
    assert not problems


def test_folders_that_are_no_project(tmp_path):
    with pytest.raises(ModelError, match="there is no folder"):
        report(tmp_path / "nowhere")
    with pytest.raises(ModelError, match="no notebooks"):
        report(tmp_path)
    write(tmp_path / "one.ipynb", ONE)
    (tmp_path / "broken.ipynb").write_text("{")
    said = []
    with pytest.raises(ModelError, match=r"broken.ipynb' is no notebook .*: take another one"):
        report(tmp_path, said.append)
    assert not said and not list(tmp_path.glob("*.html"))  # before anything has run


def test_a_folder_that_cannot_be_written_is_said_before_anything_runs(tmp_path, monkeypatch):
    write(tmp_path / "one.ipynb", ONE)
    (tmp_path / ".labkit").write_text("a file in the way")
    monkeypatch.setattr("labkit.report.executed", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(ModelError, match="cannot be written .*choose a folder"):
        report(tmp_path, lambda text: None)


def test_a_notebook_that_was_edited_by_hand(tmp_path):
    """Cells without names and results, a raw cell, a title that looks like HTML, a damaged copy
    of what had run, an editor's mark at the beginning of the file.
    """
    cells = [
        {"cell_type": "markdown", "source": '# A <b>bold</b> "title" & Übung'},
        {"cell_type": "raw", "metadata": {}, "source": "raw"},
        {"cell_type": "code", "source": "print(6 * 7)"},
        {"cell_type": "code", "source": ""},
    ]
    page = {"cells": cells, "nbformat": 4, "nbformat_minor": 5}
    text = json.dumps(page, ensure_ascii=False)
    (tmp_path / "by hand.ipynb").write_text(text, encoding="utf-8-sig")
    (tmp_path / ".labkit").mkdir()
    (tmp_path / ".labkit" / "by hand.ipynb").write_text('{"cells": [')
    made, slides, *_ = report(tmp_path, lambda text: None)
    found = made.read_text(encoding="utf-8")
    assert ">42" in found.replace("\n", "") and "Übung" in found
    for path in (made, slides):
        head = path.read_text(encoding="utf-8").partition("</title>")[0]
        assert "<b>" not in head.rpartition("<title>")[2]


def test_a_notebook_of_code_only_has_a_slide_and_its_own_name():
    cells = [nbformat.v4.new_code_cell("# set up\nprint(1)")]
    text = _slides([Ran(Path("oven.ipynb"), nbformat.v4.new_notebook(cells=cells))])
    assert text.count("<section>") == 1 and "<title>oven</title>" in text


def test_headings_of_the_same_words_have_places_of_their_own():
    def one(name):
        cells = [nbformat.v4.new_markdown_cell(f"# {name}\n\n## 1 Task\n\n```\n## none\n```")]
        return Ran(Path(f"{name}.ipynb"), nbformat.v4.new_notebook(cells=cells))

    text = _report([one("a"), one("b")])
    nav = text[text.index("<nav") : text.index("</nav>")]
    places = ["a", "1-Task", "b", "1-Task-2"]
    assert re.findall(r'href="#(.*?)"', nav) == places
    assert re.findall(r'<h[12] id="(.*?)"', text) == places
