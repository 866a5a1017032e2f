"""The course: which assignments a project number gives, what they ask, and which notebooks exist.

    project(13)                    # the three assignments of project 13, with links
    choose()                       # the same with a slider; saved, a table of all 30 projects
    assignment(2, "1.b")           # one of them: .title, .task, .notebook, .exists
    catalogue()                    # every notebook that exists, and those that do not yet
    refresh()                      # the same, written into the start page

Links are relative to notebooks/start.ipynb.
"""

from __future__ import annotations

import html
import json
import operator
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .model import ModelError, listed
from .notebooks import HOME, found
from .run import write_whole

__all__ = [
    "PROJECTS",
    "Assignment",
    "Project",
    "assignment",
    "catalogue",
    "choose",
    "project",
    "refresh",
]

PROJECTS = 30
PARTS = {
    1: "Part 1. Linear systems with a prescribed equilibrium",
    2: "Part 2. A pendulum with a static nonlinearity",
    3: "Part 3. Systems with events",
    0: "Concepts",
}
WITHOUT = (
    "An assignment without a notebook can be done all the same: the handbook describes its model. "
    "Copy the sample of its part to the name that is given here and make it your own; "
    "the page then links to it."
)


@dataclass(frozen=True)
class Assignment:
    """assignment(3, 6) -> Assignment.

    part, name ("6", "1.b", "sample"), title, task in a sentence, path below notebooks/.
    """

    part: int
    name: str
    title: str
    task: str
    path: str

    @property
    def notebook(self) -> Path:
        return HOME / f"{self.path}.ipynb"

    @property
    def exists(self) -> bool:
        return self.notebook.is_file()

    def __repr__(self) -> str:
        part = f"part {self.part}" if self.part else "concept"
        note = "" if self.exists else ", no notebook yet"
        return f"{part}, {self.name}: {self.title} ({self.path}.ipynb{note})"

    def _repr_html_(self) -> str:
        return f"<p><b>{_link(self)}</b>: {html.escape(self.task)}</p>"


@dataclass(frozen=True)
class Project:
    """project(13) -> Project: number and its three assignments; shows itself as a table."""

    number: int
    assignments: tuple[Assignment, Assignment, Assignment]

    def __repr__(self) -> str:
        return "\n".join([f"Project {self.number}", *(f"  {a!r}" for a in self.assignments)])

    def _repr_html_(self) -> str:
        rows = [
            (str(a.part), html.escape(a.name), _link(a), html.escape(a.task))
            for a in self.assignments
        ]
        note = "" if all(a.exists for a in self.assignments) else f"<p>{WITHOUT}</p>"
        head = ("part", "assignment", "notebook", "what to do")
        return f"<p><b>Project {self.number}</b></p>" + _table(head, rows) + note


def project(number: int) -> Project:
    """project(13) -> the three assignments of that project (the handbook's table 5.1).

    Part 1 goes round its 12 assignments, part 2 round its 16, part 3 round its 15.
    Raises ModelError unless number is 1 … 30.
    """
    try:
        n = operator.index(number)
    except TypeError:
        n = 0
    if isinstance(number, bool) or not 1 <= n <= PROJECTS:
        raise ModelError(
            f"there is no project {number!r}: a project number is a whole number from 1 to "
            f"{PROJECTS}"
        )
    pick = [
        [a for a in ASSIGNMENTS if a.part == part and a.name[0].isdigit()] for part in (1, 2, 3)
    ]
    return Project(n, tuple(names[(n - 1) % len(names)] for names in pick))  # type: ignore[arg-type]


def assignment(part: int, name: int | str) -> Assignment:
    """assignment(2, "1.b"), assignment(3, 6), assignment(1, "sample") -> Assignment.

    Raises ModelError for one that is not in the course.
    """
    wanted = str(name).lower()
    wanted = (
        f"{wanted[0]}.{wanted[1]}"
        if len(wanted) == 2 and wanted[0].isdigit() and wanted[1].isalpha()
        else wanted
    )
    if isinstance(part, bool) or part not in (1, 2, 3):
        raise ModelError(f"there is no part {part!r}: the course has the parts 1, 2 and 3")
    there = {a.name: a for a in ASSIGNMENTS if a.part == part}
    if wanted not in there:
        raise ModelError(f"part {part} has no assignment {name!r}; it has {listed(there)}")
    return there[wanted]


class _Catalogue:
    """Markdown for a notebook, plain text elsewhere."""

    def __init__(self, markdown: str, text: str):
        self._markdown, self._text = markdown, text

    def _repr_markdown_(self) -> str:
        return self._markdown

    def __repr__(self) -> str:
        return self._text


def catalogue() -> _Catalogue:
    """catalogue() -> all notebooks on disk, by part, with links, and what has no notebook yet.

    Notebooks that the course does not list (a teacher's own) stand under the folder's part with
    their first heading.
    """
    known = {a.path for a in ASSIGNMENTS}
    names = [path.relative_to(HOME).with_suffix("").as_posix() for path in found(HOME)]
    markdown, text = [], []
    for part, title in PARTS.items():
        folder = f"part{part}" if part else "concepts"
        here = [a for a in ASSIGNMENTS if a.part == part]
        here += [
            Assignment(part, "", heading(HOME / f"{name}.ipynb"), "", name)
            for name in names
            if name not in known and name.rpartition("/")[0] == folder
        ]
        there, missing = ([a for a in here if a.exists == yes] for yes in (True, False))
        markdown.append(f"### {title}")
        if there:
            rows = [
                f"| {a.name if a.name[:1].isdigit() else ''} | [{_plain(a.title)}]({a.path}.ipynb) "
                f"| {_plain(a.task)} |"
                for a in there
            ]
            markdown.append(
                "\n".join(["| | notebook | what it is about |", "|:---|:---|:---|", *rows])
            )
        if missing:
            names_to_come = (f"{_plain(_numbered(a))} (`{a.path}`)" for a in missing)
            markdown.append(f"*No notebook yet:* {'; '.join(names_to_come)}.")
        text += [
            title,
            *(f"  {_numbered(a)}: {a.path}.ipynb" for a in there),
            *([f"  no notebook yet: {len(missing)}"] if missing else []),
        ]
    if any(not a.exists for a in ASSIGNMENTS):
        markdown.append(WITHOUT)
    return _Catalogue("\n\n".join(markdown), "\n".join(text))


def refresh() -> bool:
    """refresh() -> True if the start page's list of notebooks was not that of the disk, and now is.

    The list is the cell of notebooks/start.ipynb with the tag "catalogue".
    """
    path = HOME / "start.ipynb"
    page = json.loads(path.read_text(encoding="utf-8"))
    lines = catalogue()._repr_markdown_().splitlines(keepends=True)
    (cell,) = (c for c in page["cells"] if "catalogue" in c["metadata"].get("tags", []))
    if cell["source"] == lines:
        return False
    cell["source"] = lines
    text = json.dumps(page, indent=1, ensure_ascii=False, sort_keys=True)
    write_whole(path, f"{text}\n".encode())
    return True


def heading(path: Path) -> str:
    """heading(path) -> the first heading of a notebook, or its file name where there is none."""
    try:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        lines = (
            line
            for cell in cells
            if cell["cell_type"] == "markdown"
            for line in "".join(cell["source"]).splitlines()
        )
        return next(line.lstrip("# ").strip() for line in lines if line.startswith("#"))
    except (OSError, ValueError, KeyError, TypeError, StopIteration):
        return path.stem


def overview() -> str:
    """overview() -> all projects as one table of HTML: number, links to the three assignments."""
    projects = [project(n) for n in range(1, PROJECTS + 1)]
    rows = [
        (
            f"<b>{p.number}</b>",
            *(f"{html.escape(a.name)}&ensp;{_link(a, name=False)}" for a in p.assignments),
        )
        for p in projects
    ]
    everything = all(a.exists for p in projects for a in p.assignments)
    note = "" if everything else "<p><i>In italics: no notebook yet.</i></p>"
    return _table(("project", "part 1", "part 2", "part 3"), rows) + note


def choose(number: int = 1) -> None:
    """choose() shows a slider for the project number and that project's table under it.

    A button makes the student's own copies of its notebooks, in the folder project-13 beside that
    of the start page. Saved without its widget the slider leaves the table of all projects. The
    table is an output of the cell and not a widget, because only there does JupyterLab open a link
    in a tab of its own.
    Raises ModelError for a number that is none.
    """
    import ipywidgets as widgets
    from IPython.display import display

    class Slider(widgets.IntSlider):
        def _repr_mimebundle_(self, **options: Any) -> dict[str, Any]:
            return {**super()._repr_mimebundle_(**options), "text/html": overview()}

    slider = Slider(
        project(number).number,
        1,
        PROJECTS,
        description="project",
        layout=widgets.Layout(width="34em"),
    )

    class Row(widgets.HBox):
        def _repr_mimebundle_(self, **options: Any) -> dict[str, Any]:
            words = "<p><i>A button for copies of your own is here when the cell has run.</i></p>"
            return {**super()._repr_mimebundle_(**options), "text/html": words}

    copies = widgets.Button(description="Make my own copies", tooltip="of its three notebooks")
    said = widgets.HTML()
    copies.on_click(lambda _: setattr(said, "value", _copied(slider.value)))
    display(slider)
    place = display(project(number), display_id=True)
    display(Row([copies, said]))

    def follow(change: dict[str, Any]) -> None:
        place.update(project(change["new"]))
        said.value = ""

    slider.observe(follow, "value")


def _copied(number: int) -> str:
    """What a click on the button did, as HTML."""
    from .copies import copy_project

    folder = Path.cwd().parent / f"project-{number}"  # of a copy in one's home, too
    try:
        copy_project(number, folder)
    except ModelError as error:
        return html.escape(str(error))
    return f"Done: open the folder <b>{folder.name}</b> in the file list on the left."


def _numbered(a: Assignment) -> str:
    return f"{a.name} {a.title}" if a.name[:1].isdigit() else a.title


def _plain(text: str) -> str:
    """Text that Markdown leaves as it is."""
    return re.sub(r"([\\`*_\[\]<>|$])", r"\\\1", text)


def _link(a: Assignment, name: bool = True) -> str:
    title = html.escape(a.title)
    if a.exists:
        return f'<a href="{a.path}.ipynb">{title}</a>'
    return f"<i>{title}</i>" + (f", no notebook yet: <code>{a.path}.ipynb</code>" if name else "")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    # Jupyter sets tables flush right, ipywidgets without air
    left = ' style="text-align:left;padding:3px 10px 3px 4px;line-height:1.4"'
    lines = ["<tr>" + "".join(f"<th{left}>{cell}</th>" for cell in head) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td{left}>{cell}</td>" for cell in row) + "</tr>" for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _equilibrium(number: int, kind: str, how: str, path: str) -> Assignment:
    return Assignment(
        1,
        str(number),
        f"{kind.capitalize()}, {how}",
        f"Make a linear system of your own whose equilibrium is {_A[kind[0] in 'aeiou']} {kind}, "
        f"with a similarity transformation by {how}; solve it and compare with the exact solution.",
        f"part1/{number:02}_{path}",
    )


_A = {True: "an", False: "a"}
_FIRST = (
    "Swing the first pendulum with {}; "
    "see how the constants and the start decide what becomes of the motion."
)
_SECOND = (
    "Let a sine force drive a mass held by {}: "
    "without the force, with the force on and off in turn, and with it always on."
)


def _pendulum(kind: int, letter: str, title: str, what: str, path: str) -> Assignment:
    return Assignment(
        2,
        f"{kind}.{letter}",
        title,
        (_FIRST if kind == 1 else _SECOND).format(what),
        f"part2/{kind}{letter}_{path}",
    )


ASSIGNMENTS: tuple[Assignment, ...] = (
    Assignment(
        1,
        "sample",
        "Sample: a stable spiral",
        "The worked sample of part 1: a stable spiral about a chosen point, from several starts, "
        "against the exact solution.",
        "part1/00_sample_stable_spiral",
    ),
    _equilibrium(1, "stable node", "matrix A", "stable_node_matrix_a"),
    _equilibrium(2, "unstable node", "matrix B", "unstable_node_matrix_b"),
    _equilibrium(3, "stable star", "reflection", "stable_star_reflection"),
    _equilibrium(4, "unstable star", "rotation", "unstable_star_rotation"),
    _equilibrium(5, "stable improper node", "matrix A", "stable_improper_node_matrix_a"),
    _equilibrium(6, "unstable improper node", "matrix B", "unstable_improper_node_matrix_b"),
    _equilibrium(7, "saddle", "reflection", "saddle_reflection"),
    _equilibrium(8, "elliptic point", "rotation", "elliptic_point_rotation"),
    _equilibrium(9, "stable spiral", "matrix A", "stable_spiral_matrix_a"),
    _equilibrium(10, "unstable spiral", "matrix B", "unstable_spiral_matrix_b"),
    _equilibrium(11, "stable node", "reflection", "stable_node_reflection"),
    _equilibrium(12, "unstable node", "rotation", "unstable_node_rotation"),
    Assignment(
        2,
        "introduction",
        "Introduction: a relay pendulum",
        "A pendulum on the circle, pushed one way or the other by a relay: what nonlinear systems "
        "do that linear ones cannot.",
        "part2/00_relay_pendulum",
    ),
    Assignment(
        2,
        "sample",
        "Sample: a driven mass with a hysteresis relay",
        "The worked sample of part 2: a mass, a relay with hysteresis and a sine force; every "
        "switch is found.",
        "part2/00_sample_relay_hysteresis",
    ),
    _pendulum(1, "a", "Relay", "a relay", "relay"),
    _pendulum(1, "b", "Relay with hysteresis", "a relay that switches late", "relay_hysteresis"),
    _pendulum(
        1,
        "c",
        "Relay with a dead zone",
        "a relay that does nothing near the middle",
        "relay_dead_zone",
    ),
    _pendulum(
        1,
        "d",
        "Relay with a dead zone and hysteresis",
        "a relay that has a dead zone and switches late",
        "relay_dead_zone_hysteresis",
    ),
    _pendulum(
        1,
        "e",
        "Saturation",
        "a characteristic that is straight in the middle and limited outside",
        "saturation",
    ),
    _pendulum(
        1,
        "f",
        "Saturation with hysteresis",
        "a limited characteristic that lags behind the motion",
        "saturation_hysteresis",
    ),
    _pendulum(
        1,
        "g",
        "Dead zone with saturation",
        "a characteristic with a dead zone, a slope and a limit",
        "dead_zone_saturation",
    ),
    _pendulum(
        1,
        "h",
        "Dead zone with saturation and hysteresis",
        "a dead zone, a slope and a limit that lag behind the motion",
        "dead_zone_saturation_hysteresis",
    ),
    _pendulum(
        1, "i", "Smooth relay", "a relay whose jump is rounded to an arctangent", "smooth_relay"
    ),
    _pendulum(
        1,
        "j",
        "Smooth relay with a dead zone",
        "a rounded relay with a dead zone",
        "smooth_relay_dead_zone",
    ),
    _pendulum(2, "a", "Driven: relay", "a force of constant size towards the middle", "relay"),
    _pendulum(2, "b", "Driven: saturation", "a spring whose force is limited", "saturation"),
    _pendulum(
        2,
        "c",
        "Driven: relay with a dead zone",
        "a constant force that sets in outside a dead zone",
        "relay_dead_zone",
    ),
    _pendulum(
        2,
        "d",
        "Driven: preloaded spring",
        "a spring with a preload, so that its force jumps at the middle",
        "preloaded_spring",
    ),
    _pendulum(
        2, "e", "Driven: two slopes", "a spring whose stiffness changes at a limit", "two_slopes"
    ),
    _pendulum(
        2,
        "f",
        "Driven: springs beyond a clearance",
        "nothing within a clearance and by springs beyond it",
        "clearance_springs",
    ),
    Assignment(
        3,
        "sample",
        "Sample: self-oscillation by dry friction",
        "The worked sample of part 3: a block pulled by a spring sticks, slips, and sticks again.",
        "part3/00_sample_dry_friction",
    ),
    Assignment(
        3,
        "bouncing ball",
        "Demonstration: bouncing ball",
        "An event changes the state: ever more bounces in ever less time, and how a simulation "
        "lives with it.",
        "part3/00_bouncing_ball",
    ),
    Assignment(
        3,
        "circuit",
        "Demonstration: switched circuit",
        "A known instant changes a parameter: a series circuit whose resistance is switched, "
        "modelled in two ways.",
        "part3/00_switched_circuit",
    ),
    Assignment(
        3,
        "ball on spring",
        "Demonstration: ball on a spring",
        "An event changes the equation: a ball falls on a spring and is thrown back.",
        "part3/00_ball_on_spring",
    ),
    Assignment(
        3,
        "torn pendulum",
        "Demonstration: torn pendulum",
        "An event changes the variables themselves: the rod of a pendulum tears and its mass "
        "flies on.",
        "part3/00_torn_pendulum",
    ),
    Assignment(
        3,
        "1",
        "Water slide",
        "Follow a slider down the slope, round the arc, through the air and under water, and find "
        "the smallest safe pool.",
        "part3/01_water_slide",
    ),
    Assignment(
        3,
        "2",
        "Machine with an unbalanced rotor",
        "Find out whether a warning that shifts the frequencies saves one machine, or two, from "
        "destruction by resonance.",
        "part3/02_unbalanced_rotor",
    ),
    Assignment(
        3,
        "3",
        "Two pendulums with vibrating pivots",
        "Keep a pendulum upright by shaking its pivot while the amplitude changes, and say when "
        "it stays up.",
        "part3/03_vibrating_pivots",
    ),
    Assignment(
        3,
        "4",
        "Room heater with dead time",
        "Control the temperature of a room with a heater that is on or off and a sensor that is "
        "late.",
        "part3/04_room_heater",
    ),
    Assignment(
        3,
        "5",
        "Automatic gearbox",
        "Follow a car with a speed controller and four gears over set points and hills, without a "
        "jerk at the shifts.",
        "part3/05_automatic_gearbox",
    ),
    Assignment(
        3,
        "6",
        "DC-DC converter",
        "Raise a voltage with a switch, a coil and a diode: start-up, limit cycle, ripple, and "
        "light load.",
        "part3/06_dc_dc_converter",
    ),
    Assignment(
        3,
        "7",
        "Two populations",
        "Let two kinds of animals compete for food, with winters and the chance to die out and "
        "return.",
        "part3/07_two_populations",
    ),
    Assignment(
        3,
        "8",
        "Machines with leaf springs",
        "Drive two sprung machines over a bumpy road where each must keep its distance from the "
        "other.",
        "part3/08_leaf_spring_machines",
    ),
    Assignment(
        3,
        "9",
        "Rigid plate in a gas stream",
        "Find out when a hinged plate in a gusty stream returns to rest and when it has an "
        "accident.",
        "part3/09_plate_in_gas",
    ),
    Assignment(
        3,
        "10",
        "Two masses on springs",
        "Shake a chain of two masses with a force that changes its shape and pitch, and keep them "
        "apart.",
        "part3/10_two_masses",
    ),
    Assignment(
        3,
        "11",
        "Rod and pendulum",
        "Ask whether an elastic rod whose free length is shaken survives: resonance through a "
        "changing parameter.",
        "part3/11_rod_and_pendulum",
    ),
    Assignment(
        3,
        "12",
        "Mass, beam and spring",
        "Halve a mass in mid-swing when the swing touches, but does not pass, its limit: a trap "
        "for every solver.",
        "part3/12_mass_beam_spring",
    ),
    Assignment(
        3,
        "13",
        "Cork in water",
        "See which of two floating bodies jumps higher while the liquids under them are exchanged.",
        "part3/13_cork_in_water",
    ),
    Assignment(
        3,
        "14",
        "Particle and ring",
        "Watch a particle swing through a ring that pulls it while the ring changes its size, and "
        "ask how far an answer can be trusted.",
        "part3/14_particle_and_ring",
    ),
    Assignment(
        3,
        "15",
        "Piston and gas",
        "Let a piston ride on a gas whose outer pressure drops and returns, and find out when its "
        "motion grows.",
        "part3/15_piston_and_gas",
    ),
    Assignment(
        0,
        "environment",
        "The environment",
        "Judge the tool itself by experiments: how it writes, checks and exports models, and where "
        "it ends.",
        "concepts/environment",
    ),
    Assignment(
        0,
        "nonlinear elements",
        "Nonlinear elements",
        "Relay, saturation, dead zone and hysteresis in a loop, and what they do that no linear "
        "element does.",
        "concepts/nonlinear_elements",
    ),
    Assignment(
        0,
        "linear systems",
        "Linear systems",
        "Eigenvalues, canonical forms, and the map of all equilibria by trace and determinant.",
        "concepts/linear_systems",
    ),
    Assignment(
        0,
        "solvers and tolerances",
        "Solvers and tolerances",
        "What a tolerance buys, what finding events buys, and how solvers fail.",
        "concepts/solvers_and_tolerances",
    ),
)
