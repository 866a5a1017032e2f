"""The benchmark's problems.

labkit meets their references, finds every event and invents none, on both back ends.
"""

import numpy as np
import pytest

from labkit import simulate

from .benchmarks.contest import Answer, judge
from .benchmarks.problems import PROBLEMS

TIGHT = {"spiral": 1e-11, "ball": 1e-10, "relay": 1e-9, "stick_slip": 1e-9, "boost": 1e-9}


def answer(problem, **options):
    run = simulate(problem.system, problem.t_end, points=2, **options)
    assert run.stopped == "finished"
    return Answer(run.values[-1], [event.t for event in run.events])


@pytest.mark.parametrize("backend", ["compiled", "plain"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_end_state_and_every_event(name, backend):
    error, missed, invented = judge(
        PROBLEMS[name], answer(PROBLEMS[name], rtol=1e-12, atol=1e-12, backend=backend)
    )
    assert error <= TIGHT[name] and missed == invented == 0


@pytest.mark.parametrize("name", ["ball", "relay", "stick_slip"])
def test_instants_of_the_reference(name):
    """The references' own instants, by another way than judge."""
    problem = PROBLEMS[name]
    found = [
        event.t
        for event in simulate(
            problem.system, problem.t_end, rtol=1e-12, atol=1e-12, points=2
        ).events
    ]
    assert np.abs(np.array(found) - problem.reference()[0]).max() < 1e-9


def test_references_that_are_known_otherwise():
    """Ball: the closed form of the n-th bounce; stick-slip: the first release.

    Converter: two ticks a cycle and 64 times the diode.
    """
    first = np.sqrt(2 * 10 / 9.81)
    bounces = first * (1 + 2 * np.cumsum(0.8 ** np.arange(12)) - 2)
    assert np.allclose(PROBLEMS["ball"].reference()[0], bounces, rtol=0, atol=1e-13)
    assert PROBLEMS["stick_slip"].reference()[0][0] == pytest.approx(5.88 / 4, abs=1e-14)
    assert len(PROBLEMS["boost"].reference()[0]) == 999 + 64


def test_the_judge_sees_what_is_wrong():
    problem = PROBLEMS["relay"]
    instants, state = problem.reference()
    assert judge(problem, Answer(state, instants)) == (0.0, 0, 0)
    assert judge(problem, Answer((state[0] + 1e-3, state[1]), instants)) == (
        pytest.approx(1e-3),
        0,
        0,
    )
    assert judge(problem, Answer(state, instants[1:])) == (0.0, 1, 0)
    assert judge(problem, Answer(state, [*instants, instants[3] + 0.01])) == (0.0, 0, 1)
    assert judge(problem, Answer((np.nan, 0.0), []))[:2] == (np.inf, len(instants))
