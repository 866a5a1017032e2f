"""A notebook as a page that needs no network: formulas, pictures, folded code, contents."""

import base64
import re

import nbformat
import pytest

from labkit.model import ModelError
from labkit.page import formula, page, typeset

from .helpers import FOLDER, NOTEBOOKS, read, source

MATH = re.compile(r"\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
NOTHING = base64.b64encode(b"\x89PNG\r\n\x1a\n").decode()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    made = {}

    def write(name):
        if name not in made:
            made[name] = page(FOLDER / f"{name}.ipynb", tmp_path_factory.mktemp("page"))
        return made[name]

    return write


def test_formulas_become_mathml():
    assert formula("x^2") == "<math><msup><mi>x</mi><mn>2</mn></msup></math>"
    assert formula(r"\frac{1}{2}", display=True).startswith('<math display="block"><mfrac>')
    two = formula(r"\begin{aligned} \dot{x} &= v \\ \dot{v} &= -g \end{aligned}", display=True)
    assert two.count("<mtr>") == 2 and two.count("<mtd") == 4
    cases = formula(r"\begin{cases} 1 & x > 0 \\ 0 & \text{else} \end{cases}")
    assert cases.count("<mtr>") == 2 and "<mo>{</mo>" in cases
    assert formula(r"\begin{pmatrix} 0 & 1 \\ -1 & 0 \end{pmatrix}").count("<mtd>") == 4


def test_what_is_no_formula_is_shown_as_it_was_written():
    assert formula(r"\nosuchthing < 2") == r"<code>$\nosuchthing &lt; 2$</code>"


def test_formulas_in_html_outside_of_code():
    made = typeset("<td title='$a$'>$a &lt; b$</td><pre>cost $1, $2</pre><code>$x$</code> $$y$$")
    assert made.startswith("<td title='$a$'><math><mi>a</mi><mo>&lt;</mo><mi>b</mi></math></td>")
    assert "<pre>cost $1, $2</pre><code>$x$</code>" in made and made.endswith("</math>")
    assert 'display="block"' in made


def written(name):
    """All texts of a notebook that may hold formulas."""
    for cell in read(name)["cells"]:
        if cell["cell_type"] == "markdown":
            yield source(cell)
        for output in cell.get("outputs", []):
            for kind in ("text/markdown", "text/latex", "text/html"):
                yield "".join(output.get("data", {}).get(kind, ""))


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_every_formula_of_the_notebooks_is_understood(name):
    for text in written(name):
        text = re.sub(r"```.*?```|`[^`\n]*`|<(pre|code)>.*?</\1>", "", text, flags=re.DOTALL)
        for found in MATH.finditer(text):
            assert "<code>" not in formula(found[1] or found[2]), found[0]


@pytest.mark.parametrize("name", ["concepts/linear_systems", "part3/06_dc_dc_converter"])
def test_a_page_fetches_nothing_and_shows_formulas_pictures_and_contents(pages, browser, name):
    foreign, problems = [], []
    view = browser.new_page(viewport={"width": 1400, "height": 900})
    view.on("pageerror", lambda error: problems.append(str(error)))

    def catch(route):
        foreign.append(route.request.url)
        route.abort()

    view.route(lambda url: not url.startswith(("file:", "data:")), catch)
    view.goto(pages(name).as_uri())
    formulas = view.locator("math")
    assert formulas.count() > 50 and foreign == [] and problems == []
    sizes = formulas.evaluate_all("all => all.map((one) => one.getBoundingClientRect().width)")
    assert min(sizes) > 3
    # No formula is left as it was typed
    assert (
        view.evaluate("""() => {
        const copy = document.querySelector('main').cloneNode(true);
        copy.querySelectorAll('pre, code, math').forEach((one) => one.remove());
        return /\\$|\\\\(frac|dot|begin)/.test(copy.textContent);
    }""")
        is False
    )
    made = sum(
        "image/png" in output.get("data", {})
        for cell in read(name)["cells"]
        for output in cell.get("outputs", [])
    )
    wide = view.locator("main img").evaluate_all("all => all.map((one) => one.naturalWidth)")
    assert len(wide) == made and min(wide) > 200
    headings = [
        re.sub(r"\$.*?\$", "", line[3:])
        for cell in read(name)["cells"]
        if cell["cell_type"] == "markdown"
        for line in source(cell).splitlines()
        if line.startswith("## ")
    ]
    links = view.locator("nav a")
    assert links.count() == len(headings) > 5
    links.last.click()
    assert view.locator("h2").last.bounding_box()["y"] < 900
    # A line of text can be read: 60 to 100 characters
    assert view.locator("main p").first.bounding_box()["width"] < 800
    assert view.evaluate("document.documentElement.scrollWidth") <= 1400
    view.close()


def test_folded_code_alternative_texts_and_links(tmp_path, browser):
    note = nbformat.v4.new_notebook()
    shown, folded = nbformat.v4.new_code_cell("a = 1"), nbformat.v4.new_code_cell("drawing = 2")
    folded.metadata["jupyter"] = {"source_hidden": True}
    data = {"image/png": NOTHING, "text/plain": "figure"}
    more = {"image/png": {"alt": 'x "rises" & falls', "width": 300, "height": 200}}
    folded.outputs = [nbformat.v4.new_output("display_data", data, metadata=more)]
    shown.outputs = [
        nbformat.v4.new_output("display_data", {"text/latex": "$\\displaystyle \\sqrt{2}$"}),
        nbformat.v4.new_output("display_data", {"text/html": "<b>$\\sqrt{3}$</b>"}),
        nbformat.v4.new_output("display_data", {"text/markdown": "$$\\sqrt{4}$$"}),
    ]
    note.cells = [nbformat.v4.new_markdown_cell("## The $\\sqrt{x}$ law"), shown, folded]
    nbformat.write(note, tmp_path / "small.ipynb")
    view = browser.new_page()
    view.goto(page(tmp_path / "small.ipynb", tmp_path).as_uri())
    assert view.get_by_text("a = 1").is_visible() and not view.get_by_text("drawing").is_visible()
    view.get_by_text("code", exact=True).click()
    assert view.get_by_text("drawing").is_visible()
    image = view.get_by_role("img", name='x "rises" & falls')
    assert image.count() == 1 and image.get_attribute("width") == "300"
    assert view.locator("msqrt").count() == 5  # heading, contents, three outputs
    target = view.locator("nav a").get_attribute("href")
    assert view.locator(f"[id='{target[1:]}']").count() == 1
    view.close()


def test_a_page_that_cannot_be_written_says_so(tmp_path):
    with pytest.raises(ModelError, match="choose a folder that exists"):
        page(FOLDER / "start.ipynb", tmp_path / "missing")
    with pytest.raises(ModelError, match="No such file"):
        page(tmp_path / "missing.ipynb", tmp_path)
