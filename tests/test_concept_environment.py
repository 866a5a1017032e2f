"""concepts/environment: what it finds out about the tools is so.

Its flasher is the closed form, its planted mistakes are noticed when it says, its limits are real.
"""

import csv
import json
import re
from math import erfc, log, sqrt

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from labkit import Ended, ModelError, catalogue, characteristic, simulate
from labkit.__main__ import COMMANDS

from .helpers import read, source

NAME = "concepts/environment"
RC, TAU = 1.0, 0.01 / 1.01  # s: in the dark, and lit
LOW = 100 / 101  # V: where the lit lamp would settle


def flashes_by_scipy(end, Td=0.0, r=1e4, U=100.0):
    """Instants of the flashes, one leg after the other, at a tight tolerance."""
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-11}

    def until(level, sign, rate, t, V):
        def reached(t, V):
            return V[0] - level

        reached.terminal, reached.direction = True, sign
        done = solve_ivp(rate, (t, t + 100), [V], events=reached, **how)
        return done.t[-1], done.y[0, -1]

    def charge(t, V):
        return U - V

    def empty(t, V):
        return U - V - V / (r * 1e-6)

    found, t, V = [], 0.0, 0.0
    while t < end:
        t, V = until(80, 1, charge, t, V)
        if Td:
            done = solve_ivp(charge, (t, t + Td), [V], **how)
            t, V = t + Td, done.y[0, -1]
        found.append(t)
        t, V = until(50, -1, empty, t, V)
    return np.array([each for each in found if each < end])


@pytest.mark.parametrize(("Td", "r"), [(0.0, 1e4), (0.02, 1e4), (0.3, 1e4), (0.05, 2e5)])
def test_the_theory_and_the_flasher_are_what_scipy_finds(names, Td, r):
    exact = flashes_by_scipy(8.0, Td, r)
    p = names["ideal"].values({"Td": Td, "r": r})
    first, period = names["theory"](p)
    assert exact == pytest.approx(first + period * np.arange(len(exact)), abs=1e-9)
    run = simulate(names["ideal"], 8.0, Td=Td, r=r)
    assert run.events["flash"].t == pytest.approx(exact, abs=1e-7)


def test_the_schedule_is_met_and_the_counter_counts(names):
    run = names["run"]
    assert run.events["battery drops"].t.tolist() == [30.0]
    assert run.final["U"] == 75.0 and run.final["n"] == len(flashes_by_scipy(30.0, 0.02))
    assert run.final["V"] == pytest.approx(75.0, abs=1e-6)  # below ignition for ever
    before = run.at(run.events["flash"].t, side="before")["V"]
    assert before == pytest.approx(100 - 20 * np.exp(-0.02), abs=1e-6)  # after the dead time


def test_mistakes_are_noticed_when_it_says(names):
    when = {name: verdict[0] for name, verdict in names["verdicts"].items()}
    assert when == {
        "misspelt name": "before",
        "two values for one state": "before",
        "unit forgotten": "before",
        "starts beyond its guard": "before",
        "ageing battery": "during",
        "wrong sign of the lamp": "during",
        "flash that does not empty": "during",
        "very fast light meter": "during",
        "volts minus seconds": "never",
        "0.2 for 0.02": "never",
        "lamp goes out when it rises": "never",
    }
    assert names["count"] == {"before": 4, "during": 4, "never": 3}
    text = "".join(source(c) for c in read(NAME)["cells"] if c["cell_type"] == "markdown")
    assert "Eleven models" in text and len(when) == 11


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("misspelt name", "has no attribute 'v'"),
        ("two values for one state", "returns 2 values, but there are 1 states"),
        ("unit forgotten", "needs a unit"),
        ("starts beyond its guard", "guard of 'flash' is already 10"),
        ("ageing battery", "not a number: the flow of mode 'dark' is a complex number near t = 20"),
        ("flash that does not empty", "endless loop at t = 1.60944"),
        ("very fast light meter", "is stiff"),
    ],
)
def test_sentences_name_the_place(names, name, words):
    assert words in names["verdicts"][name][1]


def test_a_wrong_sign_lets_the_voltage_grow_beyond_all_numbers(names):
    run = simulate(names["wrong"]["wrong sign of the lamp"], 60.0, backend="plain")
    assert run.ended is Ended.DIVERGED and run["V"].max() > 1e200


def test_what_is_never_noticed_is_found_by_the_three_tests(names):
    wrong, scales, known_case = names["wrong"], names["scales"], names["known_case"]
    assert scales(names["flasher"]) and scales(wrong["0.2 for 0.02"])
    assert known_case(names["flasher"]) and not known_case(wrong["0.2 for 0.02"])
    assert not scales(wrong["volts minus seconds"])
    stuck = simulate(wrong["lamp goes out when it rises"], 5.0, backend="plain")
    assert "sliding" in stuck.ledger() and stuck.final["V"] == pytest.approx(80, abs=1e-9)


def test_the_stiff_model_is_cured_by_what_the_sentence_says(names):
    meter, cured = names["meter"], names["cured"]
    assert meter.ended is Ended.STIFF and "try method='Radau'" in meter.stopped
    assert cured.ended is Ended.FINISHED and cured.work.steps < 1000
    assert cured.final["w"] == pytest.approx(100 * (1 - np.exp(-5)), abs=1e-2)


def test_an_error_lists_the_characteristics_and_each_of_them_is_one():
    with pytest.raises(ModelError, match="there is no characteristic 'diode'") as error:
        characteristic("diode")
    there = re.findall(r"'([^']+)'", str(error.value))[1:]
    assert len(there) > 10
    for name in there:
        characteristic(name)


def test_cells_in_another_order_keep_an_old_number(names):
    assert names["stale"] == 2.0 and names["fresh"]["answer"] == 4.0


def test_the_file_holds_every_bit_and_how_it_was_made(names, tmp_path):
    run = names["run"]
    path = run.to_csv(tmp_path / "flasher.csv")
    with path.open(encoding="utf-8") as file:
        said = json.loads(file.readline().removeprefix("#"))
        rows = list(csv.DictReader(file))
    assert said["model"] == "flasher" and said["parameters"]["Td"] == 0.02
    assert [float(row["V [V]"]) for row in rows] == run["V"].tolist()
    assert names["difference"] == 0.0


def test_a_sweep_counts_what_the_theory_says(names):
    columns = names["rates"].columns()
    for R, count in zip(columns["R"], columns["flashes"], strict=True):
        first, period = names["theory"](names["ideal"].values({"R": R}))
        assert count == 1 + (60 - first) // period


def test_the_commands_that_it_names_exist():
    text = " ".join(source(c) for c in read(NAME)["cells"] if c["cell_type"] == "markdown")
    for command in ("new", "report", "site", "key", "run"):
        assert command in COMMANDS and f"`{command}`" in text.replace("python -m labkit ", "")


def test_a_flag_invents_flashes_and_events_do_not(names):
    exact = flashes_by_scipy(60.0)
    assert len(exact) == names["true"]
    for rtol in (1e-3, 1e-6, 1e-9):
        times, _, listed = names["with_a_flag"](rtol)
        assert len(times) > 2 * len(exact) and listed == 0
    for program in ("with_events", "with_labkit"):
        times, _ = names[program](1e-9)
        assert times == pytest.approx(exact, abs=1e-6)


def test_lines_are_counted_as_they_stand(names):
    cells = [source(c) for c in read(NAME)["cells"] if c["cell_type"] == "code"]
    for program, count in names["lines"].items():
        (cell,) = (text for text in cells if text.startswith(f"def {program}("))
        assert count == len(cell.strip().splitlines())


def test_the_loop_by_hand_is_right_and_a_delay_breaks_down(names):
    by_quadrature, _ = quad(lambda i: (1 + 1 / (i + 0.01)) / i, 0.5, 2.0, epsabs=1e-12)
    assert names["t_at"](0.5) == pytest.approx(by_quadrature, rel=1e-10)
    assert names["right"] == pytest.approx(0.5, abs=1e-8)
    for h in (0.02, 0.003):
        run = simulate(names["cut"], by_quadrature, h=h, backend="plain")
        assert run.ended is Ended.NOT_A_NUMBER and run.t[-1] > names["t_at"](0.99)
    early = simulate(names["cut"], names["t_at"](1.5), h=0.001, backend="plain").final
    assert early["i"] == pytest.approx(1.5, abs=0.01)  # before that it does well


def test_the_rod_is_the_matrix_exponential_and_the_middle_the_mirrored_sources(names):
    images = sum(
        erfc((2 * k + 0.5) / sqrt(0.2)) - erfc((2 * k + 1.5) / sqrt(0.2)) for k in range(5)
    )
    assert names["middle"] == pytest.approx(images, abs=1e-12)
    for n, run in names["rods"].items():
        A = (n + 1) ** 2 * (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n))
        rest = np.arange(1, n + 1) / (n + 1)
        u = rest - expm(0.05 * A) @ rest
        assert list(run.final.values()) == pytest.approx(u, abs=1e-7)
        assert run.work.backend == "plain"


def test_too_many_events_are_said_and_kept(names):
    few, many = names["few"], names["many"]
    assert few.ended is many.ended is Ended.TOO_MANY_EVENTS
    assert len(few.events) == 200 and len(many.events) == 2000
    price = [run.work.evaluations / len(run.events) for run in (few, many)]
    assert price[0] == pytest.approx(price[1], rel=0.1)


def test_the_panel_follows_and_its_verdict_knows_the_theory(names):
    draw, verdict, flasher = names["draw"], names["verdict"], names["flasher"]
    run = simulate(flasher, 10.0, points=800)
    views = draw(run)
    late = simulate(flasher, 10.0, points=800, Td=0.3)
    for view in views:
        view.update(late)
    flash = views[1].drawn["V"].get_ydata()
    assert flash.max() == pytest.approx(100 - 20 * np.exp(-0.3), abs=0.1)  # a higher flash
    words = verdict(late)
    apart, theory = (float(x) for x in re.findall(r"(\d\.\d{4}) s", words))
    assert apart == pytest.approx(theory, abs=1e-4)
    assert "then lit" in verdict(simulate(flasher, 10.0, r=1.2e6))


def test_tasks_know_their_answers(names):
    solutions = names["solutions"]
    measured = np.diff(flashes_by_scipy(8.0, 0.05))
    assert measured == pytest.approx(solutions["period"], abs=1e-9)
    settles = 100 * solutions["lit"] / (1e6 + solutions["lit"])
    assert settles == pytest.approx(50.0)
    period = RC * log(50 / 20) + TAU * log((80 - LOW) / (50 - LOW))
    seconds = RC * log(100 / 20) + 49_999 * period
    assert solutions["events"] == pytest.approx(seconds / 3600, rel=1e-3)


def test_the_catalogue_lists_it():
    assert "[The environment](concepts/environment.ipynb)" in catalogue()._repr_markdown_()
