"""What a case has to say about a run, and how cases are run."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from labkit import Run, System, simulate

LOST, INVENTED, THROUGH, OTHER = "lost", "invented", "through", "other"
SCIPY = ("LSODA", "Radau", "BDF")
EPS = 2.0**-52
# What a case is told in: in some of them it coincides exactly, in others up to rounding
UNITS = (1.0, 1.0, 0.1, 0.3, 1 / 3, 9.81, 1e-3, 1e6 / 7)


class Complaint(NamedTuple):
    """What is wrong with a run: LOST or INVENTED events, a surface gone THROUGH, or OTHER
    things.
    """

    what: str
    text: str
    count: int = 1


def run(system: System, t_end: float, backend: str, method: str, **options) -> Run:
    """simulate(…), with limits that a case without faults never reaches. SciPy's methods run
    plain.
    """
    options = {"max_events": 20_000, "max_steps": 300_000, "points": 200} | options
    backend = "plain" if method in SCIPY else backend
    return simulate(system, t_end, backend=backend, method=method, **options)


def compare(
    found: Iterable[float], exact: Iterable[float], tolerance: float | list[float], what: str
) -> list[Complaint]:
    """Which of two rising lists of instants have no partner in the other one, within the
    tolerance.
    """
    found, exact = list(found), list(exact)
    bounds = [tolerance] * len(exact) if isinstance(tolerance, float) else list(tolerance)
    lost, invented = [], []
    i = k = 0
    while i < len(found) or k < len(exact):
        if k == len(exact) or (i < len(found) and found[i] < exact[k] - bounds[k]):
            invented.append(found[i])
            i += 1
        elif i == len(found) or found[i] > exact[k] + bounds[k]:
            lost.append(exact[k])
            k += 1
        else:
            i, k = i + 1, k + 1
    complaints = []
    if lost:
        complaints.append(Complaint(LOST, f"{what} lost at {lost[:4]}", len(lost)))
    if invented:
        text = f"{what} that is none at {invented[:4]}"
        complaints.append(Complaint(INVENTED, text, len(invented)))
    return complaints


def close(found: dict[str, float], exact: dict[str, float], tolerance: float) -> list[Complaint]:
    """A complaint for every named value that is off."""
    return [
        Complaint(OTHER, f"{name} = {found[name]!r}, right {value!r}")
        for name, value in exact.items()
        if not abs(found[name] - value) <= tolerance
    ]


def finished(done: Run) -> list[Complaint]:
    return [] if done.stopped == "finished" else [Complaint(OTHER, done.stopped)]


def instants(times: Iterable[float], tolerance: float) -> list[float]:
    """Rising times without those that lie within the tolerance of the one before."""
    kept: list[float] = []
    for t in times:
        if not kept or t - kept[-1] > tolerance:
            kept.append(t)
    return kept
