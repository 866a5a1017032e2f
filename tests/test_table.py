"""Tables of results: numbers that can be read, and the same words in HTML and in plain text."""

import math
from html.parser import HTMLParser

import numpy as np
import pytest

from labkit import ModelError, Table
from labkit.table import prefixed


def column(values, unit="", form=None):
    """Head and cells of a table of one column."""
    return [row[0] for row in Table([("x", unit, form)], [[v] for v in values]).cells]


@pytest.mark.parametrize(
    ("values", "unit", "form", "shown"),
    [
        ([2e-4, 1e-4, 5e-5, 2e-5], "s", None, ["x [µs]", "200", "100", "50", "20"]),
        ([0.179, 0.0894, 0.0447], "V", None, ["x [V]", "0.1790", "0.0894", "0.0447"]),
        ([0.0089, 0.001], "V", None, ["x [mV]", "8.9", "1.0"]),
        ([12345.0, 5000.0], "m", None, ["x [km]", "12.35", "5.00"]),
        ([12345.0, 5000.0], "kg", None, ["x [kg]", "12345", "5000"]),
        ([12345.0], "m²", None, ["x [m²]", "12345"]),
        ([1e-6], "m**2", None, ["x [m**2]", "1.000e−06"]),
        ([2e-3], "m^2/s", None, ["x [m^2/s]", "0.002"]),
        ([2e-3], "N*m", None, ["x [mN*m]", "2"]),
        ([2e-3], "m/s**2", None, ["x [mm/s**2]", "2"]),
        ([2e-3], "m/s", None, ["x [mm/s]", "2"]),
        ([2.2e-10], "F", None, ["x [pF]", "220"]),
        ([1e-3, 2.345e-13], "V", None, ["x [V]", "1.0e−03", "2.3e−13"]),
        ([1e-3, 0.0, 2.345e-13], "V", 3, ["x [V]", "1.00e−03", "0", "2.35e−13"]),
        ([1 / 3, 1000.0], "", None, ["x", "0.33", "1000.00"]),
        ([39.5512, 0.2], "V", ".3f", ["x [V]", "39.551", "0.200"]),
        ([1e-4], "s", ".1e", ["x [s]", "1.0e−04"]),
        ([3e-13, 1e-12, 0.0, 2.0], "V", "<", ["x [V]", "< 1e−12", "< 1e−12", "< 1e−15", "< 1e+01"]),
        ([1, 12345, 10**6], "", None, ["x", "1", "12345", "1000000"]),
        ([-0.0, -1e-9], "", ".2f", ["x", "0.00", "0.00"]),
        ([-1.5, math.nan, None, math.inf], "", None, ["x", "−1.5", "–", "–", "∞"]),
        ([True, np.bool_(False)], "", None, ["x", "yes", "no"]),
        (["none", 3.0], "", None, ["x", "none", "3"]),
        ([3.0, 2.123456], "", 2, ["x", "3.0", "2.1"]),
        (np.array([1.0, 2.0]), "s", None, ["x [s]", "1", "2"]),
        (np.array([], dtype=float), "s", None, ["x [s]"]),
        ([0.0, 0.0], "s", None, ["x [s]", "0", "0"]),
    ],
)
def test_numbers_of_a_column(values, unit, form, shown):
    assert column(values, unit, form) == shown


def test_the_prefix_keeps_the_quantity():
    for power in range(-17, 16):
        scale, unit = prefixed(3.0 * 10.0**power, "V")
        written = 3.0 * 10.0**power / scale
        assert written * scale == pytest.approx(3.0 * 10.0**power, rel=1e-12)
        if -15 <= power < 15:
            assert 0.01 <= written < 1e4, (power, unit)
    assert prefixed(0.0, "s") == (1.0, "s") and prefixed(math.inf, "s") == (1.0, "s")


def test_plain_text_is_aligned():
    table = Table(
        {"method": "", "step": "s", "error": ("V", "<")},
        [("RK4", 1e-5, 3e-9), ("DOP853", 5e-6, 2e-13)],
        "What a step costs",
    )
    assert repr(table).splitlines() == [
        "What a step costs",
        "method  step [µs]  error [V]",
        "RK4            10    < 1e−08",
        "DOP853          5    < 1e−12",
    ]
    assert len(table) == 2 and str(table) == repr(table)


class Reader(HTMLParser):
    """Opens and closes what it reads, and keeps the words."""

    def __init__(self, text):
        super().__init__()
        self.open, self.found = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.found.append(data)


def test_html_is_a_table_with_caption_heads_and_sides():
    table = Table(["name", ("a < b", "V")], [["`x` & **y**, $v_{1} < 2$", 1.5]], "A <caption>")
    read = Reader(table._repr_html_())
    assert read.open == [] and {"A <caption>", "a < b [V]", "1.5"} <= set(
        word for word in read.found if isinstance(word, str)
    )
    heads = [attrs for tag, attrs in (x for x in read.found if x != str(x)) if tag == "th"]
    assert [head["scope"] for head in heads] == ["col", "col"]
    assert [head["style"] for head in heads] == ["text-align:left", "text-align:right"]
    inner = table._repr_html_()
    assert "<code>x</code> &amp; <strong>y</strong>, $v_{1} &lt; 2$" in inner


def test_rows_may_be_made_once():
    table = Table(["a", "b"], zip([1.0, 2.0], ["x", "y"], strict=True))
    assert repr(table) == repr(table) and len(table) == 2


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: Table(["a", "b"], [[1]], "T"),
            r"row 0 of the table 'T' has 1 cells, but there are 2",
        ),
        (lambda: column([1.0], "", "wide"), "column 'x' has the form 'wide'"),
        (lambda: column([1.0], "", 0), "column 'x' has the form 0"),
    ],
)
def test_a_wrong_table_is_refused(make, words):
    with pytest.raises(ModelError, match=words):
        make()
