"""The form of the code: what ruff formats and checks, by the settings of pyproject.toml."""

import subprocess
import sys

import pytest

from .helpers import ROOT

# Files that are still to be put in order: a file that is clean leaves this list, none comes to it
LATER = {
    "labkit/controls.py",
    "labkit/panel.py",
    "tests/test_bare.py",
    "tests/test_browser.py",
    "tests/test_concept_linear_systems.py",
    "tests/test_concept_solvers_and_tolerances.py",
    "tests/test_panel.py",
    "tests/test_part3_dc_dc_converter.py",
    "tests/test_sample_dry_friction.py",
    "tests/test_sample_relay_hysteresis.py",
    "tests/test_solve.py",
}
FILES = {
    path.relative_to(ROOT).as_posix()
    for room in ("labkit", "tests")
    for path in (ROOT / room).rglob("*.py")
}
PATHS = sorted(FILES - LATER)


def test_the_list_of_what_is_left_names_files_that_are_there():
    assert LATER <= FILES


@pytest.mark.parametrize("words", [("check",), ("format", "--check")], ids=" ".join)
def test_ruff(words):
    done = subprocess.run(
        [sys.executable, "-m", "ruff", *words, *PATHS], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
