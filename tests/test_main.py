"""python -m labkit: before there is an environment, when something is missing, what it starts."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import venv
from pathlib import Path

import pytest

from labkit import __main__ as main

ROOT = Path(__file__).resolve().parent.parent


def python(*words, **options):
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=120, **options
    )


# ---- before there is an environment


def test_only_the_standard_library_is_needed_at_first():
    """Isolated and without site-packages, as on a bare machine."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); import labkit.__main__\n"
        "names = {name.partition('.')[0] for name in sys.modules}\n"
        "print(sorted(names - set(sys.stdlib_module_names) - {'labkit', '__main__'}))"
    )
    done = python("-I", "-S", "-c", code)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_help():
    done = python("-m", "labkit", "--help", cwd=ROOT)
    assert done.returncode == 0 and "python -m labkit test" in done.stdout


@pytest.mark.parametrize(
    "version, good", [((3, 10), False), ((3, 11), True), ((3, 14), True), ((3, 15), False)]
)
def test_the_python_version(version, good):
    if good:
        main.check_python(version)
    else:
        with pytest.raises(
            main.SetupError,
            match=f"this is Python 3.{version[1]}; labkit needs Python 3.11 to 3.14",
        ):
            main.check_python(version)


def test_a_missing_venv_module_is_named_with_the_mend(tmp_path, monkeypatch):
    monkeypatch.setattr(main.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(main.SetupError, match="apt install python3-venv"):
        main.make_environment(tmp_path / "env")
    assert not (tmp_path / "env").exists()


def test_an_environment_that_cannot_be_made_leaves_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(main.SetupError, match="could not be made"):
        main.make_environment(tmp_path / "file" / "env")


def test_a_working_environment_is_kept_and_a_half_made_one_is_made_anew(tmp_path, monkeypatch):
    place = tmp_path / "env"
    venv.create(place, with_pip=False, symlinks=os.name != "nt")  # no pip in it
    run, made = subprocess.run, []
    monkeypatch.setattr(
        main.subprocess,
        "run",
        lambda command, **options: (
            made.append(command) or subprocess.CompletedProcess(command, 0)
            if "venv" in command
            else run(command, **options)
        ),
    )
    main.make_environment(place)
    assert made == [[sys.executable, "-m", "venv", "--clear", place]]
    monkeypatch.setattr(main, "venv_python", lambda venv: Path(sys.executable))  # one with pip
    main.make_environment(place)
    assert len(made) == 1


def test_the_same_command_goes_to_the_environments_python(monkeypatch):
    seen = []
    monkeypatch.setattr(main, "make_environment", lambda: None)
    monkeypatch.setattr(main.sys, "prefix", "/somewhere/else")
    monkeypatch.setattr(main.os, "execve", lambda *all: seen.append(all) or 0, raising=False)
    monkeypatch.setattr(
        main.subprocess,
        "run",
        lambda command, env: (
            seen.append((command[0], command, env)) or subprocess.CompletedProcess(command, 0)
        ),
    )
    main.main(["test", "-k", "panel"])
    place, command, environment = seen[0]
    assert Path(place) == main.venv_python() and command[1:] == [
        "-m",
        "labkit",
        "test",
        "-k",
        "panel",
    ]
    assert environment["PYTHONPATH"].split(os.pathsep)[0] == str(ROOT)


@pytest.mark.parametrize(
    "words, said",
    [
        (["shwo", "part3/06"], "no command 'shwo'; did you mean show"),
        (["Run"], "no command 'Run'; did you mean run"),
        (
            ["xyzzy"],
            "no command 'xyzzy'; there are lab, show, page, run, new, report, key, site, test, "
            "setup, help",
        ),
    ],
)
def test_a_word_that_is_no_command_says_what_there_is(words, said, monkeypatch, capsys):
    monkeypatch.setattr(main, "make_environment", lambda: pytest.fail("too late"))
    assert main.main(words) == 1 and said in capsys.readouterr().err


@pytest.mark.parametrize("words", [[], ["--no-browser"], [str(ROOT / "notebooks")]])
def test_options_and_files_go_to_the_lab(words):
    assert main.split(words) == ("lab", words)


def test_a_folder_with_the_name_of_a_command_does_not_hide_it(tmp_path, monkeypatch):
    (tmp_path / "report").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main.split(["report", "mine"]) == ("report", ["mine"])


# ---- filling it


@pytest.fixture
def lock(tmp_path, monkeypatch):
    (tmp_path / "environment.txt").write_text(
        "numpy==2.4.6\n    # via labkit\npytest==9.2.0 ; python_version > '3'\n"
    )
    monkeypatch.setattr(main, "LOCK", tmp_path / "environment.txt")
    calls = []
    monkeypatch.setattr(
        main, "install", lambda command, packages: calls.append((command, packages))
    )
    return calls


def test_packages_are_installed_once_for_each_lock(tmp_path, lock, capsys):
    purelib = tmp_path / "site"
    purelib.mkdir()
    main.fill_environment(purelib, tmp_path)
    main.fill_environment(purelib, tmp_path)
    ((command, packages),) = lock
    assert (
        command[-2:] == ["--requirement", str(main.LOCK)]
        and "--no-deps" in command
        and packages == 2
    )
    main.LOCK.write_text("numpy==2.5.5\n")
    main.fill_environment(purelib, tmp_path)
    assert len(lock) == 2
    place = tmp_path / "etc" / "jupyter" / "jupyter_server_config.d"
    assert json.loads((place / "labkit.json").read_text()) == {
        "ServerApp": {"jpserver_extensions": {"labkit.jupyter": True}}
    }


def test_labkit_is_importable_from_every_folder_of_the_environment(tmp_path, lock):
    main.fill_environment(tmp_path, tmp_path)
    code = f"import site; site.addsitedir({str(tmp_path)!r}); import labkit; print(labkit.__file__)"
    assert (
        Path(python("-I", "-S", "-c", code, cwd=tmp_path).stdout.strip()).parent == ROOT / "labkit"
    )


def test_a_failed_installation_is_tried_again(tmp_path, lock, monkeypatch):
    def fail(command, packages):
        raise main.SetupError("no")

    monkeypatch.setattr(main, "install", fail)
    with pytest.raises(main.SetupError):
        main.fill_environment(tmp_path, tmp_path)
    monkeypatch.setattr(main, "install", lambda command, packages: lock.append(command))
    main.fill_environment(tmp_path, tmp_path)
    assert len(lock) == 1


@pytest.mark.parametrize(
    "last, mend",
    [
        (
            "WARNING: NewConnectionError('<...>: Failed to establish a new connection: "
            "[Errno -2] Name or service not known')",
            "there is no network",
        ),
        ("ERROR: No matching distribution found for numpy==99", "show these lines to your teacher"),
    ],
)
def test_pips_failure_is_told_with_the_mend(last, mend):
    pip = f"print('Collecting numpy==99'); print({last!r}); raise SystemExit(1)"
    with pytest.raises(main.SetupError) as caught:
        main.install([sys.executable, "-c", pip], 1)
    assert mend in str(caught.value) and last in str(caught.value)


def test_pips_success(capsys):
    main.install(
        [
            sys.executable,
            "-c",
            "print('Collecting numpy==2.4.6'); print('Installing collected packages: numpy')",
        ],
        1,
    )
    assert "in place" in capsys.readouterr().out


# ---- what it starts


@pytest.fixture
def became(monkeypatch):
    """What `become` is told to become."""
    seen = []
    monkeypatch.setattr(main, "warm", lambda: None)
    monkeypatch.setattr(main, "become", lambda *all: seen.append(all) or 7)
    return seen


def test_lab_opens_the_start_page_with_labkits_settings(became):
    assert main.main(["--here", "--no-browser"]) == 7
    ((command, environment),) = became
    assert command[1:3] == ["-m", "jupyterlab"] and "--no-browser" in command
    assert "--LabApp.default_url=/lab/tree/notebooks/start.ipynb" in command
    assert f"--ServerApp.root_dir={ROOT}" in command
    assert ("--allow-root" in command) == (hasattr(os, "geteuid") and os.geteuid() == 0)
    settings = Path(environment["JUPYTER_CONFIG_PATH"].split(os.pathsep)[0])
    names = ("jupyter_server_config.py", "jupyter_server_config.d/labkit.json", "voila.py")
    assert all((settings / name).exists() for name in (*names, "labconfig/page_config.json"))


def test_another_program_takes_this_ones_place():
    """So that a signal to `labkit show` is a signal to Voilà."""
    code = "import os; from labkit.__main__ import become; print(os.getpid(), flush=True)\n"
    code += (
        "import sys; become([sys.executable, '-c', 'import os; print(os.getpid())'], os.environ)"
    )
    mine, its = python("-c", code, cwd=ROOT).stdout.split()
    assert (mine == its) == (os.name != "nt")


@pytest.mark.parametrize(
    "words, wanted, unwanted",
    [
        ([], ["-n", "2", "--nbval-lax", str(ROOT / "tests"), str(ROOT / "notebooks")], []),
        (["-n", "0", "-k", "panel"], ["-k", "panel", str(ROOT / "tests")], ["2"]),
        (
            ["tests/test_main.py::test_help"],
            ["tests/test_main.py::test_help"],
            [str(ROOT / "tests")],
        ),
    ],
)
def test_test_runs_all_tests_and_notebooks_unless_told_which(monkeypatch, words, wanted, unwanted):
    seen = []
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(main, "warm", lambda: None)
    monkeypatch.setattr(
        main.subprocess,
        "run",
        lambda command, cwd, env: (
            seen.append((command, env)) or subprocess.CompletedProcess(command, 3)
        ),
    )
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert main.main(["--here", "test", *words]) == 3
    ((command, environment),) = seen
    assert (
        set(wanted) <= set(command)
        and not set(unwanted) & set(command)
        and environment["LABKIT_CHECK"] == environment["OPENBLAS_NUM_THREADS"] == "1"
    )
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    assert main.main(["--here", "test", *words]) == 3
    assert seen[-1][1]["OPENBLAS_NUM_THREADS"] == "3"


def test_a_setup_error_is_one_sentence_and_exit_code_1(monkeypatch, capsys):
    monkeypatch.setattr(
        main, "check_python", lambda: (_ for _ in ()).throw(main.SetupError("this is Python 2"))
    )
    assert main.main([]) == 1
    assert capsys.readouterr().err.strip() == "labkit: this is Python 2"


@pytest.mark.parametrize(
    "words, said",
    [
        (["new", "0", "mine"], "there is no project 0: a project number is a whole number"),
        (["new", "abc", "mine"], "there is no project 'abc'"),
        (["new", "²", "mine"], "there is no project '²'"),
        (["new", "13"], "say the number of your project and a folder"),
        (["new", "13", "file"], "'file' cannot be written .*choose a folder"),
        (["new", "13", "x" * 300], "cannot be written .*choose a folder"),
        (["report", "file"], "there is no folder 'file'"),
        (["key", "31"], "there is no project 31"),
        (["key", "-1"], "there is no project -1"),
        (["key", "file"], "has no copies that"),
        (["page", "."], "is a folder: say a notebook"),
        (["page", "broken.ipynb"], "broken.ipynb' is no notebook .*: take another one"),
        (["page", "list.ipynb"], "list.ipynb' is no notebook"),
        (["page", "empty.ipynb"], "empty.ipynb' is no notebook"),
        (["site", "file"], "'file' exists and holds no site"),
        (["site", "file/public"], "'file.public' cannot be written"),
        (["site", "public", "nowhere"], "no notebooks in 'nowhere'"),
        (["run", "empty"], "there are no notebooks in 'empty'"),  # not all of the workbook's
        (["run", "broken.ipynb"], "1 failed"),
    ],
)
def test_bad_words_are_one_sentence_and_leave_nothing(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(main, "warm", lambda: None)
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("empty").mkdir()
    for name, text in {"broken": "{", "list": "[1]", "empty": ""}.items():
        Path(f"{name}.ipynb").write_text(text)
    before = sorted(tmp_path.rglob("*"))
    assert main.main(["--here", *words]) == 1
    error = capsys.readouterr().err.strip()
    assert re.search(said, error) and error.startswith("labkit: ") and "\n" not in error
    assert sorted(tmp_path.rglob("*")) == before and Path("broken.ipynb").read_text() == "{"


@pytest.mark.skipif(os.name == "nt", reason="there is no Ctrl-C to send to one process")
def test_an_interrupt_ends_it_with_its_kernels_in_a_word(tmp_path):
    """Of several at work, too; the notebooks are as they were."""
    cell = {"cell_type": "code", "metadata": {}, "execution_count": None, "outputs": []}
    text = "import os, time\nopen(f'{os.getpid()}.pid', 'w').close()\ntime.sleep(600)"
    page = {"cells": [cell | {"source": text}], "metadata": {}, "nbformat": 4, "nbformat_minor": 4}
    for name in "ab":
        (tmp_path / f"{name}.ipynb").write_text(json.dumps(page))
    command = [sys.executable, "-m", "labkit", "--here", "report", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as made:
        begin = time.monotonic()
        while len(list(tmp_path.glob("*.pid"))) < min(2, os.cpu_count()):
            assert time.monotonic() - begin < 120 and made.poll() is None
            time.sleep(0.1)
        made.send_signal(signal.SIGINT)
        error = made.communicate(timeout=60)[1]
    assert made.returncode == 130 and error.strip().endswith("labkit: stopped"), error
    assert "Traceback" not in error and not list(tmp_path.glob("*.html"))
    for path in tmp_path.glob("*.pid"):
        with pytest.raises(ProcessLookupError):
            os.kill(int(path.stem), 0)


# ---- one notebook as a page


@pytest.mark.parametrize(
    "word",
    ["part3/06", "part3/06_dc_dc_converter", "notebooks/part3/06_dc_dc_converter.ipynb", "06_dc"],
)
def test_show_finds_the_notebook_that_is_meant(word, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    command = main.show_command([word, "--no-browser"])
    path = ROOT / "notebooks" / "part3" / "06_dc_dc_converter.ipynb"
    assert command[1:4] == ["-m", "voila", str(path)] and command[-1] == "--no-browser"


def test_show_takes_a_notebook_of_ones_own(monkeypatch, tmp_path, became):
    (tmp_path / "my_own.ipynb").touch()
    monkeypatch.chdir(tmp_path)
    for word in ("my_own", "my_own.ipynb", str(tmp_path / "my_own.ipynb")):
        assert main.main(["--here", "show", word]) == 7
    assert {command[3] for command, _ in became} == {str((tmp_path / "my_own.ipynb").resolve())}


@pytest.mark.parametrize(
    "words, said",
    [
        ([], "which notebook"),
        (["--no-browser"], "which notebook"),
        (["part9/1"], "is no notebook; .*part"),
        (["part3/06_dcdc_converter"], "is no notebook; did you mean part3/06_dc_dc_converter"),
        (["converter"], "is no notebook; did you mean part3/06_dc_dc_converter"),
        (["xyzzy"], "is no notebook; there are concepts/.*start"),
        (["part3"], "is not one notebook; say one of: part3/00"),
    ],
)
def test_show_says_what_there_is_when_it_is_not_clear(words, said):
    with pytest.raises(main.SetupError, match=said):
        main.show_command(words)


def test_page_writes_where_one_stands(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main(["--here", "page", "start"]) == 0
    assert "start.html" in capsys.readouterr().out and (tmp_path / "start.html").exists()
    assert main.main(["--here", "page"]) == 1 and "which notebook" in capsys.readouterr().err
