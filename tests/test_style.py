"""The form of the code: what ruff formats and checks, by the settings of pyproject.toml."""

import subprocess
import sys

import pytest

from .helpers import ROOT

# Rooms that have been put in order; the others follow when they are next touched
CLEAN = [
    *(
        "cycles",
        "ledger",
        "model",
        "poincare",
        "portions",
        "progress",
        "rebind",
        "run",
        "runs",
        "shooting",
        "sweeps",
        "table",
        "trace",
    ),
    "solve",
]
PATHS = [
    *(f"labkit/{name}" if name == "solve" else f"labkit/{name}.py" for name in CLEAN),
    *("tests/coincidences", "tests/test_coincidences.py", "tests/test_style.py"),
    *(
        "labkit/draw/maps.py",
        "tests/test_cycles.py",
        "tests/test_sweep.py",
        "tests/test_table.py",
        "tests/test_variant.py",
    ),
]


@pytest.mark.parametrize("words", [("check",), ("format", "--check")], ids=" ".join)
def test_ruff(words):
    done = subprocess.run(
        [sys.executable, "-m", "ruff", *words, *PATHS], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
