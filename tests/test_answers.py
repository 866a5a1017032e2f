"""What `check` says to a student: right, wrong with a hint, no answer yet; never an exception."""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from labkit import check
from labkit.answers import MIME

SIZES = st.floats(1e-200, 1e200) | st.floats(-1e200, -1e-200)


@given(SIZES, st.floats(1e-9, 0.5), st.floats(-2, 2))
def test_a_number_is_right_within_rel_of_the_right_one(right, rel, off):
    found = check(right * (1 + rel * off), right, rel=rel)
    if abs(abs(off) - 1) > 1e-6:
        assert found.ok is (abs(off) < 1) and bool(found) is found.ok


@given(SIZES, st.integers(1, 30))
def test_a_sign_or_a_unit_that_is_wrong_is_named(right, power):
    assert not check(-right, right) and "sign" in check(-right, right).text
    assert f"10^{{{power}}}" in check(right * 10.0**power, right).text
    assert f"10^{{−{power}}}" in check(right / 10.0**power, right).text


@pytest.mark.parametrize("answer", [None, ..., "", "  ", [1.0, None]])
def test_no_answer_yet_is_neither_right_nor_wrong(answer):
    found = check(answer, [1.0, 2.0] if isinstance(answer, list) else 4.7, hint="Add them.")
    assert found.ok is None and not found and "No answer yet" in repr(found)
    assert "Add them" not in found.text


@pytest.mark.parametrize(
    "answer",
    [
        "4.7",
        [4.7],
        True,
        float("nan"),
        float("inf"),
        print,
        {},
        {"a": 1},
        np.ones((2, 2)),
        1j,
        b"4",
    ],
)
def test_what_is_no_number_gets_a_sentence_and_the_hint(answer):
    found = check(answer, 4.7, hint="In seconds.")
    assert found.ok is False and found.text.endswith("In seconds.") and repr(found)[0] == "✗"


def test_an_answer_that_raises_when_it_is_used_gets_a_sentence_too():
    class Odd:
        def __float__(self):
            raise RuntimeError("no")

    assert check(Odd(), 4.7).ok is False and "RuntimeError" in check(Odd(), 4.7).text


@pytest.mark.parametrize("four", [4, 4.0, Fraction(4), np.float32(4), np.int64(4), sp.Integer(4)])
def test_numbers_of_every_kind_are_numbers(four):
    assert check(four, 4.0) and check(4.0, four) and not check(four, 5.0)


def test_zero_needs_an_absolute_width_and_complex_numbers_are_compared_as_they_are():
    assert not check(1e-9, 0.0) and check(1e-9, 0.0, abs=1e-6) and check(0, 0)
    assert check(1 + 2j, 1 + 2j) and not check(1 - 2j, 1 + 2j) and not check(1.0, 1 + 2j)


def test_words_are_read_as_a_teacher_reads_them():
    assert check(" Longer. ", "longer") and check("limit  cycle", {"limit cycle", "cycle"})
    assert not check("shorter", "longer") and "quotes" in check(3, "longer").text
    assert "quotes" in check("4.7", 4.7).text  # a number in quotes; and "never", where it is asked
    assert check("never", 4.7, hint="It ends.").text == "`'never'` is not right yet. It ends."


def test_yes_or_no():
    assert check(True, True) and check(np.bool_(False), False) and not check(True, False)
    assert "neither" in check(1, True).text and check(False, np.bool_(False))


def test_several_values_in_order_say_which_are_wrong():
    assert check((1, 2.001), [1, 2]) and check(np.array([1, 2]), (1, 2))
    assert check(["node", 2], ("node", 2)) and "2 of 2" in check(["node", 3], ("node", 2)).text
    assert "not 3" in check([1, 2, 3], [1, 2]).text and "2 asked" in check(5, [1, 2]).text


def test_a_right_answer_that_came_out_as_nothing_is_said():
    assert "nothing to compare" in check(1.0, float("nan")).text
    assert "nothing to compare" in check(1.0, None).text


def test_it_shows_itself_in_markdown():
    assert check(4.7, 4.7)._repr_markdown_() == "**✓** `4.7` is right."


def test_what_a_report_lists(monkeypatch):
    made = check([1.0, np.float64(2)], [1, 2.123456789])
    assert made._repr_mimebundle_() == {}
    monkeypatch.setenv("LABKIT_RECORD", "1")
    assert made._repr_mimebundle_() == {
        MIME: {"ok": False, "answer": "1, 2", "right": "1, 2.12346", "within": "1 %"}
    }
    assert check(None, 1 - 2j)._repr_mimebundle_()[MIME]["right"] == "1-2j"
    assert check("so", {"so"})._repr_mimebundle_()[MIME]["right"] == "so"
    assert check({"so", 1}, 1.0)._repr_mimebundle_()[MIME]["answer"] == "1, so"
    assert check(True, np.True_)._repr_mimebundle_()[MIME] == {
        "ok": True,
        "answer": "True",
        "right": "True",
        "within": "",
    }


@pytest.mark.parametrize(
    "right, allowed, words",
    [
        (4.7, {}, "1 %"),
        (4.7, {"rel": 2e-3}, "0.2 %"),
        (7, {"abs": 0.5}, "0.5"),  # more than 1 % of it
        (3 - 4j, {"abs": 0.01, "rel": 0.05}, "5 %"),
        ([0, 100], {"abs": 0.5}, "0.5 or 1 %"),
        (("node", 2.0), {}, "1 %"),
        ("longer", {}, ""),
        ({"limit cycle", "cycle"}, {}, ""),
        (True, {}, ""),
    ],
)
def test_what_was_allowed_is_said_for_the_report(right, allowed, words):
    assert check(right, right, **allowed).within == words == check(None, right, **allowed).within
