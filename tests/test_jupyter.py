"""What a Jupyter server of the environment does with notebooks, however it was started."""

import contextlib
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import venv
from pathlib import Path

import jupyter_server
import nbformat
import psutil
import pytest

from labkit import __main__ as main
from labkit.notebooks import WIDGET

from .helpers import FOLDER, ROOT
from .lab import open_notebook, run_all, running_lab

TOKEN = secrets.token_hex(16)
KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def ask(address, method="GET", data=None, **headers):
    request = urllib.request.Request(
        address, data, method=method, headers={"Authorization": f"token {TOKEN}", **headers}
    )
    with urllib.request.urlopen(request, timeout=120) as answer:
        return answer.read().decode(), answer.headers


@contextlib.contextmanager
def started(command, address, log, **options):
    """The process of a server once it answers; its group ends with the test, come what may."""
    with (
        open(log, "w") as out,
        subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, **options) as server,
    ):
        try:
            port = int(address.rsplit(":", 1)[1])

            def answers():
                assert server.poll() is None, log.read_text()
                with socket.socket() as door:
                    return door.connect_ex(("127.0.0.1", port)) == 0

            assert until(answers, 240), log.read_text()  # the engine may have to be compiled
            yield server
        finally:
            if server.poll() is None:
                server.terminate()


# ---- any server


@pytest.fixture
def plain(tmp_path):
    """A Jupyter server as `jupyter server` or `jupyter lab` starts it in an environment of labkit.

    The environment is a new one that borrows the packages of this one.
    """
    place = tmp_path / "env"
    venv.create(place, with_pip=False, symlinks=os.name != "nt")
    (site,) = place.glob("Lib/site-packages" if os.name == "nt" else "lib/*/site-packages")
    packages = Path(jupyter_server.__file__).parent.parent
    (site / "borrowed.pth").write_text(f"{packages}\n{ROOT}\n")
    main.register(place)
    folder = tmp_path / "notebooks"
    folder.mkdir()
    address = f"http://127.0.0.1:{free_port()}"
    own = {f"JUPYTER_{key}": str(tmp_path / key) for key in ("CONFIG_DIR", "DATA_DIR")}
    borrowed = {"JUPYTER_PATH": str(Path(sys.prefix) / "share" / "jupyter")}
    command = [
        *(str(main.venv_python(place)), "-m", "jupyter_server", "--allow-root", "--no-browser"),
        *(f"--ServerApp.root_dir={folder}", f"--ServerApp.port={address.rsplit(':', 1)[1]}"),
        f"--IdentityProvider.token={TOKEN}",
    ]
    with started(command, address, tmp_path / "log", env=os.environ | own | borrowed, cwd=folder):
        yield address, folder


def saved_elsewhere():
    """A notebook as another program saves it: a live panel, versions, a formula."""
    note = nbformat.v4.new_notebook()
    note.metadata |= {
        "kernelspec": KERNEL,
        "language_info": {"name": "python", "version": "3.0"},
        "widgets": {"state": {}},
    }
    data = {"image/png": "iVBORw0KGgo=", "text/plain": "panel", WIDGET: {"model_id": "12ab"}}
    more = {"image/png": {"alt": "r < 2 & a spiral"}}
    output = nbformat.v4.new_output("display_data", data, metadata=more)
    note.cells = [
        nbformat.v4.new_markdown_cell("## One\n\nthe root $\\sqrt{2}$", id="a"),
        nbformat.v4.new_code_cell("explore()", id="b", outputs=[output], execution_count=1),
    ]
    return note


def test_any_server_of_the_environment_strips_completes_and_exports(plain):
    address, folder = plain
    note = saved_elsewhere()
    nbformat.write(note, folder / "other.ipynb")
    read = json.loads(ask(f"{address}/api/contents/other.ipynb")[0])["content"]
    assert set(read["cells"][1]["outputs"][0]["data"]) == {"image/png", "text/plain"}
    assert read["metadata"]["language_info"]["version"] == sys.version.split()[0]
    assert "widgets" not in read["metadata"]

    body = json.dumps({"type": "notebook", "format": "json", "content": note}).encode()
    ask(f"{address}/api/contents/new.ipynb", "PUT", body)
    text = (folder / "new.ipynb").read_text(encoding="utf-8")
    assert WIDGET not in text and "widgets" not in text and '"version"' not in text
    assert '"alt": "r < 2 & a spiral"' in text and "image/png" in text

    page, _ = ask(f"{address}/nbconvert/html/new.ipynb")
    assert "<msqrt>" in page and 'alt="r &lt; 2 &amp; a spiral"' in page
    assert 'src="http' not in page and 'href="#One"' in page


# ---- show


@pytest.fixture
def shown(tmp_path):
    """`python -m labkit show` of a notebook of one's own, in which a cell fails."""
    note = nbformat.v4.new_notebook(metadata={"kernelspec": KERNEL})
    note.cells = [
        nbformat.v4.new_markdown_cell("the root $\\sqrt{2}$"),
        nbformat.v4.new_code_cell("1 / 0"),
        nbformat.v4.new_code_cell("print('after', 'it')"),
    ]
    nbformat.write(note, tmp_path / "my_own.ipynb")
    address = f"http://127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "labkit", "--here", "show", "my_own"]
    command += ["--no-browser", f"--port={address.rsplit(':', 1)[1]}"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with started(command, address, tmp_path / "log", cwd=tmp_path, env=environment) as server:
        yield address, server


def kernels(server):
    children = psutil.Process(server.pid).children(recursive=True)
    return [one for one in children if "ipykernel_launcher" in " ".join(one.cmdline())]


def until(condition, seconds=20):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


def test_show_goes_on_after_a_failure_and_ends_its_kernels(shown):
    address, server = shown
    page, headers = ask(address)
    assert "<msqrt>" in page and "ZeroDivisionError" in page and "after it" in page
    (kernel,) = kernels(server)
    # What the page's own script sends when it is closed
    cookies = [cookie.split(";")[0] for cookie in headers.get_all("Set-Cookie")]
    (mine,) = [cookie.split("=", 1)[1] for cookie in cookies if cookie.startswith("_xsrf=")]
    name = page.split('"kernelId": "')[1].split('"')[0]
    closed = f"{address}/voila/api/shutdown/{name}"
    with pytest.raises(urllib.error.HTTPError, match="403"):
        ask(closed, "POST", b"")
    ask(closed, "POST", f"_xsrf={mine}".encode(), Cookie="; ".join(cookies))
    assert until(lambda: not kernels(server)) and not kernel.is_running()


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no signals; Ctrl-C reaches all there")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_show_dies_with_all_its_children(shown, how):
    address, server = shown
    ask(address)
    children = psutil.Process(server.pid).children(recursive=True)
    assert children
    server.send_signal(how)
    assert server.wait(20) in (0, -how)
    assert until(lambda: not any(one.is_running() for one in children))


# ---- the start page, in a JupyterLab


@pytest.fixture
def lab(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "notebooks")
    with running_lab(tmp_path) as lab:
        yield lab


def test_the_start_page_finds_by_a_word_and_ends_at_the_chooser(lab, browser):
    view = browser.new_page(viewport={"width": 1366, "height": 768})
    view.set_default_timeout(90_000)
    open_notebook(view, lab, "start")
    tab = view.locator(".lm-TabBar-tab.jp-mod-current")
    for ran in (False, True):
        if ran:
            run_all(view)
            slider = view.locator(".widget-slider")
            slider.wait_for()
            time.sleep(1)  # for a page that would still scroll
            box = slider.bounding_box()
            assert 0 < box["y"] < 600, box
            assert view.get_by_role("columnheader", name="assignment").bounding_box()["y"] < 768
        view.locator(".jp-Notebook").click(position={"x": 5, "y": 5})
        view.keyboard.press("Control+f")
        view.locator(".jp-DocumentSearch-input").first.fill("converter")
        count = view.locator(".jp-DocumentSearch-index-counter")
        assert until(lambda count=count: count.inner_text().strip() not in ("-/-", "0/0", ""))
        view.keyboard.press("Escape")
        assert ("jp-mod-dirty" in tab.get_attribute("class")) == ran
    view.close()
