"""Every public name with every kind of wrong argument: it works or says what is wrong, in words."""

import math
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest

import labkit
from labkit import ModelError, Parameter, System, Transition, figure, simulate
from labkit.arguments import asked, takes

swing = System(
    "swing",
    {"x": "m", "v": "m/s"},
    {"d": Parameter(0.2, "1/s", "damping", 0, 1)},
    [labkit.Mode("m", lambda t, s, p: (s.v, -s.x - p.d * s.v + math.cos(2 * t)))],
    start={"x": 1.0, "v": 0.0},
)
linear = swing.variant("linear", modes={"m": lambda t, s, p: (s.v, -s.x - p.d * s.v)})
run = simulate(linear, 5.0, backend="plain")
curve = labkit.from_points([(-1, -1), (1, 1)])
matrix, turn = [[0, 1], [-1, -0.2]], labkit.rotation(0.3)
family = {"u1": 1.0, "u2": 0.5, "lambda1": -0.5, "lambda2": -1.5}
pair, parts = labkit.family("stable node", "reflection", **family)
map_of = labkit.sweep(linear, 1.0, lambda run: run.final["x"], d=[0.1, 0.2], backend="plain")


def model(**changed):
    """A run of the system in a new form: what System lets through must do, too."""
    whole = {
        "name": "new",
        "states": {"x": "m", "v": "m/s"},
        "parameters": {"d": 0.2},
        "modes": [linear.modes["m"]],
        "transitions": [Transition("m", "m", lambda t, s, p: s.x)],
        "start": {"x": 1.0, "v": 0.0},
    }
    return simulate(System(**(whole | changed)), 0.1, backend="plain", points=2)


def transition(*given, **named):
    return model(transitions=[Transition(*given, **named)])


def event(t, s, p):
    return s.x


OPTIONS = {
    **{"t0": 0.0, "start": {"x": 3.0}, "mode": "m", "method": "RK45", "rtol": 1e-6, "atol": None},
    **{"step": None, "max_step": 1.0, "points": 10, "locate": True, "backend": "plain", "d": 0.5},
    **{"max_events": 100, "max_steps": 1000},
}
LOOK = {"start": {"x": 1.0}, "mode": "m", "t0": 0.0, "settle": 1, "rtol": 1e-9, "method": "RK45"}
CALLS = {
    "System": (
        model,
        [],
        {"mode": "m", "outputs": {}, "time": "s", "held": {}, "start": {"x": 1.0, "v": 0.0}},
    ),
    "System's parts": (model, [], {"states": {"x": "m", "v": ""}, "modes": [], "transitions": []}),
    "variant": (
        linear.variant,
        ["new"],
        {"parameters": {"d": 0.3}, "modes": {}, "transitions": {}, "start": {"x": 3.0}, "d": 0.1}
        | {"mode": "m", "outputs": {}, "time": "s", "held": {"k": ("", 1.0)}, "states": {}},
    ),
    "Parameter": (
        lambda *given: model(parameters={"d": Parameter(*given)}),
        [0.2, "m", "damping", 0, 1, "d"],
        {},
    ),
    "Held": (lambda *given: model(held={"k": labkit.Held(*given)}), ["m", 1.0, "meaning"], {}),
    "Mode": (
        lambda *given: model(modes=[labkit.Mode(*given)]),
        ["m", linear.modes["m"].flow, {"x": "m", "v": "m/s"}, "meaning"],
        {},
    ),
    "Transition": (
        transition,
        ["m", "m", event, -1, {"v": 0.0}, "label", None, 0.0, 0.0, None, None, 0.0],
        {},
    ),
    "Every": (lambda *given: transition("m", "m", at=labkit.Every(*given)), [1.0, 0.5], {}),
    "At": (lambda *given: transition("m", "m", at=labkit.At(*given)), [1.0, 0.5], {}),
    "Output": (
        lambda *given: model(outputs={"E": labkit.Output(*given)})["E"],
        [event, "J", "meaning"],
        {},
    ),
    "simulate": (simulate, [linear, 1.0], OPTIONS),
    "simulate_many": (labkit.simulate_many, [linear, 1.0], {**OPTIONS, "workers": 1}),
    "Run.at": (run.at, [1.0, "after"], {}),
    "Run[]": (run.__getitem__, ["x"], {}),
    "Run.again": (run.again, [], {"d": 0.5, "rtol": 1e-6, "t_end": 2.0}),
    "repeated": (labkit.repeated, [linear, "no_such_file.csv"], {}),
    "load_npz": (labkit.load_npz, ["no_such_file.npz"], {}),
    "Table": (labkit.Table, ["a", ("b", "m", ".2f")], {}),
    "equations": (labkit.equations, [linear], {}),
    "jacobian": (labkit.jacobian, [linear, "m"], {}),
    "parameter_table": (labkit.parameter_table, [linear], {}),
    "mode_diagram": (labkit.mode_diagram, [linear], {}),
    "figure": (figure, [1, 2], {"width": 5.0, "height": 3.0, "widths": [1, 2], "heights": None}),
    "mode_colors": (labkit.mode_colors, [linear], {}),
    "curves": (
        lambda *given, **named: labkit.curves(*given, **named).update(run),
        [figure().axes[0], lambda run: {"x": (run.t, run["x"])}],
        {"styles": {"x": "k"}, "xlabel": "t", "title": "T", "xlim": (0, 1), "plane": ("x", "v")},
    ),
    "time_plot": (labkit.time_plot, [run, "x", "v"], {"title": "T"}),
    "phase_portrait": (labkit.phase_portrait, [run, "x", "v"], {}),
    "planes": (labkit.planes, [simulate(pair, 1.0, backend="plain"), parts], {}),
    "Handle": (labkit.Handle, [figure().axes[0], "x", "v"], {}),
    "Sketch": (labkit.Sketch, [5.0, 3.0], {}),
    "affine": (labkit.affine, [linear, None, None], {}),
    "borders": (labkit.borders, [matrix], {}),
    "classify": (labkit.classify, [matrix, 1e-9], {}),
    "eigenlines": (labkit.eigenlines, [matrix, 1e-9], {}),
    "eigenvalues": (labkit.eigenvalues, [matrix], {}),
    "equilibrium": (labkit.equilibrium, [matrix, (1.0, 2.0), 1e-12], {}),
    "exact": (labkit.exact, [matrix, (1.0, 2.0), (0.0, 1.0), np.array([0, 1.0])], {}),
    "true_error": (labkit.true_error, [run], {}),
    "error_table": (labkit.error_table, [linear, 5.0, [("RK4", 0.1)]], {"start": {"x": 1.0}}),
    "check": (labkit.check, [4.7, 4.7475], {"rel": 1e-2, "abs": 0.0, "hint": "Think."}),
    "sweep": (
        labkit.sweep,
        [linear, 1.0, lambda run: run.final["x"]],
        {"start": {"x": 1.0}, "executor": None, "progress": False, "d": [0.1, 0.2], "v": 0.5}
        | {"rtol": 1e-6, "backend": "plain", "mode": "m", "points": 10},
    ),
    "Sweep.picture": (
        map_of.picture,
        ["d"],
        {"what": "", "label": "l", "log": ("d",), "even": (), "title": "T", "width": 5},
    ),
    "Sweep.to_csv": (map_of.to_csv, ["no/such/folder/file.csv"], {}),
    "section": (labkit.section, [run, 1.0, 0, 0.0], {}),
    "section by a function": (labkit.section, [run, event, 0, 0.0], {}),
    "periodic": (labkit.periodic, [swing, math.pi], {**LOOK, "d": 0.3}),
    "periodic by a section": (labkit.periodic, [swing, event], {"direction": 1, "horizon": 9.0}),
    "monodromy": (labkit.monodromy, [swing, math.pi], {**LOOK, "d": 0.3}),
    "canonical": (labkit.canonical, ["stable node", -1.0, -2.0], {}),
    "matrix_a": (labkit.matrix_a, [(1.0, 2.0), (2.0, -1.0)], {}),
    "matrix_b": (labkit.matrix_b, [(1.0, 2.0), (0.0, 1.0)], {}),
    "reflection": (labkit.reflection, [(1.0, 2.0)], {}),
    "rotation": (labkit.rotation, [0.3], {}),
    "design": (labkit.design, [matrix, turn], {}),
    "family": (labkit.family, ["stable node", "reflection"], family),
    "characteristic": (labkit.characteristic, ["relay"], {"K": 1.0}),
    "from_points": (labkit.from_points, [[(-1, -1), (1, 1)], None, "c"], {}),
    "movable": (labkit.movable, [[(-1, -1), (1, 1)], None, "c"], {}),
    "Characteristic()": (curve, [0.3], {}),
    "Characteristic.potential": (curve.potential, [0.3], {}),
    "Characteristic.describing": (curve.describing, [0.3], {}),
    "Characteristic.curve": (curve.curve, [(), 2.0, 1], {}),
    "Characteristic.modes": (curve.modes, [lambda t, s, p, F: (s.v, -F), ("x", "v")], {}),
    "assignment": (labkit.assignment, [3, 6], {}),
    "project": (labkit.project, [13], {}),
    "explore": (
        labkit.explore,
        [linear, 2.0, lambda run: labkit.curves(run, lambda run: {"x": (run.t, run["x"])})],
        {"sliders": {"d": (0, 1)}, "presets": {"a": {"d": 0.2}}, "verdict": lambda run: "good"}
        | {"choices": {"b": {"o": {"rtol": 1e-5}}}, "d": 0.3, "backend": "plain"},
    ),
}
WRONG = {
    **{"None": None, "text": "nonsense", "list": [1, 2, 3], "negative": -1.0, "nan": math.nan},
    **{"inf": math.inf, "nothing": {}, "unknown": {"nosuch": 1.0}, "misspelt": "RK54"},
    **{"no argument": lambda: 1.0, "object": object(), "ragged": [[1, 2], [3]], "[]": []},
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_arguments_work_or_are_said(name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # a wrong word may be the name of a file
    monkeypatch.setenv("LABKIT_CHECK", "0")  # the ends of sliders are tried elsewhere
    function, given, named = CALLS[name]
    calls = [(given[::-1], named, "swapped")] if len(given) > 1 else []
    for wrong, value in WRONG.items():
        for k in range(len(given)):
            calls.append(([*given[:k], value, *given[k + 1 :]], named, f"{k}: {wrong}"))
        calls += [(given, {**named, key: value}, f"{key}: {wrong}") for key in named]
    raw = []
    for positional, by_name, words in calls:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                function(*positional, **by_name)
        except ModelError as error:
            assert len(str(error)) > 10
        except Exception as error:
            raw.append(f"{words}: {type(error).__name__}: {error}")
    plt.close("all")
    assert not raw


def test_every_public_function_is_in_the_table():
    public = {name for name in labkit.__all__ if callable(getattr(labkit, name))}
    kinds = {each for each in public if isinstance(getattr(labkit, each), type)}
    missing = public - kinds - {name.split()[0] for name in CALLS}
    assert missing == {"catalogue", "choose", "decomposition", "describe", "check_design"}


@asked
def example(one: float, two: "dict[str, float] | None" = None, *more: str) -> float:
    """example(1.0, {"a": 2.0}) -> their sum.

    And so on.
    """
    return one + sum((two or {}).values()) + len(" ".join(more))


def test_the_words_name_the_argument_its_value_and_the_call():
    assert example(1.0, {"a": 2.0}, "b") == 4.0
    words = (
        r"""one of example must be a number, not None. It is called so: example\(1.0, \{"a": 2"""
    )
    with pytest.raises(ModelError, match=words):
        example(None)
    with pytest.raises(
        ModelError, match=r"two of example must be a dict \{name: a number\} or None"
    ):
        example(1.0, {"a": "x"})
    with pytest.raises(ModelError, match="more of example must be a text, not 3"):
        example(1.0, None, "a", 3)
    with pytest.raises(TypeError, match="missing 1 required"):
        example()
    with pytest.raises(
        ModelError, match=r"must be a function of one argument or None, not <lambda>\(\)"
    ):
        labkit.explore(linear, 2.0, lambda: 1.0)


def test_an_array_is_no_word():
    @asked
    def said(aloud: bool) -> str:
        """said(True) -> what is said."""
        return "yes" if aloud else ""

    with pytest.raises(ModelError, match=r"aloud of said must be True or False, not array"):
        said(np.array([1.0, 0.0]))


def test_an_error_inside_a_function_that_was_given_stays_what_it_is():
    for direction in (0, 1.0):  # 1.0 is no whole number by its kind, but not the cause
        with pytest.raises(ZeroDivisionError):
            labkit.section(run, lambda t, s, p: 1 / 0, direction)


def test_what_a_function_takes():
    assert takes(event, 3) and takes(math.sin, 1) and takes(print, 7) and not takes(event, 2)
    assert not takes("text", 1)


def test_a_start_that_is_no_dict_is_not_passed_over():
    for models in (linear, {"swing": swing, "linear": linear}):
        with pytest.raises(ModelError, match="start"):
            labkit.explore(models, 2.0, start=[1.0], backend="plain")


def test_places_of_another_kind_are_said():
    many = labkit.simulate_many(linear, 1.0, d=[0.1, 0.2], backend="plain")
    with pytest.raises(ModelError, match=r"which of __getitem__ must be a whole number"):
        many[[0, 1]]
    with pytest.raises(ModelError, match="at must be a pair of finite numbers"):
        labkit.check_design(matrix, (0, 0), np.eye(2), "stable spiral", "rotation", at=(1, 2, 3))
