"""Settings for all tests."""

import os
import shutil

import pytest
from hypothesis import settings

from .helpers import FOLDER, load
from .lab import CELLS, HANDS, close_notebook, open_browser, opened_page, running_lab

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
    page = opened_page(browser)
    yield page
    page.close()
    lab.end_kernels()


@pytest.fixture(scope="module")
def kept(browser):
    page = opened_page(browser)
    yield page
    page.close()


@pytest.fixture
def desk(kept, lab):
    """A page whose Lab stays for the file's next test, for to begin it costs most; as page else."""
    kept.problems.clear()
    yield kept
    close_notebook(kept, lab)


@pytest.fixture(scope="module")
def names(request):
    """The names of the notebook that a file of tests is about, its NAME, after its cells ran."""
    return load(request.module.NAME)


@pytest.fixture(scope="module")
def system(names):
    return names["system"]
