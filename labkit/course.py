"""The course: which assignments a project number gives, what they ask, and which notebooks exist.

    project(13)                    # the three assignments of project 13, with links
    choose()                       # the same with a slider; saved, a table of all 30 projects
    assignment(2, "1.b")           # one of them: .title, .story, .notebook, .exists
    catalogue()                    # every notebook that exists, and those that do not yet
    refresh()                      # the same, written into the start page

Links are relative to notebooks/start.ipynb.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

from .arguments import asked
from .model import ModelError, listed
from .notebooks import HOME, found, parsed
from .run import write_whole

__all__ = ["Assignment", "Project", "assignment", "catalogue", "choose", "project", "refresh"]

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

    part, name ("6", "1.b", "sample"), title, path below notebooks/.
    """

    part: int
    name: str
    title: str
    path: str

    @property
    def notebook(self) -> Path:
        return HOME / f"{self.path}.ipynb"

    @property
    def exists(self) -> bool:
        return self.notebook.is_file()

    @property
    def story(self) -> str:
        """What it is about, as its notebook's heading and first words say (Markdown)."""
        head, words = _opening(self.notebook)
        title = head.partition(": ")[2]
        end = "" if title.endswith("?") else "."
        return f"**{title[:1].upper()}{title[1:]}{end}** {words}" if title else words

    def __repr__(self) -> str:
        part = f"part {self.part}" if self.part else "concept"
        note = "" if self.exists else ", no notebook yet"
        return f"{part}, {self.name}: {self.title} ({self.path}.ipynb{note})"

    def _repr_html_(self) -> str:
        return f"<p>{_link(self)}: {_styled(self.story)}</p>"


@dataclass(frozen=True)
class Project:
    """project(13) -> Project: number and its three assignments; shows itself as a table."""

    number: int
    assignments: tuple[Assignment, Assignment, Assignment]

    def __repr__(self) -> str:
        return "\n".join([f"Project {self.number}", *(f"  {a!r}" for a in self.assignments)])

    def _repr_html_(self) -> str:
        rows = [
            (str(a.part), html.escape(a.name), _link(a), _styled(a.story)) for a in self.assignments
        ]
        note = "" if all(a.exists for a in self.assignments) else f"<p>{WITHOUT}</p>"
        head = ("part", "assignment", "notebook", "what it is about")
        return f"<p><b>Project {self.number}</b></p>" + _table(head, rows) + note


@asked
def project(number: int) -> Project:
    """project(13) -> the three assignments of that project (the handbook's table 5.1).

    Part 1 goes round its 12 assignments, part 2 round its 16, part 3 round its 15.
    Raises ModelError unless number is 1 … 30.
    """
    whole = isinstance(number, Integral) and not isinstance(number, bool)
    if not whole or not 1 <= number <= PROJECTS:
        raise ModelError(
            f"there is no project {number!r}: a project number is a whole number from 1 to "
            f"{PROJECTS}"
        )
    numbered = [a for a in ASSIGNMENTS if a.name[0].isdigit()]
    parts = ([a for a in numbered if a.part == part] for part in (1, 2, 3))
    return Project(int(number), tuple(each[(number - 1) % len(each)] for each in parts))  # type: ignore[arg-type]


@asked
def assignment(part: int, name: int | str) -> Assignment:
    """assignment(2, "1.b"), assignment(3, 6), assignment(1, "sample") -> Assignment.

    Raises ModelError for one that is not in the course.
    """
    wanted = re.sub(r"^(\d)([a-z])$", r"\1.\2", str(name).lower())
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
            Assignment(part, "", heading(HOME / f"{name}.ipynb"), name)
            for name in names
            if name not in known and name.rpartition("/")[0] == folder
        ]
        there, missing = ([a for a in here if a.exists == yes] for yes in (True, False))
        markdown.append(f"### {title}")
        if there:
            rows = [
                f"| {a.name if a.name[:1].isdigit() else ''} | [{_plain(a.title)}]({a.path}.ipynb) "
                f"| {a.story.replace('|', '&#124;')} |"
                for a in there
            ]
            head = ["| | notebook | what it is about |", "|:---|:---|:---|"]
            markdown.append("\n".join([*head, *rows]))
        if missing:
            names_to_come = (f"{_plain(_numbered(a))} (`{a.path}`)" for a in missing)
            markdown.append(f"*No notebook yet:* {'; '.join(names_to_come)}.")
        text += [title, *(f"  {_numbered(a)}: {a.path}.ipynb" for a in there)]
        text += [f"  no notebook yet: {len(missing)}"] * bool(missing)
    if any(not a.exists for a in ASSIGNMENTS):
        markdown.append(WITHOUT)
    return _Catalogue("\n\n".join(markdown), "\n".join(text))


def refresh() -> bool:
    """refresh() -> True if the start page's list of notebooks was not that of the disk, and now is.

    The list is the cell of notebooks/start.ipynb with the tag "catalogue".
    """
    path = HOME / "start.ipynb"
    page = parsed(path)
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
    return _opening(path)[0] or path.stem


def _opening(path: Path) -> tuple[str, str]:
    try:
        return opening(parsed(path)["cells"])
    except (OSError, ValueError, KeyError, TypeError):
        return "", ""


def opening(cells: Iterable[Mapping[str, Any]]) -> tuple[str, str]:
    """opening(notebook.cells) -> the first heading, and the paragraph after it.

    Without its first words in italics, which say whose it is; "" for what there is not.
    """
    texts = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    found = re.search(r"^#+ *(.*)$\s*((?:.+\n?)*)", "\n\n".join(texts), re.MULTILINE)
    head, words = found.groups() if found else ("", "")
    words = "" if words.startswith("#") else words  # another heading
    return head.strip(), " ".join(re.sub(r"^\*[^*]+\*", "", words).split())


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


@asked
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

    def kept(kind: Any, words: str) -> Any:
        """A kind of widget that leaves these words in a saved notebook."""

        class Kept(kind):
            def _repr_mimebundle_(self, **options: Any) -> dict[str, Any]:
                return {**super()._repr_mimebundle_(**options), "text/html": words}

        return Kept

    first, wide = project(number), widgets.Layout(width="34em")
    slider = kept(widgets.IntSlider, overview())(
        first.number, 1, PROJECTS, description="project", layout=wide
    )
    words = "<p><i>A button for copies of your own is here when the cell has run.</i></p>"
    copies = widgets.Button(description="Make my own copies", tooltip="of its three notebooks")
    copies.layout.width = "auto"  # as wide as its words
    said = widgets.HTML()
    copies.on_click(lambda _: setattr(said, "value", _copied(slider.value)))
    display(slider)
    place = display(first, display_id=True)
    display(kept(widgets.HBox, words)([copies, said]))

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


def _styled(markdown: str) -> str:
    """Words of a notebook as HTML: bold and italics."""
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(markdown))
    return re.sub(r"\*(.+?)\*", r"<em>\1</em>", text)


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


#: part, name, file and title of all assignments; what each is about stands in its notebook
_ROWS = """
1 | sample | 00_sample_stable_spiral | Sample: a stable spiral
1 | 1 | 01_stable_node_matrix_a | Stable node, matrix A
1 | 2 | 02_unstable_node_matrix_b | Unstable node, matrix B
1 | 3 | 03_stable_star_reflection | Stable star, reflection
1 | 4 | 04_unstable_star_rotation | Unstable star, rotation
1 | 5 | 05_stable_improper_node_matrix_a | Stable improper node, matrix A
1 | 6 | 06_unstable_improper_node_matrix_b | Unstable improper node, matrix B
1 | 7 | 07_saddle_reflection | Saddle, reflection
1 | 8 | 08_elliptic_point_rotation | Elliptic point, rotation
1 | 9 | 09_stable_spiral_matrix_a | Stable spiral, matrix A
1 | 10 | 10_unstable_spiral_matrix_b | Unstable spiral, matrix B
1 | 11 | 11_stable_node_reflection | Stable node, reflection
1 | 12 | 12_unstable_node_rotation | Unstable node, rotation
2 | introduction | 00_relay_pendulum | Introduction: a relay pendulum
2 | sample | 00_sample_relay_hysteresis | Sample: a driven mass with a hysteresis relay
2 | 1.a | 1a_relay | Relay
2 | 1.b | 1b_relay_hysteresis | Relay with hysteresis
2 | 1.c | 1c_relay_dead_zone | Relay with a dead zone
2 | 1.d | 1d_relay_dead_zone_hysteresis | Relay with a dead zone and hysteresis
2 | 1.e | 1e_saturation | Saturation
2 | 1.f | 1f_saturation_hysteresis | Saturation with hysteresis
2 | 1.g | 1g_dead_zone_saturation | Dead zone with saturation
2 | 1.h | 1h_dead_zone_saturation_hysteresis | Dead zone with saturation and hysteresis
2 | 1.i | 1i_smooth_relay | Smooth relay
2 | 1.j | 1j_smooth_relay_dead_zone | Smooth relay with a dead zone
2 | 2.a | 2a_relay | Driven: relay
2 | 2.b | 2b_saturation | Driven: saturation
2 | 2.c | 2c_relay_dead_zone | Driven: relay with a dead zone
2 | 2.d | 2d_preloaded_spring | Driven: preloaded spring
2 | 2.e | 2e_two_slopes | Driven: two slopes
2 | 2.f | 2f_clearance_springs | Driven: springs beyond a clearance
3 | sample | 00_sample_dry_friction | Sample: self-oscillation by dry friction
3 | bouncing ball | 00_bouncing_ball | Demonstration: bouncing ball
3 | circuit | 00_switched_circuit | Demonstration: switched circuit
3 | ball on spring | 00_ball_on_spring | Demonstration: ball on a spring
3 | torn pendulum | 00_torn_pendulum | Demonstration: torn pendulum
3 | 1 | 01_water_slide | Water slide
3 | 2 | 02_unbalanced_rotor | Machine with an unbalanced rotor
3 | 3 | 03_vibrating_pivots | Two pendulums with vibrating pivots
3 | 4 | 04_room_heater | Room heater with dead time
3 | 5 | 05_automatic_gearbox | Automatic gearbox
3 | 6 | 06_dc_dc_converter | DC-DC converter
3 | 7 | 07_two_populations | Two populations
3 | 8 | 08_leaf_spring_machines | Machines with leaf springs
3 | 9 | 09_plate_in_gas | Rigid plate in a gas stream
3 | 10 | 10_two_masses | Two masses on springs
3 | 11 | 11_rod_and_pendulum | Rod and pendulum
3 | 12 | 12_mass_beam_spring | Mass, beam and spring
3 | 13 | 13_cork_in_water | Cork in water
3 | 14 | 14_particle_and_ring | Particle and ring
3 | 15 | 15_piston_and_gas | Piston and gas
0 | environment | environment | The environment
0 | nonlinear elements | nonlinear_elements | Nonlinear elements
0 | linear systems | linear_systems | Linear systems
0 | solvers and tolerances | solvers_and_tolerances | Solvers and tolerances
"""


def _assignments(rows: str) -> Iterable[Assignment]:
    for row in rows.strip().splitlines():
        part, name, file, title = row.split(" | ")
        folder = "concepts" if part == "0" else f"part{part}"
        yield Assignment(int(part), name, title, f"{folder}/{file}")


ASSIGNMENTS: tuple[Assignment, ...] = tuple(_assignments(_ROWS))
