"""A variant of a system keeps everything that it does not name, and says what it cannot do."""

import subprocess
import sys

import numpy as np
import pytest

from labkit import (
    At,
    Every,
    Mode,
    ModelError,
    Output,
    Parameter,
    System,
    Transition,
    simulate,
)


def on(t, s, p):
    return (p.E - s.i) / p.L, -s.v / p.R


def diode(t, s, p):
    return (p.E - s.i - s.v) / p.L, s.i - s.v / p.R


def off(t, s, p):
    return 0.0, -s.v / p.R


system = System(
    "converter",
    {"i": ("A", "current"), "v": ("V", "voltage")},
    {
        "E": Parameter(20.0, "V", "source", 1, 60),
        "L": Parameter(1.0, "H", "coil"),
        "R": Parameter(50.0, "Ω", "load", 5, 500, symbol="R_l"),
    },
    [Mode("on", on, meaning="closed"), Mode("diode", diode, meaning="open"), Mode("off", off)],
    [
        Transition("on", "diode", at=Every(1.0, first=0.4), label="opens"),
        Transition(("diode", "off"), "on", at=Every(1.0), label="closes"),
        Transition("diode", "off", lambda t, s, p: s.i, -1, label="blocks", tolerance=1e-6),
    ],
    start={"i": 0.0, "v": 1.0},
    outputs={
        "u": Output({"on": lambda t, s, p: s.v, "off": lambda t, s, p: 0.0}, "V", "at the load"),
        "idle": Output({"off": lambda t, s, p: 1.0}),
        "P": Output(lambda t, s, p: s.v**2 / p.R, "W", "power"),
    },
    time="ms",
    held={"load": ("Ω", 50.0, "the load")},
)


def same(one, other):
    """All that a variant without changes must keep."""
    for key in ("time", "units", "meanings", "states", "parameters", "modes", "held"):
        assert getattr(one, key) == getattr(other, key), key
    for key in ("transitions", "outputs", "mode", "start", "width", "leaving"):
        assert getattr(one, key) == getattr(other, key), key


def test_a_variant_without_changes_is_the_system_under_another_name():
    variant = system.variant("the same")
    assert variant.name == "the same" and variant is not system
    same(variant, system)
    a, b = (simulate(one, 5.0, points=50).values for one in (system, variant))
    np.testing.assert_array_equal(a, b)


def test_values_become_defaults_and_everything_else_stays():
    variant = system.variant("light load", R=200.0)
    assert variant.parameters["R"] == Parameter(200.0, "Ω", "load", 5, 500, symbol="R_l")
    assert system.parameters["R"].value == 50.0
    assert variant.parameters["E"] == system.parameters["E"]
    assert variant.meanings == system.meanings and variant.outputs == system.outputs
    assert simulate(variant, 1.0).p.R == 200.0
    a, b = simulate(variant, 5.0), simulate(system, 5.0, R=200.0)
    np.testing.assert_array_equal(a.values, b.values)


def test_without_a_mode_go_its_transitions_and_outputs():
    variant = system.variant("no diode", modes={"off": None})
    assert list(variant.modes) == ["on", "diode"]
    assert [tr.name for tr in variant.transitions] == ["opens", "closes"]
    assert variant.transitions[1].sources == ("diode",)
    assert list(variant.outputs) == ["u", "P"] and list(variant.outputs["u"].function) == ["on"]
    assert variant.modes["on"].meaning == "closed" and variant.unit("u") == "V"
    listed = system.variant("no diode", modes=[Mode("on", on), Mode("diode", diode)])
    assert [tr.name for tr in listed.transitions] == ["opens", "closes"]
    assert listed.modes["on"].meaning == ""  # a list is the whole part
    one, other = (simulate(each, 5.0, start={"v": 100.0})["i"] for each in (variant, system))
    assert min(one) < -1 and min(other) > -1e-5


def test_a_mapping_changes_what_it_names():
    def printed(t, s, p):
        return 0.0, 1.0

    variant = system.variant(
        "changed",
        modes={"diode": printed},
        transitions={
            "blocks": {"tolerance": 0.0},
            "opens": None,
            "stop": Transition("on", None, at=At(3)),
        },
        outputs={"P": None, "twice": Output(lambda t, s, p: 2 * s.v, "V")},
        parameters={"R": 60, "new": Parameter(1.0, "s", "another")},
        start={"v": 3.0, "load": 25.0},
        time="s",
    )
    assert variant.modes["diode"].flow is printed and variant.modes["diode"].meaning == "open"
    assert [tr.name for tr in variant.transitions] == ["closes", "blocks", "on → end"]
    assert variant.transitions[1].tolerance == 0 and system.transitions[2].tolerance == 1e-6
    assert variant.transitions[1].guard is system.transitions[2].guard
    assert list(variant.outputs) == ["u", "idle", "twice"]
    assert variant.parameters["R"].unit == "Ω" and variant.parameters["R"].value == 60
    assert variant.parameters["new"].meaning == "another"
    assert variant.start == {"i": 0.0, "v": 3.0, "load": 25.0} and variant.time == "s"


def test_a_state_more_and_a_state_less():
    more = system.variant(
        "one more",
        states={"q": ("C", "charge")},
        modes=[Mode("on", lambda t, s, p: (1.0, 1.0, s.i))],
        start={"q": 0.0},
    )
    assert more.states == ("i", "v", "q") and more.meanings["i"] == "current"
    less = system.variant(
        "one less",
        states={"v": None},
        modes=[Mode("on", lambda t, s, p: (1.0,))],
        outputs={"P": None},
    )
    assert less.states == ("i",) and "v" not in less.start


def test_a_start_mode_that_is_gone_becomes_the_first():
    late = system.variant("late", mode="off", modes={"off": off})
    assert late.mode == "off" and late.variant("early", modes={"off": None}).mode == "on"
    chosen = system.variant("chosen", mode=lambda t, s, p: "off")
    assert chosen.variant("again").mode is chosen.mode


def test_a_parameter_with_the_name_of_a_part_is_bound_by_parameters_only():
    clock = system.variant("clock", parameters={"time": Parameter(7.0), "name": 1.0})
    with pytest.raises(ModelError, match="'time' is a part of System and a parameter of 'clock'"):
        clock.variant("x", time=3.0)
    variant = clock.variant("x", parameters={"time": 3.0}, name=2.0)
    assert variant.name == "x" and variant.parameters["name"].value == 2.0
    assert variant.parameters["time"].value == 3.0 and variant.time == "ms"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"Q": 1.0},
            "'Q' is neither a part of System nor a parameter of 'converter'; there are 'E'",
        ),
        ({"R": 1000.0}, r"parameter 'R' = 1000 is outside its range \[5, 500\] Ω"),
        ({"R": "many"}, "parameter 'R' must be a number, not 'many'"),
        ({"modes": {"of": None}}, "takes away 'of', which is not among the modes; there are 'on'"),
        ({"modes": {"off": Mode("idle", off)}}, "names 'off', but its Mode is called 'idle'"),
        ({"modes": {"off": 3}}, "the flow of mode 'off' must be a function"),
        ({"transitions": {"bolcks": None}}, "takes away 'bolcks'.*'blocks'"),
        ({"transitions": {"bolcks": {"delay": 1}}}, "there is no transition 'bolcks' to change"),
        ({"transitions": {"blocks": {"gard": off}}}, "'blocks' has no field 'gard'; there are"),
        ({"transitions": {"blocks": 4}}, "must be a Transition, a dict of its fields"),
        ({"transitions": {"new": 4}}, r"must be Transition\(source mode"),
        (
            {"modes": {"off": None}, "transitions": {"blocks": {"delay": 1.0}}},
            "transition 'blocks' is to change, but its mode is gone",
        ),
        ({"outputs": {"y": None}}, "takes away 'y', which is not among the outputs"),
        ({"outputs": [1]}, "outputs of a variant must be a dict of what changes, not"),
        ({"start": {"w": 1.0}}, "start names the unknown state"),
    ],
)
def test_what_a_variant_cannot_be_is_said(changes, words):
    with pytest.raises(ModelError, match=words):
        system.variant("x", **changes)


def test_a_name_that_is_also_a_module_is_what_labkit_exports():
    """`equations` is a function and the module it stands in, which importing puts in its place."""
    code = "import labkit; labkit.parameter_table; from labkit import equations; equations.__call__"
    subprocess.run([sys.executable, "-c", code], check=True)
