"""Recorded panels: what they hold is what the panel shows, in Python and in a browser."""

import json
import zlib

import numpy as np
import pytest

from labkit import Mode, Parameter, System, explore, figure, time_plot
from labkit.recorded import NEW_STROKE, RATIO, record

from .benchmarks.recorded import page_of


@pytest.fixture(autouse=True)
def no_check(monkeypatch):
    monkeypatch.delenv("LABKIT_CHECK", raising=False)


def refuses(t, s, p):
    return s.v, -(p.omega**2) * s.x


def begins(t, s, p):
    return "swings" if p.omega < 5.5 else "nowhere"


system = System(
    "swing",
    {"x": "m", "v": "m/s"},
    {"omega": Parameter(2.0, "1/s", "frequency", 0.5, 6.0)},
    [Mode("swings", refuses)],
    start={"x": 1.0, "v": 0.0},
    mode=begins,
)


def panel(**more):
    return explore(
        system,
        8.0,
        lambda run: time_plot(run, "x"),
        verdict=lambda run: f"x ends at {run.final['x']:.6f} m",
        presets={"slow": {"omega": 0.5}, "far": {"x": 3.0, "t_end": 12.0}},
        **more,
    )


def read(tape):
    """The head, and for each part its points, decoded without the player."""
    text, _, data = zlib.decompress(tape).partition(b"\n")
    head = json.loads(text)
    count = sum(part["points"] for part in head["parts"])
    planes = np.frombuffer(data[: 4 * count], np.uint8).reshape(4, count).astype(np.uint16)
    steps = np.stack([planes[k] | planes[k + 1] << 8 for k in (0, 2)], axis=1).view("<i2")
    points, at = [], 0
    for part in head["parts"]:
        own = steps[at : at + part["points"]].astype(float)
        up = own[:, 0] == NEW_STROKE
        own[~up] = np.cumsum(own[~up], axis=0) / head["grid"]
        own[up, 0] = np.nan
        points.append(own)
        at += part["points"]
    return head, points


def test_frames_are_the_pictures_of_the_panel():
    one, other = panel(), panel()
    head, points = read(record(one))
    assert one.values == one.defaults and one.t is None
    for value, number in head["sliders"]["start.x"][::5]:
        other._as_at_first()
        other._resize(0.7)
        other._show(other.defaults | {"start.x": value})
        message, (floats, _) = other._picture(RATIO, True, True)
        frame = head["frames"][number]
        assert frame["verdict"] == message["verdict"] and frame["values"] == message["values"]
        shown = np.frombuffer(floats, "<f4").reshape(-1, 2)
        kept = np.concatenate([points[part] for _, part in frame["order"]])
        np.testing.assert_array_equal(np.isnan(shown), np.isnan(kept))
        np.testing.assert_allclose(kept, shown, atol=0.51 / head["grid"])


def test_the_letters_of_a_wide_picture_are_legible_on_a_page_and_on_a_phone(browser, tmp_path):
    shown = explore(system, 8.0, lambda run: time_plot(run, "x", width=14.0), method=False)
    inches = tuple(shown.figure.get_size_inches())
    place = tmp_path / "wide.html"
    place.write_text(page_of(shown), encoding="utf-8")
    assert tuple(shown.figure.get_size_inches()) == pytest.approx(inches)  # as before
    for width, least in ((864, 10.0), (390, 8.4)):
        context = browser.new_context(viewport={"width": width, "height": 768})
        page = context.new_page()
        page.goto(place.as_uri())
        page.locator("canvas[data-seq]").wait_for()
        boxes = [page.locator(part).bounding_box() for part in ("canvas", ".labkit-side")]
        letters = 9.5 * 96 / 72 * (0.85 / (848 / 1344)) * boxes[0]["width"] / 1344
        assert letters >= least, width
        assert boxes[1]["y"] >= boxes[0]["y"] + boxes[0]["height"]  # sliders below, and in view:
        assert boxes[1]["x"] + boxes[1]["width"] <= width
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        context.close()


def test_positions_go_from_end_to_end_through_the_first_value():
    head, _ = read(record(panel()))
    values = [value for value, _ in head["sliders"]["p.omega"]]
    assert values[0] == 0.5 and values[-1] == 6.0 and 2.0 in values
    assert 20 <= len(values) <= 23 and values == sorted(values)
    assert head["sliders"]["p.omega"][values.index(2.0)][1] == head["first"]
    tolerances = [value for value, _ in head["sliders"]["rtol"]]
    assert tolerances[0] == 1e-12 and tolerances[-1] == 1e-2 and 1e-8 in tolerances
    assert len(head["sliders"]["method"]) == len(head["spec"]["controls"][-2]["options"])
    assert "step" not in head["sliders"]
    assert len(head["instants"]) == 100 and head["instants"][-1][0] == 8.0


def test_what_the_model_refuses_keeps_its_sentence():
    head, _ = read(record(panel()))
    last = head["frames"][head["sliders"]["p.omega"][-1][1]]
    assert "nowhere" in last["error"]


def test_what_pictures_share_is_kept_once():
    tape = record(panel())
    head, _ = read(tape)
    used = [part for frame in head["frames"] for _, part in frame.get("order", ())]
    assert len(used) > 3 * len(head["parts"]) and len(tape) < 1_500_000


def test_a_picture_of_too_many_points_is_kept_as_a_bitmap(monkeypatch):
    monkeypatch.setattr("labkit.panel.MOST", 10)
    head, _ = read(record(panel(sliders=["omega"]), positions=3))
    frame = head["frames"][head["first"]]
    assert frame["mime"] == "image/jpeg" and head["images"][frame["bitmap"]] > 1000


def test_points_far_outside_are_kept_as_they_are():
    """A difference of two bytes reaches some 4000 pixels: beyond it a stroke would lose its way."""

    def draw(run):
        return time_plot(run, "x", axes=figure(width=22, height=3).axes[0])

    tape = record(explore(system, 8.0, draw, sliders=["omega"]), positions=3)
    head, _ = read(tape)
    far = [part for part in head["parts"] if "raw" in part]
    assert far and all(head["images"][part["raw"]] % 8 == 0 for part in far)
    text, _, data = zlib.decompress(tape).partition(b"\n")
    before = 4 * sum(part["points"] for part in head["parts"])
    before += sum(head["images"][: far[0]["raw"]])
    raw = np.frombuffer(data[before : before + head["images"][far[0]["raw"]]], "<f4")
    assert np.nanmax(np.abs(raw)) > 4000
    assert not any("mime" in frame for frame in head["frames"])


@pytest.fixture(scope="module")
def page(tmp_path_factory, browser):
    """A page with a recorded panel, opened from the disk without a network."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("LABKIT_CHECK", raising=False)  # one end of a slider is refused
        shown = panel()
    place = tmp_path_factory.mktemp("recorded") / "page.html"
    place.write_text(page_of(shown), encoding="utf-8")
    context = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True)
    view = context.new_page()
    problems = []
    view.on("pageerror", lambda error: problems.append(str(error)))
    view.goto(place.as_uri())
    view.locator("canvas[data-seq]").wait_for()
    yield view
    assert not problems
    context.close()


def verdict(page):
    return page.locator(".labkit-verdict").inner_text()


def test_a_slider_moves_without_python(page):
    page.locator("input[aria-label^='x '].labkit-range").focus()
    before = page.evaluate("document.querySelector('canvas').toDataURL()")
    page.keyboard.press("End")
    page.wait_for_function("!document.querySelector('.labkit-verdict').innerText.includes('1.0')")
    own = panel()
    own._show(own.defaults | {"start.x": next(c.high for c in own.controls if c.name == "x")})
    assert own.words in verdict(page)
    page.wait_for_timeout(100)
    assert page.evaluate("document.querySelector('canvas').toDataURL()") != before


def test_a_picture_has_the_pixels_of_the_page_and_is_made_once(page):
    """A recording is of two pixels to one, and pages show it smaller: most would be thrown away."""
    canvas = page.locator("canvas")
    size = "canvas => [canvas.width, canvas.clientWidth * devicePixelRatio]"
    mine, shown = canvas.evaluate(size)
    assert abs(mine - shown) <= 1
    page.evaluate("""() => {
        window.made = 0;
        window.Path2D = class extends Path2D {
            constructor(...all) {
                super(...all);
                window.made += 1;
            }
        };
    }""")
    made = []
    for text in ("0.5", "2", "0.5", "2"):
        before = canvas.get_attribute("data-seq")
        page.get_by_label("value of ω").fill(text)
        page.keyboard.press("Enter")
        page.wait_for_function(f"document.querySelector('canvas').dataset.seq > {before}")
        made.append(page.evaluate("made"))
    assert 0 < made[1] == made[2] == made[3]


def test_presets_reset_and_one_slider_at_a_time(page):
    page.get_by_role("button", name="far").click()
    own = panel()
    own._show(own.defaults | own.presets["far"])
    page.get_by_text(own.words).wait_for()
    field = page.get_by_label("value of ω")
    field.fill("0.5")
    field.press("Enter")
    own._show(own.defaults | {"p.omega": 0.5})  # the start is back at its first value
    page.get_by_text(own.words).wait_for()
    assert page.get_by_label("value of x").input_value() == "1"
    page.get_by_role("button", name="Reset").click()
    page.get_by_text(own.first_run and own.verdict(own.first_run)).wait_for()
    assert field.input_value() == "2"


def test_another_size_of_the_window_changes_nothing_else(page):
    page.get_by_role("button", name="slow").click()
    own = panel()
    own._show(own.defaults | own.presets["slow"])
    page.get_by_text(own.words).wait_for()
    before = page.locator("canvas").get_attribute("data-seq")
    page.set_viewport_size({"width": 700, "height": 900})
    page.wait_for_function(f"document.querySelector('canvas').dataset.seq > {before}")
    assert own.words in verdict(page) and page.get_by_label("value of ω").input_value() == "0.5"
    page.set_viewport_size({"width": 1280, "height": 900})
    page.get_by_role("button", name="Reset").click()


def test_play_moves_the_cursor_and_hands_of_the_kernel_are_not_offered(page):
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("document.querySelector('.labkit-reading').innerText.includes('t = ')")
    page.get_by_role("button", name="Pause").click()
    names = page.locator(".labkit-bar:not(.labkit-presets) button").all_inner_texts()
    assert names == ["▶ Play", "Reset", "Full screen"]
    assert "one slider at a time" in page.locator(".labkit-foot").inner_text()


def test_a_position_that_the_model_refuses_says_why(page):
    field = page.get_by_label("value of ω")
    field.fill("6")
    field.press("Enter")
    page.get_by_text("nowhere").wait_for()
    field.fill("2")
    field.press("Enter")
    page.wait_for_function("!document.querySelector('.labkit-error')")
