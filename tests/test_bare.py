"""The browser's half of the panel without JupyterLab: the pixels, fingers and keys."""

import os

import numpy as np
import pytest

from .bare import made_by, opened, saved, shown
from .benchmarks.latency import SETUP
from .lab import open_browser


@pytest.fixture(scope="module")
def browser():
    try:
        with open_browser() as browser:
            yield browser
    except LookupError as error:
        pytest.fail(str(error)) if os.environ.get("CI", "").lower() == "true" else pytest.skip(str(error))


# ---- fidelity: mean difference ≤ 0.7 of 255, and ≤ 0.3 % of the pixels off by more than 32


def like_what_is_saved(browser, panel, ratio):
    with opened(browser, panel, ratio) as page:
        assert page.problems == []
        mine, theirs = shown(page), saved(panel)
    assert mine.shape == theirs.shape
    off = np.abs(mine - theirs)
    print(f"{panel.title}, ratio {ratio}: mean {off.mean():.3f}, {100 * (off.max(axis=2) > 32).mean():.3f} % far off")
    assert (theirs < 100).any() and off.mean() <= 0.7 and (off.max(axis=2) > 32).mean() <= 0.003


@pytest.mark.parametrize("name", ["part3/06_dc_dc_converter", "part3/00_sample_dry_friction", "concepts/linear_systems"])
def test_the_canvas_shows_what_matplotlib_saves(browser, name):
    panels = made_by(name)
    assert panels
    for panel in panels:
        for ratio in (1, 2):
            like_what_is_saved(browser, panel, ratio)


def test_the_canvas_shows_what_matplotlib_saves_of_the_benchmarks_load(browser, tmp_path, monkeypatch):
    """2 curves, 40 trajectories of 300 points, 400 arrows."""
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(SETUP, names)
    panel = names["explore"](names["system"], 10.0, names["draw"], start=False, method=False)
    for ratio in (1, 2):
        like_what_is_saved(browser, panel, ratio)
