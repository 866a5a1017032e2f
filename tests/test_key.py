"""A teacher's key: the workbook's answers for a student's values, beside the student's own."""

import json

import pytest

from labkit import ModelError
from labkit.course import HOME
from labkit.key import _makes, key

SAMPLE = "part3/00_sample_dry_friction"


def copy(folder, *changes):
    page = json.loads((HOME / f"{SAMPLE}.ipynb").read_text(encoding="utf-8"))
    page["metadata"]["labkit"] = {"project": 13, "assignment": SAMPLE}
    done = 0
    for cell in page["cells"]:
        text = "".join(cell["source"])
        for old, new in changes:
            done += old in text
            text = text.replace(old, new)
        cell["source"] = text
        if cell["cell_type"] == "code":
            cell["outputs"] = []
    assert done == len(changes)
    (folder / "mine.ipynb").write_text(json.dumps(page), encoding="utf-8")


def test_the_key_is_for_the_students_values(tmp_path):
    """Twice the pull: the first slip comes after half the time, Fs/(k Vp) = 0.735 s."""
    copy(
        tmp_path,
        ('"Vp": Parameter(2.0', '"Vp": Parameter(4.0'),
        ('print(f"period ', 'print(f"my period '),
    )
    (found,) = key(tmp_path)
    assert found.changed == ["system: Vp = 4 (workbook 2)"]
    (line,) = (pair for pair in found.lines if "first slip" in pair[0])
    assert line[0] == line[1] and "0.735000 s" in line[0]
    differ = [pair for pair in found.lines if pair[0] != pair[1]]
    assert len(differ) == 1 and differ[0][0].startswith("period")
    assert differ[0][1].startswith("my period")
    text = str(found)
    assert "key: period" in text and "has: my period" in text
    right = {name: right for name, right, _, _ in found.answers}
    assert right["my_first_slip"] == "0.735 (within 0.1 %)"
    assert all(mark == "…" for *_, mark in found.answers)


def test_what_is_no_students_folder(tmp_path):
    with pytest.raises(ModelError, match="no copies that"):
        list(key(tmp_path))
    (tmp_path / "x.ipynb").write_text("{")
    with pytest.raises(ModelError, match="no copies that"):
        list(key(tmp_path))
    with pytest.raises(ModelError, match="there is no project 31"):
        list(key(31))


def test_models_are_found_where_a_cell_names_them():
    text = "system, horizon = make(), 3.0\nfor system_two in ():\n    pass\nother = system"
    assert _makes({"cell_type": "code", "source": text}) == ["system"]
    text = "system.note = 3\nd[system.name] = 1\nd[system] = system"
    assert _makes({"cell_type": "code", "source": text}) == []
