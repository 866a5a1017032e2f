"""Settings for all tests."""

import os
import shutil

import pytest
from hypothesis import settings

from .helpers import FOLDER, load
from .lab import CELLS, HANDS, open_browser, running_lab

# Another worker may hold the processor while an example runs, so time is no sign of a fault; the
# same examples every time.
settings.register_profile("labkit", deadline=None, derandomize=True)
settings.load_profile("labkit")


@pytest.fixture(scope="module")
def browser():
    """A headless browser; without one, tests that need it are skipped, and fail in CI."""
    try:
        with open_browser() as browser:
            yield browser
    except LookupError as error:
        pytest.fail(str(error)) if os.environ.get("CI", "").lower() == "true" else pytest.skip(
            str(error)
        )


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A JupyterLab of the file's own, over a copy of the notebooks and two small ones."""
    folder = tmp_path_factory.mktemp("lab")
    shutil.copytree(
        FOLDER, folder / "notebooks", ignore=shutil.ignore_patterns(".ipynb_checkpoints")
    )
    with running_lab(folder) as lab:
        lab.write("small", CELLS)  # beside the real ones
        lab.write("hands", [CELLS[0], HANDS])
        yield lab


@pytest.fixture
def page(browser, lab):
    """A page for one test, which leaves no kernel; page.problems: errors that nobody caught."""
    page = browser.new_page(
        viewport={"width": 1400, "height": 1000}
    )  # room for a picture of 9 inches
    page.set_default_timeout(90_000)
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    yield page
    page.close()
    lab.end_kernels()


@pytest.fixture(scope="module")
def names(request):
    """The names of the notebook that a file of tests is about, its NAME, after its cells ran."""
    return load(request.module.NAME)


@pytest.fixture(scope="module")
def system(names):
    return names["system"]
