"""The 30 projects, the list of notebooks, and what start.ipynb keeps of its widget."""

import json

import numpy as np
import pytest

from labkit import course
from labkit.course import ASSIGNMENTS, HOME, assignment, catalogue, choose, project, refresh
from labkit.model import ModelError
from labkit.notebooks import WIDGET, found

# The handbook's table 5.1, row by row.
PART_1 = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12] * 2 + [1, 2, 3, 4, 5, 6]
PART_2 = (
    [
        "1.a",
        "1.b",
        "1.c",
        "1.d",
        "1.e",
        "1.f",
        "1.g",
        "1.h",
        "1.i",
        "1.j",
        "2.a",
        "2.b",
        "2.c",
        "2.d",
        "2.e",
        "2.f",
    ]
    * 2
)[:30]
PART_3 = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15] * 2


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A notebooks folder of its own, with two notebooks in it."""
    monkeypatch.setattr(course, "HOME", tmp_path)
    for name, lines in {
        "part3/06_dc_dc_converter": [
            "# Boost: up it goes\n\n*Assignment 6.* Twenty in, *forty* out?"
        ],
        "part2/my_own": ["text\n", "## My <own> relay\n\n|x| < 1"],
        "concepts/without": ["# Without words\n\n## 1. The task"],
        "part1/.ipynb_checkpoints/x": [],
    }.items():
        path = tmp_path / f"{name}.ipynb"
        path.parent.mkdir(parents=True)
        path.write_text(
            json.dumps(
                {
                    "cells": [
                        {"cell_type": "code", "source": ["# no heading"]},
                        {"cell_type": "markdown", "source": lines},
                    ]
                }
            ),
            encoding="utf-8",
        )
    return tmp_path


def test_table_of_the_handbook():
    for n in range(1, 31):
        one, two, three = project(n).assignments
        assert (int(one.name), two.name, int(three.name)) == (
            PART_1[n - 1],
            PART_2[n - 1],
            PART_3[n - 1],
        )
        assert (one.part, two.part, three.part) == (1, 2, 3)
    assert [a.name for a in project(13).assignments] == ["1", "2.c", "13"]
    assert [a.name for a in project(30).assignments] == ["6", "2.d", "15"]
    assert project(np.int64(13)) == project(13)


@pytest.mark.parametrize("wrong", [0, 31, -1, 2.5, 13.0, "x", "13", None, True])
def test_there_is_no_such_project(wrong):
    for function in (project, choose):
        with pytest.raises(ModelError, match="whole number from 1 to 30") as error:
            function(wrong)
        assert repr(wrong) in str(error.value)


def test_every_assignment_is_there_once():
    assert len([a for a in ASSIGNMENTS if a.name[0].isdigit()]) == 12 + 16 + 15
    assert (
        len({a.path for a in ASSIGNMENTS})
        == len({(a.part, a.name) for a in ASSIGNMENTS})
        == len(ASSIGNMENTS)
        == 55
    )
    assert len({a.story for a in ASSIGNMENTS}) == 55
    for a in ASSIGNMENTS:
        folder, name = a.path.split("/")
        assert (
            folder == (f"part{a.part}" if a.part else "concepts")
            and name == name.lower()
            and name.isascii()
        )
        # a sentence or two in a table, none of them told twice
        assert a.title and a.story[-1] in ".?" and 60 < len(a.story) < 420 and "|" not in a.story
        if a.name[0].isdigit():
            assert name.startswith(
                f"{int(a.name):02}_" if a.name.isdigit() else f"{a.name[0]}{a.name[2]}_"
            )
    assert {
        "part1/12_unstable_node_rotation",
        "part2/1b_relay_hysteresis",
        "part3/06_dc_dc_converter",
        "part3/00_sample_dry_friction",
    } <= {a.path for a in ASSIGNMENTS}


def test_assignment():
    assert assignment(2, "1.b") == assignment(2, "1b") == assignment(2, "1.B")
    assert assignment(3, 6).path == "part3/06_dc_dc_converter" == assignment(3, "6").path
    assert assignment(1, "sample").path == "part1/00_sample_stable_spiral"
    assert assignment(3, 6).notebook == HOME / "part3" / "06_dc_dc_converter.ipynb"
    for part, name, words in (
        (4, 1, "no part 4: the course has"),
        ("1", 1, "no part '1'"),
        (1, 13, "part 1 has no assignment 13; it has 'sample', '1'"),
        (2, "3.a", "no assignment '3.a'"),
    ):
        with pytest.raises(ModelError, match=words):
            assignment(part, name)


def test_links_only_to_what_is_there_and_names_what_is_to_come(folder):
    page = project(6)._repr_html_()
    assert '<a href="part3/06_dc_dc_converter.ipynb">DC-DC converter</a>' in page
    assert page.count("<a ") == 1 and page.count("no notebook yet") == 2
    assert "<code>part1/06_unstable_improper_node_matrix_b.ipynb</code>" in page
    assert "the handbook describes its model" in page
    assert assignment(3, 6).exists and not assignment(3, 5).exists
    assert "no notebook yet" in repr(project(6)) and "Project 6" in repr(project(6))


def test_catalogue_reads_the_disk(folder):
    page = catalogue()._repr_markdown_()
    story = "**Up it goes.** Twenty in, *forty* out?"
    assert f"| 6 | [DC-DC converter](part3/06_dc_dc_converter.ipynb) | {story} |" in page
    as_html = "<b>Up it goes.</b> Twenty in, <em>forty</em> out?"
    assert as_html in assignment(3, 6)._repr_html_() and as_html in project(6)._repr_html_()
    # a teacher's own, by its heading
    assert r"|  | [My \<own\> relay](part2/my_own.ipynb) | &#124;x&#124; < 1 |" in page
    assert "| [Without words](concepts/without.ipynb) |  |" in page
    assert page.count("](") == 3 and "checkpoint" not in page
    missing = page.split("*No notebook yet:*")[-2]
    assert "5 Automatic gearbox (`part3/05_automatic_gearbox`)" in missing
    assert "6 DC-DC converter" not in missing and "the handbook describes its model" in page
    assert "part2/my_own.ipynb" in repr(catalogue())
    (folder / "part2" / "broken.ipynb").write_text("{")
    marked = {"cells": [{"cell_type": "markdown", "source": "# Marked"}]}  # by an editor
    (folder / "part2" / "by_hand.ipynb").write_text(json.dumps(marked), encoding="utf-8-sig")
    assert "[Marked](part2/by_hand.ipynb)" in catalogue()._repr_markdown_()
    assert "[broken](part2/broken.ipynb)" in catalogue()._repr_markdown_()


def test_the_start_page_is_brought_up_to_date(folder):
    cells = [
        {"cell_type": "markdown", "metadata": {}, "source": ["# Start"]},
        {"cell_type": "markdown", "metadata": {"tags": ["catalogue"]}, "source": []},
    ]
    (folder / "start.ipynb").write_text(json.dumps({"cells": cells}), encoding="utf-8")
    assert refresh() and not refresh()
    kept, written = json.loads((folder / "start.ipynb").read_text(encoding="utf-8"))["cells"]
    assert kept == cells[0]
    assert "".join(written["source"]) == catalogue()._repr_markdown_()


def test_chooser_follows_its_slider_and_leaves_a_table_behind(folder, tmp_path, monkeypatch):
    (tmp_path / "notebooks").mkdir(exist_ok=True)
    monkeypatch.chdir(tmp_path / "notebooks")  # a kernel works in its notebook's folder
    shown = []

    class Place:
        update = shown.append

    monkeypatch.setattr(
        "IPython.display.display",
        lambda what, display_id=False: shown.append(what) or (Place if display_id else None),
    )
    assert choose(13) is None
    slider = shown[0]
    assert shown[1] == project(13)
    button, said = shown[2].children
    assert button.layout.width == "auto"  # 148 pixels, as it is otherwise, cut its words
    slider.value = 6
    assert shown[3:] == [project(6)]
    made = []
    monkeypatch.setattr("labkit.copies.copy_project", lambda *words: made.append(words))
    button.click()
    assert made == [(6, tmp_path / "project-6")] and "project-6" in said.value
    slider.value = 7
    assert said.value == ""

    def refuse(*words):
        raise ModelError("it has <that> already")

    monkeypatch.setattr("labkit.copies.copy_project", refuse)
    button.click()
    assert said.value == "it has &lt;that&gt; already"
    data = slider._repr_mimebundle_()
    assert (
        WIDGET in data
        and data["text/html"].count("<tr>") == 31
        and "<b>30</b>" in data["text/html"]
    )
    assert (
        '<a href="part3/06_dc_dc_converter.ipynb">DC-DC converter</a>' in data["text/html"]
        and "In italics" in data["text/html"]
    )


def test_saved_start_page_names_every_notebook():
    """`python -m labkit run` brings it up to date after a notebook was added."""
    saved = json.loads((HOME / "start.ipynb").read_text(encoding="utf-8"))
    text = "\n".join(
        "".join(cell["source"]) for cell in saved["cells"] if cell["cell_type"] == "markdown"
    )
    assert catalogue()._repr_markdown_() in text
    for path in found(HOME):
        if path.name != "start.ipynb":
            assert f"]({path.relative_to(HOME).as_posix()})" in text, path
    # The last cell is the chooser: there the page stands after Run All
    outputs = saved["cells"][-1]["outputs"]
    assert "choose(" in "".join(saved["cells"][-1]["source"])
    pages = "".join("".join(output.get("data", {}).get("text/html", "")) for output in outputs)
    assert pages.count("<tr>") >= 31
    assert not any(WIDGET in output.get("data", {}) for output in outputs)
    assert "widgets" not in saved["metadata"]
