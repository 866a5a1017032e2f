"""Periodic solutions and what becomes of their neighbours: cycles, monodromy, Floquet multipliers.

cycle = periodic(system, lambda t, s, p: s.x, horizon=50.0)
cycle.period, cycle.at(0.3)["x"], cycle.multipliers, cycle.stable
monodromy(system, 2 * pi, q=0.3).multipliers
"""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from numbers import Integral
from typing import Any

from .arguments import asked, unambiguous
from .model import Function, ModelError, System, number
from .poincare import section
from .run import Ended
from .shooting import Cycle, Monodromy, linear, near
from .solve import simulate

__all__ = ["Cycle", "Monodromy", "monodromy", "periodic"]


@unambiguous
def periodic(
    system: System,
    where: float | Function,
    *,
    direction: int | None = None,
    start: Mapping[str, float] | None = None,
    mode: str | None = None,
    t0: float = 0.0,
    horizon: float | None = None,
    settle: int | None = None,
    rtol: float = 1e-12,
    method: str = "DOP853",
    **parameters: float,
) -> Cycle:
    """periodic(system, 2 * pi, k=0.3) or periodic(system, g, horizon=50.0) -> Cycle, by shooting.

    where      the period, of a system that the clock drives; or, where the period is unknown, a
               section g(t, s, p) that the cycle crosses
    direction  how it crosses the section: 1 rising, the default, or -1 falling
    horizon    how long to look for returns to the section
    start      from where to look; the cycle need not be stable, but then start near it
    settle     how many periods (or crossings) to run before that: 1 by default

    Newton's method on φ_T(x) = x, and with a section on φ_T(x) = x, g(x) = 0 for x and T (Seydel,
    Practical Bifurcation and Stability Analysis, chapter 7). The derivative of φ comes from runs
    of neighbours, through all events, by central differences: that is what the saltation matrices
    of hybrid systems describe (Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth
    Mechanical Systems). Its error stands in cycle.monodromy.error.

    Raises ModelError, in words, when it does not converge, when what it finds is at rest, and
    where a neighbour of the cycle meets other events than it does.
    """
    options = {"rtol": rtol, "method": method}
    settle = 1 if settle is None else settle
    if not isinstance(settle, Integral) or settle < 0:
        raise ModelError(f"settle must be a whole number of at least 0, not {settle!r}")
    if direction not in (None, 1, -1):
        raise ModelError(f"direction is 1 (rising) or -1 (falling), not {direction!r}")
    if not callable(where):
        period = number(where, "the period")
        if period <= 0:
            raise ModelError(f"the period must be positive, not {period:g}")
        horizon = period * (settle + 1)
    elif horizon is None:
        raise ModelError(
            "for a section say how long to look for returns to it, horizon=50.0; a known period "
            "is given instead of the section"
        )
    begun = simulate(system, t0 + horizon, t0=t0, start=start, mode=mode, **options, **parameters)
    if not callable(where):
        if begun.ended is not Ended.FINISHED:
            raise ModelError(f"the first periods ended early: {begun.stopped}")
        return near(begun, None, t0 + settle * period, period, options)
    points = section(begun, where, direction or 1)
    if len(points) < settle + 2:
        raise ModelError(
            f"within {horizon:g} {system.time} the run crosses the section {len(points)} times, "
            f"but {settle + 2} are needed: take a longer horizon, another start or direction "
            f"({begun.stopped})"
        )
    first, second = points.t[settle : settle + 2].tolist()
    return near(begun, where, first, second - first, options)


@asked
def monodromy(system: System, where: float | Function, **arguments: Any) -> Monodromy:
    """monodromy(system, pi, q=0.3) -> Monodromy: matrix, multipliers and stability over one period.

    Arguments as of `periodic`. Of a linear system with periodic coefficients (modes that switch by
    the clock included) it is exact to the tolerance, column by column from unit starts, about any
    solution (Floquet's theory: Nayfeh and Mook, Nonlinear Oscillations, chapter 5). Of any other
    system it is that about its cycle, which `periodic` finds.

    Raises ModelError as periodic does.
    """
    own = signature(periodic).parameters
    usual = {name: each.default for name, each in own.items() if each.kind is each.KEYWORD_ONLY}
    clash = usual.keys() & arguments.keys() & system.parameters.keys()  # periodic says it
    if not (clash or callable(where) or any(tr.guard for tr in system.transitions)):
        p = system.values({name: x for name, x in arguments.items() if name not in usual})
        given = usual | arguments
        begin = {"start": given["start"], "mode": given["mode"], "t0": number(given["t0"], "t0")}
        options = {"rtol": given["rtol"], "method": given["method"]}
        if made := linear(system, number(where, "the period"), begin, options, p._asdict()):
            return made
    return periodic(system, where, **arguments).monodromy


monodromy.__signature__ = signature(periodic).replace(return_annotation="Monodromy")  # type: ignore[attr-defined]
