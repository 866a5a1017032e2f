"""Part 2 on the notebooks' own models: the default run against the piecewise exact solution."""

import re

import numpy as np
import pytest

from labkit import simulate
from labkit.characteristics import Characteristic

from .helpers import ASSIGNMENTS, load
from .test_characteristics import exact

FIRST = [name for name in ASSIGNMENTS if re.match(r"part2/1[a-h]_", name)]
SECOND = [name for name in ASSIGNMENTS if re.match(r"part2/2[a-f]_", name)]


def test_there_are_some():
    assert FIRST and SECOND


def the_characteristic(names):
    (made,) = {
        id(value): value
        for value in names.values()
        if type(value) is Characteristic and value.rising.edges and not value.memory
    }.values()
    return made


@pytest.mark.parametrize("name", FIRST)
def test_the_default_run_is_the_exact_solution(name):
    names = load(name, "system", "horizon")
    system, horizon = names["system"], names["horizon"]
    made = the_characteristic(names)
    p = system.values()._asdict()
    assert horizon == 40.0 and system.start == {"x": 1.0, "v": 0.0}
    assert [p[key] for key in ("k1", "k2", "k3", "k4", "delta")] == [-1, -1, 0.5, 0.7, 0]
    x, v, switches = exact(made, p, horizon)
    run = simulate(system, horizon, rtol=1e-10)
    assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
    assert sum("through" in event.transition for event in run.events) == switches
    assert np.all(np.isfinite(run["F"]))


def exact_case(made, p, t_end, case):
    """As `exact`, for the second pendulum: force absent, switched every T seconds, or always on.

    Switched off, the sine runs on.
    """
    t, state, switches = 0.0, (1.0, 0.0), 0
    while t < t_end:
        on = {"absent": False, "always": True, "switched": round(t / p["T"]) % 2 == 0}[case]
        end = min(t + p["T"], t_end)
        k = (-1 / p["mu"], 0.0, on * p["h"] / p["mu"], p["omega"])
        *state, more = exact(made, p, end, state, k, t)
        t, switches = end, switches + more
    return *state, switches


@pytest.mark.parametrize("case", ["absent", "switched", "always"])
@pytest.mark.parametrize("name", SECOND)
def test_the_second_pendulums_default_runs_are_exact_in_the_three_cases(name, case):
    names = load(name, "system", "horizon", "cases")
    made, system, horizon = the_characteristic(names), names["system"], names["horizon"]
    chosen = names["cases"][case]
    p = chosen.values()._asdict()
    assert horizon == 40.0 and system.start == {"x": 1.0, "v": 0.0, "on": 1.0}
    assert system is names["cases"]["always"] and p == system.values()._asdict()
    assert [p[key] for key in ("mu", "h", "omega", "delta", "T")] == [1.2, 1, 1, 0, 10]
    for t_end in (horizon, 100.0):
        x, v, switches = exact_case(made, p, t_end, case)
        run = simulate(chosen, t_end, rtol=1e-10)
        assert [run.final["x"], run.final["v"]] == pytest.approx([x, v], abs=1e-7)
        assert sum("through" in event.transition for event in run.events) == switches > 0
        assert np.all(np.isfinite(run["F"]))
