"""Variants of a system: `System.variant` says what they are; here they are made.

variant_of(system, "no diode", {"modes": {"off": None}}, {"R": 200.0})
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from .model import (
    Held,
    Mode,
    ModelError,
    Output,
    Parameter,
    System,
    Transition,
    check_names,
    listed,
    named,
)

__all__ = ["variant_of"]


def variant_of(
    system: System, name: str, parts: Mapping[str, object], values: Mapping[str, object]
) -> System:
    """variant_of(system, name, parts of System by name or None, values of parameters) -> System."""
    values = named(values, "the parameters")
    if both := [key for key in system.parameters if parts.get(key) is not None]:
        raise ModelError(
            f"{listed(both)} is a part of System and a parameter of {system.name!r}: for the "
            f"parameter say parameters={{{both[0]!r}: …}}; a part of that name cannot be given"
        )
    said = f"{{}} is neither a part of System nor a parameter of {system.name!r}"
    check_names(values, system.parameters, said)
    new_states = _changed(system.described, parts["states"], "states")
    made = _changed(system.parameters, parts["parameters"], "parameters")
    for key, value in (made | values).items():
        if not isinstance(value, Parameter) and key in system.parameters:
            made[key] = replace(system.parameters[key], value=value)
    new_modes = _changed_modes(system.modes, parts["modes"])
    names = {each.name for each in new_modes if isinstance(each, Mode)}
    gone = set(system.modes) - names
    kept = _changed_transitions(system.transitions, parts["transitions"], gone)
    shown = _changed(_outputs_without(system.outputs, gone), parts["outputs"], "outputs")
    lasting = _changed(system.held, parts["held"], "held")
    begin = named(parts["start"] or {}, "start")
    for key in [key for key in begin if isinstance(lasting.get(key), Held)]:
        lasting[key] = replace(lasting[key], start=begin.pop(key))
    lost = {*system.held, *system.states} - {*new_states}
    begin = {key: x for key, x in system.start.items() if key not in lost} | begin
    known = callable(system.mode) or system.mode in names
    first = parts["mode"] or (system.mode if known else None)
    unit = system.time if parts["time"] is None else parts["time"]
    return System(name, new_states, made, new_modes, kept, begin, first, shown, unit, lasting)


def _changed(old: Mapping, new: Mapping | None, what: str) -> dict:
    """The old with what the new names; None takes away. ModelError when there is no such thing."""
    made = {**old, **named(new or {}, f"{what} of a variant", "of what changes")}
    gone = [key for key, value in made.items() if value is None]
    check_names(gone, old, f"the variant takes away {{}}, which is not among the {what}")
    return {key: value for key, value in made.items() if value is not None}


def _changed_modes(old: Mapping[str, Mode], new: object) -> Sequence[Mode]:
    """The modes of a variant: a list is the whole, a mapping of Modes or flows what changes."""
    if new is not None and not isinstance(new, Mapping):
        return new  # type: ignore[return-value]
    made = _changed(old, new, "modes")
    for key, value in made.items():
        if not isinstance(value, Mode):
            made[key] = replace(old[key], flow=value) if key in old else Mode(key, value)
        elif value.name != key:
            raise ModelError(f"modes names {key!r}, but its Mode is called {value.name!r}")
    return list(made.values())


def _changed_transitions(
    old: Sequence[Transition], new: object, gone: set[str]
) -> Sequence[Transition]:
    """The transitions of a variant, without those that lead into modes that are gone."""
    if new is not None and not isinstance(new, Mapping):
        return new  # type: ignore[return-value]
    there = dict.fromkeys((tr.name for tr in old), {})
    changes = _changed(there, new, "transitions")
    kept: list[Transition] = []
    for tr in old:
        change = changes.get(tr.name)
        if isinstance(change, Transition):
            kept += [change] if change not in kept else []
        elif isinstance(change, Mapping):
            check_names(
                change, tr.__dataclass_fields__, f"transition {tr.name!r} has no field {{}}"
            )
            sources = tuple(key for key in tr.sources if key not in gone)
            here = tr.source if sources == tr.sources else sources
            calm = None if tr.zeno in gone else tr.zeno
            one = replace(tr, **{"source": here, "zeno": calm, **change})
            if one.sources and one.target not in gone:
                kept.append(one)
            elif change:
                raise ModelError(f"transition {tr.name!r} is to change, but its mode is gone")
        elif change is not None:
            raise ModelError(
                f"transition {tr.name!r} of a variant must be a Transition, a dict of its fields "
                f"that change, or None, not {change!r:.60}"
            )
    more = {key: each for key, each in changes.items() if key not in there}
    fields = [key for key, each in more.items() if isinstance(each, Mapping)]
    check_names(fields, there, "there is no transition {} to change")
    return [*kept, *more.values()]


def _outputs_without(outputs: Mapping[str, Output], gone: set[str]) -> dict[str, Output]:
    """Outputs without their functions in modes that are gone; one without any is gone too."""
    made = {}
    for key, what in outputs.items():
        if not isinstance(what.function, Mapping):
            made[key] = what
        elif left := {mode: f for mode, f in what.function.items() if mode not in gone}:
            made[key] = replace(what, function=left)
    return made
