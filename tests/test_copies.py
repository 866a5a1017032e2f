"""A student's own copies: of any project, whole or not at all, nothing overwritten."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from labkit import ModelError, project
from labkit.copies import REPORT, copy_project
from labkit.course import PROJECTS

WHOLE = [n for n in range(1, PROJECTS + 1) if all(a.exists for a in project(n).assignments)]


@pytest.mark.parametrize("number", WHOLE)
def test_four_notebooks_of_each_project(number, tmp_path):
    paths = copy_project(number, tmp_path / "mine")
    assert len(paths) == 4 and paths[-1].name == REPORT
    for path, a in zip(paths, project(number).assignments, strict=False):
        page = json.loads(path.read_text(encoding="utf-8"))
        assert page["metadata"]["labkit"] == {"project": number, "assignment": a.path}
        assert not any(cell.get("outputs") for cell in page["cells"])
        own = json.loads(a.notebook.read_text(encoding="utf-8"))
        code = [["".join(c["source"]) for c in p["cells"] if c["cell_type"] == "code"]
                for p in (page, own)]  # fmt: skip
        assert code[0] == code[1]


def test_links_lead_from_the_new_place_to_the_workbook(tmp_path):
    for path in copy_project(WHOLE[0], tmp_path / "own place" / "Übung"):
        page = json.loads(path.read_text(encoding="utf-8"))
        for cell in page["cells"]:
            if cell["cell_type"] == "markdown":
                for link in re.findall(r"\]\(([^)#]+\.ipynb)", "".join(cell["source"])):
                    assert (path.parent / link).resolve().is_file(), link


def test_the_report_asks_what_the_handbook_asks(tmp_path):
    number = np.int64(WHOLE[0])  # of a slider's range, say
    page = json.loads(copy_project(number, tmp_path / "mine")[-1].read_text(encoding="utf-8"))
    text = "\n".join("".join(cell["source"]) for cell in page["cells"])
    assert f"# Mini-project {WHOLE[0]}" in text and page["metadata"]["labkit"]["project"]
    for a in project(WHOLE[0]).assignments:
        assert a.title in text
    for head in ("The model", "Values and reasons", "Experiments", "The algorithm", "Theory"):
        assert text.count(f"### {head}") == 3
    assert "## A problem of my own" in text and "## The environment" in text
    assert {cell["metadata"]["slideshow"]["slide_type"] for cell in page["cells"]} == {
        "slide",
        "skip",
    }


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path):
    folder = tmp_path / "mine"
    paths = copy_project(WHOLE[0], folder)
    paths[1].write_text("my work")
    paths[0].unlink()
    with pytest.raises(ModelError, match=r"has '.*' already, and nothing was written"):
        copy_project(WHOLE[0], folder)
    assert paths[1].read_text() == "my work" and not paths[0].exists()
    assert sorted(folder.iterdir()) == sorted(paths[1:])


@pytest.mark.parametrize("number", [0, 31, -1, 1.5, "x"])
def test_a_number_that_is_no_project(number, tmp_path):
    with pytest.raises(ModelError, match="there is no project"):
        copy_project(number, tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(ModelError, match="cannot be written"):
        copy_project(WHOLE[0], tmp_path / "file")
    moved = []

    def full(source, goal):
        moved.append(goal)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("labkit.copies.os.replace", full)
    with pytest.raises(ModelError, match="No space left on device"):
        copy_project(WHOLE[0], tmp_path / "mine")
    assert moved and os.listdir(tmp_path / "mine") == []


@pytest.mark.parametrize("way", ["beside", "interrupted"])
def test_another_call_on_the_same_folder_and_an_interrupt_leave_nothing_of_this_one(
    tmp_path, monkeypatch, way
):
    """Both have looked and found the folder empty; of two one gets it."""
    folder, touch = tmp_path / "mine", Path.touch

    def late(path, **options):
        if path.name == REPORT:
            if way == "interrupted":
                raise KeyboardInterrupt
            path.write_text("of the other call")
        touch(path, **options)

    monkeypatch.setattr(Path, "touch", late)
    with pytest.raises(KeyboardInterrupt if way == "interrupted" else ModelError):
        copy_project(WHOLE[0], folder)
    left = {path.name: path.read_text() for path in folder.iterdir()}
    assert left == ({} if way == "interrupted" else {REPORT: "of the other call"})
