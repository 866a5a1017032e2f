"""Settings for all tests."""

import os

import pytest
from hypothesis import settings

from .helpers import load
from .lab import open_browser

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
def names(request):
    """The names of the notebook that a file of tests is about, its NAME, after its cells ran."""
    return load(request.module.NAME)


@pytest.fixture(scope="module")
def system(names):
    return names["system"]
