"""python -m labkit: set up the workbook's own environment and open it.

    python -m labkit                   JupyterLab on notebooks/start.ipynb; more words go to it
    python -m labkit show part3/06     one notebook, live, its code hidden; more words go to Voilà
    python -m labkit page part3/06     one notebook as a page (HTML) that needs no network
    python -m labkit run [notebook …]  run notebooks (all of them) from the top and save them
    python -m labkit new 13 FOLDER     your own copies of the notebooks of project 13, and a report
    python -m labkit report FOLDER     report.html and slides.html of such a folder
    python -m labkit key 13            a teacher's key to a project, or to a student's folder
    python -m labkit site FOLDER       all notebooks as a web site (site FOLDER MINE: your own ones)
    python -m labkit test              all tests and all notebooks; more words go to pytest
    python -m labkit setup             only set up
    python -m labkit --here …          use the Python that is running as it is, install nothing

A notebook is named as under notebooks/, or by its beginning, or by the path of one of your own;
run and show also take a folder of your own.

The environment is the folder .venv with exactly the packages of environment.txt. It is made on
first use, and brought up to date when environment.txt has changed. Until then only Python's
standard library is needed here.
"""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "environment.txt"
VENV = ROOT / ".venv"
OLDEST, NEWEST = (3, 11), (3, 14)
JUPYTER = Path(__file__).with_name("jupyter")
COMMANDS = ("lab", "show", "page", "run", "new", "report", "key", "site", "test", "setup", "help")


class SetupError(Exception):
    """Something about this computer stands in the way; the message says what to do."""


def main(words: list[str]) -> int:
    here = "--here" in words
    words = [word for word in words if word != "--here"]
    if words[:1] in (["-h"], ["--help"], ["help"]):
        print(__doc__)
        return 0
    try:
        command, rest = split(words)
        check_python()
        if not here and Path(sys.prefix).resolve() != VENV.resolve():
            make_environment()
            return hand_over(words)
        if not here:
            fill_environment()
        return start(command, rest)
    except SetupError as error:
        print(f"\nlabkit: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nlabkit: stopped", file=sys.stderr)
        return 130


def split(words: list[str]) -> tuple[str, list[str]]:
    """split(["show", "part3/06"]) -> ("show", ["part3/06"]); options and files go to the Lab.

    Raises SetupError for a word that is no command.
    """
    if words and words[0] in COMMANDS:  # also where a folder has the name of one
        return words[0], words[1:]
    if not words or words[0].startswith("-") or Path(words[0]).exists():
        return "lab", words
    close = difflib.get_close_matches(words[0].lower(), COMMANDS)
    meant = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(COMMANDS)}"
    raise SetupError(f"there is no command {words[0]!r}; {meant}")


def start(command: str, words: list[str]) -> int:
    """start("page", ["part3/06"]) -> exit code, once the environment is there."""
    if command == "setup":
        return 0
    if command in ("lab", "show", "test"):
        return globals()[command](words)
    return written(globals()[command], words)


def say(text: str) -> None:
    print(f"labkit: {text}", flush=True)


# ---- the environment


def check_python(version: tuple[int, ...] = sys.version_info[:2]) -> None:
    if not OLDEST <= version <= NEWEST:
        raise SetupError(
            f"this is Python {version[0]}.{version[1]}; labkit needs Python "
            f"{OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]} (python.org/downloads)"
        )


def venv_python(venv: Path = VENV) -> Path:
    return venv / "Scripts" / "python.exe" if os.name == "nt" else venv / "bin" / "python"


def make_environment(venv: Path = VENV) -> None:
    """An empty environment with pip, unless a working one is there."""
    python = venv_python(venv)
    pip = [python, "-m", "pip", "--version"]
    if python.exists() and subprocess.run(pip, capture_output=True).returncode == 0:
        return
    if importlib.util.find_spec("venv") is None or importlib.util.find_spec("ensurepip") is None:
        raise SetupError(
            "this Python has no venv module. On Debian and Ubuntu: "
            "sudo apt install python3-venv; then start again"
        )
    say(f"making the environment {venv}")
    command = [sys.executable, "-m", "venv", "--clear", venv]
    made = subprocess.run(command, capture_output=True, text=True)
    if made.returncode != 0:
        shutil.rmtree(venv, ignore_errors=True)
        said = (made.stdout + made.stderr).strip()
        raise SetupError(f"the environment {venv} could not be made:\n{said}")


def hand_over(words: list[str]) -> int:
    """The same command again, by the environment's own Python."""
    environment = os.environ | {"PYTHONPATH": first("PYTHONPATH", ROOT)}
    return become([str(venv_python()), "-m", "labkit", *words], environment)


def first(variable: str, place: Path) -> str:
    """first("PYTHONPATH", ROOT) -> the variable of the environment with the place before it."""
    return os.pathsep.join(filter(None, [str(place), os.environ.get(variable)]))


def become(command: list[str], environment: dict[str, str]) -> int:
    """Go over into another program, so that what ends this one ends that one."""
    if os.name != "nt":  # there exec returns to the shell at once and leaves the child behind
        sys.stdout.flush()
        os.execve(command[0], command, environment)
    try:
        return subprocess.run(command, env=environment).returncode
    except KeyboardInterrupt:
        return 130


def fill_environment(purelib: Path | None = None, prefix: str | Path = sys.prefix) -> None:
    """Install what environment.txt says, once for each content of it.

    labkit becomes importable from every folder, and every Jupyter of this environment knows it.
    """
    purelib = purelib or Path(sysconfig.get_path("purelib"))
    register(Path(prefix))
    stamp = purelib / "labkit-environment.txt"
    wanted = hashlib.sha256(LOCK.read_bytes()).hexdigest()
    # Before 3.13 Python reads a .pth file in the locale's encoding, later in UTF-8.
    encoding = "utf-8" if sys.version_info >= (3, 13) else "locale"
    (purelib / "labkit.pth").write_text(f"{ROOT}\n", encoding=encoding)
    if stamp.exists() and stamp.read_text() == wanted:
        return
    packages = sum(line[:1].isalnum() for line in LOCK.read_text(encoding="utf-8").splitlines())
    say(f"installing the packages of {LOCK.name} (about {packages}; once, a few minutes)")
    options = ["--disable-pip-version-check", "--no-input", "--no-deps", "--requirement", str(LOCK)]
    install([sys.executable, "-m", "pip", "install", *options], packages)
    stamp.write_text(wanted)


def register(prefix: Path) -> None:
    """Make `labkit.jupyter` an extension of the Jupyter servers of this environment, however begun.

    `jupyter server extension disable labkit.jupyter --sys-prefix` turns it off for good.
    """
    name = "jupyter_server_config.d/labkit.json"
    place = prefix / "etc" / "jupyter" / name
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(JUPYTER / name, place)


def install(command: list[str], packages: int) -> None:
    """Run pip; on a terminal show how far it is, in a log the end of it.

    Raises SetupError with pip's last words.
    """
    lines, count, shown = [], 0, sys.stdout.isatty()
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as pip:
        for line in pip.stdout:
            lines.append(line.rstrip())
            count += line.startswith(("Collecting", "Requirement already"))
            if shown:
                name = " ".join(line.split()[1:2])
                if line.startswith("Installing collected"):
                    name = "putting them in place …"
                text = f"{min(count, packages)} of about {packages}: {name}"
                print(f"\r  {text:<70.70}", end="", flush=True)
    if shown:
        print("\r" + " " * 72 + "\r", end="")
    if pip.returncode == 0:
        say("packages are in place")
        return
    last = "\n".join(f"  {line}" for line in lines[-12:])
    said = " ".join(line.lower() for line in lines if line.startswith(("WARNING", "ERROR")))
    signs = ["connection", "failed to resolve", "name resolution", "getaddrinfo", "unreachable"]
    if any(sign in said for sign in [*signs, "timed out", "proxyerror"]):
        mend = "It seems that there is no network: connect once, then start again (later starts "
        mend += "need none)."
    else:
        mend = "Start again; if it fails the same way, show these lines to your teacher."
    raise SetupError(f"pip could not install the packages. Its last words:\n{last}\n{mend}")


# ---- what it is for


def warm() -> None:
    """Compile the engine once, with visible progress; later starts find it in the cache."""
    try:
        from labkit.solve import warm as compile_engine
    except ImportError:
        return
    try:
        compile_engine(progress=say)
    except Exception as error:  # the workbook runs without, only slower
        say(f"the engine could not be compiled ({error}); simulations run in plain Python")


def lab_command(*options: str, folder: Path = ROOT) -> list[str]:
    """lab_command("--no-browser") -> the command line of labkit's JupyterLab over a folder."""
    root = ["--allow-root"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    place = [
        f"--ServerApp.root_dir={folder}",
        "--LabApp.default_url=/lab/tree/notebooks/start.ipynb",
    ]
    return [sys.executable, "-m", "jupyterlab", *place, *root, *options]


def lab_environment() -> dict[str, str]:
    """The settings in labkit/jupyter, and the templates of Voilà.

    The environment's own kernel goes before one of the same name in the user's home.
    """
    paths = {key: first(key, JUPYTER) for key in ("JUPYTER_CONFIG_PATH", "JUPYTER_PATH")}
    return os.environ | paths | {"JUPYTER_PREFER_ENV_PATH": "1"}


def lab(options: list[str]) -> int:
    warm()
    say("JupyterLab opens in your browser; to end it press Ctrl-C twice in this window")
    return become(lab_command(*options), lab_environment())


def meant(words: list[str]) -> Path:
    """meant(["part3/06"]) -> the path of that notebook; an unclear name is a SetupError."""
    from .notebooks import named

    if words and Path(words[0]).is_dir():
        return Path(words[0]).resolve()
    if not words or words[0].startswith("-"):
        raise SetupError("which notebook? For example: part3/06, or the path of one of your own")
    try:
        return named(words[0]).resolve()
    except LookupError as error:
        raise SetupError(error.args[0]) from None


def show_command(words: list[str]) -> list[str]:
    """show_command(["part3/06"]) -> the command line of Voilà; an unclear name is a SetupError."""
    look = ["--template=labkit", "--VoilaConfiguration.show_tracebacks=True"]
    return [sys.executable, "-m", "voila", str(meant(words)), *look, *words[1:]]


def show(words: list[str]) -> int:
    """One notebook as an app: it runs in a kernel of its own for every page that opens it."""
    command = show_command(words)
    warm()
    say("the notebook opens in your browser once it has run; to end it press Ctrl-C in this window")
    return become(command, lab_environment())


def written(command: Callable[[list[str]], Iterable[object]], words: list[str]) -> int:
    """Run a command and say what it has made; what goes wrong is a SetupError."""
    from labkit.model import ModelError

    try:
        for made in command(words):
            print(f"labkit: {made}" if isinstance(made, Path) else made, flush=True)
    except (ModelError, OSError) as error:
        raise SetupError(str(error)) from None
    return 0


def run(words: list[str]) -> Iterable[str]:
    """Notebooks run from the top and saved; the start page lists those that there are."""
    from .course import refresh
    from .notebooks import execute_all

    warm()
    failed = execute_all(words)
    if refresh():
        yield "labkit: notebooks/start.ipynb lists the notebooks that there are now"
    if failed:
        raise SetupError(f"{failed} failed; they are as they were before, the others are saved")


def page(words: list[str]) -> Iterable[Path]:
    """Notebooks as pages, in the folder in which one stands."""
    from .page import page as write

    paths = [meant([word]) for word in words] or [meant([])]
    if folders := [path for path in paths if path.is_dir()]:
        raise SetupError(f"{str(folders[0])!r} is a folder: say a notebook, or use site for all")
    return map(write, paths)


def new(words: list[str]) -> Iterable[Path]:
    """A student's own copies of the notebooks of a project."""
    from .copies import copy_project

    if len(words) != 2:
        raise SetupError("say the number of your project and a folder: new 13 my-project")
    return copy_project(number(words[0]), words[1])


def number(word: str) -> int | str:
    """number("013") -> 13; what is no number stays as it is."""
    try:
        return int(word)
    except ValueError:
        return word


def report(words: list[str]) -> Iterable[Path]:
    """The notebooks of a folder as a report and as slides."""
    from .report import report as write

    if len(words) != 1:
        raise SetupError("say the folder of your project: report my-project")
    warm()
    return write(words[0])


def key(words: list[str]) -> Iterable[object]:
    """The answers of a project, for its own values or for those of a student's folder."""
    from .key import key as keys

    if len(words) != 1:
        raise SetupError("say the number of a project or a student's folder: key 13")
    warm()
    return keys(number(words[0]))


def site(words: list[str]) -> Iterable[Path]:
    """All notebooks, or those of a folder, as a web site."""
    from .site import site as write

    if len(words) not in (1, 2):
        raise SetupError(
            "say the folder to write: site public; of your own notebooks: site public mine"
        )
    warm()
    if write(words[0], *words[1:]):
        raise SetupError("some notebooks failed; the pages of the others are written")
    return [Path(words[0]) / "index.html"]


def test(options: list[str]) -> int:
    """pytest over tests/ and, by nbval, over all notebooks, in two workers.

    Panels try the ends of their sliders. BLAS gets one thread unless a number is set: workers and
    kernels use the processors already, and threads that wait for each other make a product of
    small matrices ten times as long.
    """
    first = sorted((ROOT / "tests").glob("test_browser_*.py"), reverse=True)
    places = [*first, ROOT / "tests", ROOT / "notebooks"]
    if any(Path(word.split("::")[0]).exists() for word in options):
        places = []  # else what takes longest begins first
    workers = ["-n", "2"]
    if any(word.startswith(("-n", "--numprocesses", "--pdb")) for word in options):
        workers = []
    warm()
    how = ["--nbval-lax", "--nbval-current-env", "--dist", "loadfile", "--no-loadscope-reorder"]
    command = [sys.executable, "-m", "pytest", *how, *workers, *options, *map(str, places)]
    environment = {"OPENBLAS_NUM_THREADS": "1"} | os.environ | {"LABKIT_CHECK": "1"}
    return subprocess.run(command, cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
