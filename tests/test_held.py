"""Held variables and resets that name what changes: the model's checks, and the functions of
both back ends.
"""

import ctypes

import pytest

from labkit.model import Mode, ModelError, Output, System, Transition
from labkit.solve import backend
from labkit.solve.check import check_functions
from labkit.solve.plain import Plain, orientations
from labkit.solve.source import RESET


def circuit(**changed):
    """A capacitor that is charged and discharged through a load, which a switch of loads
    changes.
    """
    charge = Mode("charge", lambda t, s, p: (s.i, (p.U - s.u) / s.load))
    discharge = Mode("discharge", lambda t, s, p: (-s.u / (s.load + 0 * s.turns),), {"u": "V"})
    transitions = [
        Transition("charge", "charge", guard=lambda t, s, p: s.u - s.load, reset={"load": 25.0}),
        Transition(
            "charge",
            "discharge",
            guard=lambda t, s, p: s.u - 5,
            reset={"turns": lambda t, s, p: s.turns + 1},
        ),
        Transition(
            "discharge", "charge", guard=lambda t, s, p: s.u, reset=lambda t, s, p: (s.load, -s.u)
        ),
        Transition("charge", "charge", guard=lambda t, s, p: s.i - 9),
        Transition(("charge", "discharge"), "discharge", guard=lambda t, s, p: 1.0, reset={}),
    ]
    options = {
        "name": "circuit",
        "states": {"i": "A", "u": "V"},
        "parameters": {"U": 12.0},
        "modes": [charge, discharge],
        "transitions": transitions,
        "start": {"i": 0.0, "u": 1.0},
        "held": {"load": ("Ω", 50.0, "what the switch chose"), "turns": ("", 0)},
    }
    return System(**(options | changed))


def test_what_a_system_knows_of_held_variables():
    system = circuit()
    assert system.held["load"].start == 50.0 and system.held["turns"].unit == ""
    assert system.unit("load") == "Ω" and system.meanings["load"] == "what the switch chose"
    assert system.S["charge"]._fields == ("i", "u", "load", "turns")
    assert system.S["discharge"]._fields == ("u", "load", "turns")
    assert system.states_of("charge") == ("i", "u") and system.width == 2
    assert system.places("discharge") == {"u": 0, "load": 2, "turns": 3}
    assert system.start == {"i": 0.0, "u": 1.0, "load": 50.0, "turns": 0.0}
    assert system.check_start({"i": 1.0, "u": 2.0, "load": 25.0}, "charge") == (1, 2, 25, 0)
    check_functions(system, system.values(), 0.0, (0.0, 1.0, 50.0, 0.0), "charge")


def test_reset_parts():
    system, s = circuit(), (1.0, 2.0, 50.0, 3.0)
    s, p = system.S["charge"](*s), system.values()
    parts = [system.reset_parts(tr, tr.sources[0]) for tr in system.transitions]
    assert [list(each) for each in parts[:3]] == [
        ["i", "u", "load", "turns"],
        ["u", "load", "turns"],
        ["i", "u", "load", "turns"],
    ]
    assert parts[0]["i"] is None and parts[0]["load"](0.0, s, p) == 25.0
    assert parts[1]["u"] is None and parts[1]["turns"](0.0, s, p) == 4.0
    assert [parts[2][name](0.0, s, p) for name in ("i", "u")] == [50.0, -2.0]
    assert parts[2]["load"] is None and not any(parts[3].values())


RESETS = [  # transition, mode, state before, state after
    (0, 0, [1.0, 2.0, 50.0, 3.0], [1.0, 2.0, 25.0, 3.0]),
    (1, 0, [1.0, 2.0, 50.0, 3.0], [2.0, None, 50.0, 4.0]),
    (2, 1, [2.0, 0.0, 50.0, 3.0], [50.0, -2.0, 50.0, 3.0]),
    (3, 0, [1.0, 2.0, 50.0, 3.0], [1.0, 2.0, 50.0, 3.0]),
    (4, 0, [1.0, 2.0, 50.0, 3.0], [2.0, None, 50.0, 3.0]),
    (4, 1, [1.0, 7.0, 50.0, 3.0], [1.0, None, 50.0, 3.0]),
]


def both(system):
    """What the cores of both back ends call: (what, index, state) -> what is written."""
    plain, p = Plain(system, orientations(system)), system.values()
    vector = ctypes.c_double * 4
    kind = ctypes.CFUNCTYPE(
        None,
        ctypes.c_int64,
        ctypes.c_int64,
        ctypes.c_double,
        *[ctypes.POINTER(ctypes.c_double)] * 3,
    )
    code = backend.compiled(system, wait=True)
    model, p_array = kind(code.model), (ctypes.c_double * (len(p) + 1))(*p)

    def slow(what, index, y):
        out = [0.0] * 4
        if what >= RESET:
            plain.reset[index](what - RESET, 0.0, y, p, out)
        else:
            (plain.flow, plain.guards)[what][index](0.0, y, p, out)
        return out

    def fast(what, index, y):
        out = vector()
        model(what, index, 0.0, vector(*y), p_array, out)
        return list(out)

    return slow, fast


def test_both_back_ends_read_and_write_held_variables():
    for call in both(circuit()):
        assert call(0, 0, [1.0, 2.0, 50.0, 3.0])[:2] == [1.0, 0.2]
        assert call(0, 1, [2.0, 9.0, 50.0, 3.0])[:1] == [-0.04]
        assert call(1, 0, [1.0, 2.0, 50.0, 3.0])[:3] == [-48.0, -3.0, -8.0]
        for transition, mode, before, after in RESETS:
            got = call(RESET + mode, transition, before)
            assert [a for a, b in zip(got, after, strict=True) if b is not None] == [
                b for b in after if b is not None
            ], (transition, mode)


def leaving(**options):
    return lambda: circuit(
        transitions=[
            Transition("charge", "discharge", guard=lambda t, s, p: s.u, label="off", **options)
        ]
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: circuit(held=["load"]), "held of 'circuit' must be a dict"),
        (lambda: circuit(held={"u": ("V", 1.0)}), "held variable 'u' has the name of a state"),
        (lambda: circuit(held={"U": ("V", 1.0)}), "held variable 'U' has the name of a parameter"),
        (lambda: circuit(held={"rtol": ("", 1.0)}), "'rtol' has the name of an option"),
        (lambda: circuit(held={"t": ("", 1.0)}), "'t' has the name of the time"),
        (lambda: circuit(held={"load": "Ω"}), r"must be \(unit, start value\)"),
        (lambda: circuit(held={"load": ("Ω", "x")}), "start of 'load' must be a number"),
        (lambda: circuit(held={"load": ("Ω", float("nan"))}), "start of 'load' must be finite"),
        (
            lambda: circuit(outputs={"load": Output(lambda t, s, p: 1.0)}),
            "output 'load' has the name",
        ),
        (
            lambda: circuit(start={"i": 0, "u": 1, "load": 3}),
            "their start stands in held=",
        ),
        (leaving(reset={"i": 1.0}), "names 'i'; after it there are 'u', 'load', 'turns'"),
        (leaving(reset={"u": "far"}), "the reset of transition 'off': 'u' must be a number"),
        (
            lambda: circuit(
                transitions=[
                    Transition("discharge", "charge", guard=lambda t, s, p: s.u, reset={"u": 1.0})
                ]
            ),
            "gives no value for 'i', which mode 'discharge' does not have",
        ),
        (leaving(reset=3.0), "must be a function .*, not 3.0; or a dict of what changes"),
    ],
)
def test_refused(make, words):
    with pytest.raises(ModelError, match=words):
        make()


def test_a_part_that_is_no_number_is_refused():
    system = leaving(reset={"u": lambda t, s, p: "far"})()
    with pytest.raises(ModelError, match="the reset of 'off' for 'u' must return one number"):
        check_functions(system, system.values(), 0.0, (0.0, 1.0, 50.0, 0.0), "charge")
