"""Part 2 on the notebooks' own models: the default run against the piecewise exact solution."""

import re

import numpy as np
import pytest

from labkit import simulate
from labkit.characteristics import Characteristic

from .helpers import ASSIGNMENTS, load
from .test_characteristics import exact

FIRST = [name for name in ASSIGNMENTS if re.match(r"part2/1[a-h]_", name)]


def test_there_are_some():
    assert FIRST


@pytest.mark.parametrize("name", FIRST)
def test_the_default_run_is_the_exact_solution(name):
    names = load(name)
    system, horizon = names["system"], names["horizon"]
    (made,) = {
        id(value): value
        for value in names.values()
        if isinstance(value, Characteristic) and not value.memory
    }.values()
    p = system.values()._asdict()
    assert horizon == 40.0 and system.start == {"x": 1.0, "v": 0.0}
    assert [p[key] for key in ("k1", "k2", "k3", "k4", "delta")] == [-1, -1, 0.5, 0.7, 0]
    x, v, switches = exact(made, p, horizon)
    run = simulate(system, horizon, rtol=1e-10)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert sum("through" in event.transition for event in run.events) == switches
    assert np.all(np.isfinite(run["F"]))
