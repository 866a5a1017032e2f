"""What every saved notebook must be (a contract), and what runs, strips and completes them."""

import ast
import base64
import copy
import json
import re
import sys

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError

from labkit import notebooks, simulate
from labkit.notebooks import (
    WIDGET,
    complete,
    execute,
    execute_all,
    found,
    in_one_line,
    pre_save_hook,
    state,
    strip,
)

from .helpers import ASSIGNMENTS, CONCEPTS, FOLDER, NOTEBOOKS, code_cells, load, read, source

PICTURES = ("image/png", "image/jpeg", "image/svg+xml")


def outputs(notebook):
    return [output for cell in code_cells(notebook) for output in cell["outputs"]]


# ---- the contract


def test_the_start_page_and_the_samples_are_there():
    assert {
        "start",
        "part1/00_sample_stable_spiral",
        "part2/00_sample_relay_hysteresis",
        "part3/00_sample_dry_friction",
    } <= set(NOTEBOOKS)
    assert [path.relative_to(FOLDER).with_suffix("").as_posix() for path in found()] == NOTEBOOKS


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_is_a_valid_notebook_saved_after_a_run_from_the_top(name):
    notebook = read(name)
    nbformat.validate(notebook)
    assert notebook["nbformat"] == 4 and notebook["metadata"]["kernelspec"]["name"] == "python3"
    cells = code_cells(notebook)
    assert cells and [cell["execution_count"] for cell in cells] == list(
        range(1, len(cells) + 1)
    ), "run it: python -m labkit run"
    for output in outputs(notebook):
        assert output["output_type"] != "error", output
        assert output.get("name") != "stderr", output


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_keeps_nothing_of_a_widget_or_a_run(name):
    notebook = read(name)
    assert strip(copy.deepcopy(notebook)) == notebook, "run it: python -m labkit run"
    assert not any(WIDGET in output.get("data", {}) for output in outputs(notebook))


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_it_is_small(name):
    assert (FOLDER / f"{name}.ipynb").stat().st_size < 2_000_000
    for output in outputs(read(name)):
        if "image/png" in output.get("data", {}):
            assert len(base64.b64decode(output["data"]["image/png"])) <= 60_000


@pytest.mark.parametrize("name", [*ASSIGNMENTS, "guide"])
def test_it_has_the_nine_steps_in_order(name):
    text = "\n".join(
        source(cell) for cell in read(name)["cells"] if cell["cell_type"] == "markdown"
    )
    assert [int(number) for number in re.findall(r"^## (\d)\b", text, re.MULTILINE)] == list(
        range(1, 10)
    )


@pytest.mark.parametrize("name", [*ASSIGNMENTS, "guide"])
def test_it_states_system_and_horizon_before_the_first_picture_but_a_sketch(name):
    known: set[str] = set()
    for cell in code_cells(read(name)):
        tree = ast.parse(source(cell))
        known |= {
            node.id
            for node in ast.walk(tree)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        if {"system", "horizon"} <= known:
            return
        drawn = any(
            kind in output.get("data", {}) for output in cell["outputs"] for kind in PICTURES
        )
        assert not drawn or "Sketch" in source(cell), (
            f"a picture before system and horizon are defined:\n{source(cell)}"
        )
    pytest.fail("it defines no system and horizon")


@pytest.mark.parametrize("name", CONCEPTS)
def test_a_concept_has_its_own_headings_numbered_and_a_prediction(name):
    """A concept follows its own thread.

    But it predicts before it shows, and ends with answers and tasks.
    """
    text = "\n".join(
        source(cell) for cell in read(name)["cells"] if cell["cell_type"] == "markdown"
    )
    headings = re.findall(r"^## (\d+) (.+)$", text, re.MULTILINE)
    assert len(headings) >= 4 and [int(number) for number, _ in headings] == list(
        range(1, len(headings) + 1)
    )
    assert [title for _, title in headings[-2:]] == ["The answers", "Tasks to try"]
    assert "> **Predict" in text


@pytest.mark.parametrize("name", [*ASSIGNMENTS, *CONCEPTS, "guide"])
def test_it_has_a_panel_and_answers_that_nbval_compares(name):
    cells = code_cells(read(name))
    checked = [cell for cell in cells if "# NBVAL_CHECK_OUTPUT" in source(cell)]
    assert checked and all(cell["outputs"] for cell in checked)
    assert any("explore(" in source(cell) for cell in cells)


@pytest.mark.parametrize("name", ASSIGNMENTS)
def test_its_system_runs_to_its_horizon(name):
    names = load(name, "system", "horizon")  # they do not change: all cells run elsewhere
    run = simulate(names["system"], names["horizon"])
    assert run.stopped.startswith("terminal event") or (
        run.stopped == "finished" and run.t[-1] == names["horizon"]
    ), run.stopped


# ---- running and stripping


def notebook(*cells):
    made = nbformat.v4.new_notebook(
        cells=[
            nbformat.v4.new_code_cell(text, id=f"cell-{number}")
            for number, text in enumerate(cells)
        ]
    )
    made.metadata["kernelspec"] = {
        "display_name": "whatever",
        "language": "python",
        "name": "python3",
    }
    return made


@pytest.fixture
def saved(tmp_path):
    def save(*cells):
        path = tmp_path / "small.ipynb"
        nbformat.write(notebook(*cells), path)
        return path

    return save


PANEL = """\
from labkit import Mode, System, explore
turn = Mode("turn", lambda t, s, p: (p.w * s.y, -p.w * s.x))
start = {"x": 1.0, "y": 0.0}
system, horizon = System("circle", {"x": "", "y": ""}, {"w": 1.0}, [turn], start=start), 5.0
explore(system, horizon)"""


def test_a_notebook_run_twice_is_the_same_file_and_keeps_the_panels_picture_only(saved):
    path = saved(
        PANEL,
        "import sys\nprint('one'); print('two', flush=True)\nprint('three')",
        "import ipywidgets\nipywidgets.IntSlider()",
    )
    first = execute(path).read_bytes()
    (panel,), (stream,), (slider,) = (cell["outputs"] for cell in json.loads(first)["cells"])
    assert (
        set(panel["data"]) == {"image/png", "text/plain"}
        and "".join(panel["data"]["text/plain"]) == "panel of 'circle'"
    )
    assert "".join(stream["text"]) == "one\ntwo\nthree\n"
    assert set(slider["data"]) == {"text/plain"} and "model" not in str(slider)
    assert (
        "widgets" not in json.loads(first)["metadata"]
        and "version" not in json.loads(first)["metadata"]["language_info"]
    )
    assert execute(path).read_bytes() == first


def test_an_error_is_named_by_a_line_of_words():
    """The text of a cell that had too little time ends with a rule."""
    assert in_one_line(TimeoutError("A cell timed out.\nx = 1\n-------\n")) == "x = 1"
    assert in_one_line(ValueError("-----\nfirst\nlast"), first=True) == "first"
    assert in_one_line(KeyError()) == "KeyError"


def test_a_notebook_that_fails_is_left_as_it_was(saved, capsys):
    path = saved("x = 1", "1 / (x - 1)")
    before = path.read_bytes()
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        execute(path)
    assert path.read_bytes() == before
    assert execute_all([str(path), str(path.with_name("missing.ipynb"))]) == 2
    assert "ZeroDivisionError" in capsys.readouterr().out


def test_strip_takes_widgets_stamps_and_cuts_and_leaves_the_rest():
    made = notebook("a")
    cell, data = made.cells[0], {"text/plain": "panel", "image/png": "AAAA"}
    made.metadata |= {
        "widgets": {"state": {}},
        "language_info": {"name": "python", "version": "3.11.7"},
    }
    cell.metadata |= {"execution": {"iopub.status.idle": "2024-01-01"}, "tags": ["kept"]}
    cell.outputs = [
        {
            "output_type": "display_data",
            "data": {**data, WIDGET: {"model_id": "12ab"}},
            "metadata": {},
        },
        {
            "output_type": "display_data",
            "data": {WIDGET: {"model_id": "12ab"}, "text/plain": "Box(id=3)"},
            "metadata": {},
        },
        {"output_type": "stream", "name": "stdout", "text": "a"},
        {"output_type": "stream", "name": "stdout", "text": ["b\n", "c"]},
        {"output_type": "stream", "name": "stderr", "text": "d"},
    ]
    assert strip(made) is made
    assert made.metadata["language_info"] == {"name": "python"} and "widgets" not in made.metadata
    assert cell.metadata == {"tags": ["kept"]}
    assert [output.get("data") or output["text"] for output in cell.outputs] == [
        data,
        {"text/plain": "widget: run the cell to see it"},
        "ab\nc",
        "d",
    ]
    assert strip(copy.deepcopy(made)) == made


def test_a_notebook_that_is_read_says_what_its_kernel_will_say():
    made = notebook("a")
    made.metadata |= {"widgets": {}, "language_info": {"name": "python", "version": "2.7"}}
    assert complete(made) is made and "widgets" not in made.metadata
    assert made.metadata["language_info"] == {"name": "python", "version": sys.version.split()[0]}
    for language in ({"name": "julia"}, None):
        made.metadata["language_info"] = language
        assert complete(made).metadata["language_info"] == language


def test_the_state_of_a_notebook_is_all_but_its_results():
    made = notebook("a")
    made.cells.append(nbformat.v4.new_markdown_cell("picture", attachments={"a.png": {}}))
    before = state(made), state(made, "metadata")
    made.cells[0].update(execution_count=3, outputs=[{"output_type": "stream"}])
    assert (state(made), state(made, "metadata")) == before
    made.cells[0].metadata["tags"] = ["new"]
    assert state(made) != before[0] and state(made, "metadata") == before[1]
    made.cells[1].attachments["a.png"] = {"image/png": "AAAA"}
    assert state(made, "metadata") != before[1]


def test_the_save_hook_strips_notebooks_and_nothing_else():
    made = notebook("a")
    made.metadata["widgets"] = {}
    pre_save_hook(
        model={"type": "notebook", "content": made}, path="a.ipynb", contents_manager=None
    )
    assert "widgets" not in made.metadata
    pre_save_hook(model={"type": "file", "content": "text"}, path="a.txt", contents_manager=None)


def test_all_notebooks_are_found_but_no_checkpoints(tmp_path, monkeypatch):
    for name in (
        "b.ipynb",
        "part1/a.ipynb",
        ".ipynb_checkpoints/b.ipynb",
        "part1/.ipynb_checkpoints/a.ipynb",
        "notes.md",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert [path.relative_to(tmp_path).as_posix() for path in found(tmp_path)] == [
        "b.ipynb",
        "part1/a.ipynb",
    ]
    done = []
    monkeypatch.setattr(notebooks, "execute", lambda path: done.append(path) or path)
    assert execute_all([str(tmp_path / "b.ipynb")], say=lambda text: None) == 0 and done == [
        tmp_path / "b.ipynb"
    ]
