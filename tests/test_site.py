"""The site: pages with moving panels, links, search, all from a disk without a network."""

import json
import re

import nbformat
import pytest

from labkit import ModelError
from labkit.site import _finish, make_page, site

from .test_report import ONE, TWO, write

START = [
    "# Welcome\n\n[the first](part1/one.ipynb), [again](part1/one.ipynb#2-The-run)",
    "print('no project')",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("where") / "public"
    (source / "part1").mkdir()
    write(source / "start.ipynb", START)
    write(source / "part1" / "one.ipynb", [*ONE, "# End\n\n[Back](../start.ipynb)"])
    write(source / "part1" / "two.ipynb", TWO)
    said = []
    return source, folder, site(folder, source, said.append), said


def test_a_notebook_that_fails_is_named_and_the_others_are_written(made):
    source, folder, failed, said = made
    assert failed == 1 and len(said) == 3
    (line,) = (line for line in said if "failed" in line)
    assert "part1/two failed: ZeroDivisionError: division by zero" in line
    assert (folder / "index.html").is_file() and (folder / "part1" / "one.html").is_file()
    assert not (folder / "part1" / "two.html").exists()


def test_it_opens_from_a_disk_and_its_panels_move(made, browser):
    context = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True)
    view, problems = context.new_page(), []
    view.on("pageerror", lambda error: problems.append(str(error)))
    view.on("requestfailed", lambda request: problems.append(request.url))
    view.goto((made[1] / "index.html").as_uri())
    view.fill("#labkit-search", "swing stiffness")
    assert view.locator("#labkit-found li").all_inner_texts() == ["First: a swing"]
    view.fill("#labkit-search", "swing nothing-like-it")
    assert view.locator("#labkit-found li").all_inner_texts() == ["no page has all these words"]
    view.get_by_role("link", name="again").click()
    assert view.url.endswith("part1/one.html#2-The-run")
    view.locator(".labkit-recording").scroll_into_view_if_needed()
    view.locator("canvas[data-seq]").wait_for()
    view.get_by_label("k stiffness").focus()
    view.keyboard.press("End")
    view.wait_for_function("document.querySelector('.labkit-value').value === '9'")
    view.get_by_role("link", name="Back").click()
    assert view.url.endswith("/index.html")
    assert not problems
    context.close()


def test_only_what_has_changed_is_made_again(made):
    source, folder, _, _ = made
    said = []
    assert site(folder, source, said.append) == 1 and len(said) == 1  # the broken one
    write(source / "part1" / "two.ipynb", TWO[:3])
    assert site(folder, source, said.append) == 0 and "part1/two.html" in said[-1]
    assert site(folder, source, said.append) == 0 and len(said) == 2
    (source / "part1" / "two.ipynb").unlink()
    site(folder, source, said.append)
    assert not (folder / "part1" / "two.html").exists()
    assert set(json.loads((folder / "labkit-site.json").read_text())) == {"start", "part1/one"}


def test_what_pages_share_stands_in_one_file(made):
    page = (made[1] / "part1" / "one.html").read_text(encoding="utf-8")
    assert len(re.sub(r"<script type=.*?</script>|<img[^>]*>", "", page, flags=re.S)) < 60_000
    assert 'href="../labkit.css"' in page and 'src="../labkit.js"' in page


def test_links_to_names_of_all_kinds(tmp_path):
    name = 'a "b" & <c> #1 50% übung?'
    (tmp_path / f"{name}.html").write_text("<h1>It</h1><main>words</main>")
    _finish(tmp_path, [name])
    link = "a%20%22b%22%20%26%20%3Cc%3E%20%231%2050%25%20%C3%BCbung%3F.html"
    assert f'href="{link}"' in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert f'["{link}",' in (tmp_path / "labkit-search.js").read_text(encoding="utf-8")


def test_the_first_page_is_the_start_or_an_index_of_ones_own(tmp_path):
    def made(name, text):
        cells = [nbformat.v4.new_markdown_cell(text)]
        make_page(nbformat.v4.new_notebook(cells=cells), tmp_path / "x.ipynb", name, tmp_path)
        return (tmp_path / f"{name}.html").read_text(encoding="utf-8")

    text = made("part1/one", "[a](../start.ipynb#To) [b](two.ipynb#To) [c](https://x.org/d.ipynb)")
    for link in ("../index.html#To", "two.html#To", "https://x.org/d.ipynb"):
        assert f'href="{link}"' in text
    made("index", "# My own words")
    _finish(tmp_path, ["index"])
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "My own words" in text and "labkit-search.js" in text


def test_an_interrupted_site_is_a_site(tmp_path, monkeypatch):
    write(tmp_path / "one.ipynb", TWO[:3])

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("labkit.site.in_parallel", stop)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            site(tmp_path / "public", tmp_path)


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ModelError, match="holds no site of labkit"):
        site(tmp_path)
    with pytest.raises(ModelError, match="no notebooks"):
        site(tmp_path / "public", tmp_path)
