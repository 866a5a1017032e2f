"""The notebooks of part 3 in JupyterLab; a file of its own, so that another worker can run it."""

import pytest

from .helpers import NOTEBOOKS
from .lab import opens_runs_and_slides


@pytest.mark.parametrize("name", [name for name in NOTEBOOKS if name.startswith("part3/")])
def test_it_opens_runs_and_slides(desk, lab, name):
    opens_runs_and_slides(desk, lab, name)
