"""What the teacher's page says is there: notebooks, presets, commands, and a lost event."""

import re

import pytest
from scipy.integrate import solve_ivp

from labkit import Mode, System, Transition, simulate
from labkit.__main__ import COMMANDS

from .helpers import FOLDER, ROOT, code_cells, read, source

PAGE = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| +(\d+) \|(.*?)\| `([\w/]+)` \|(.*?)\|.*\|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[2])
def test_notebooks_and_presets_of_the_demonstrations(row):
    _, _, name, hand = row
    assert (FOLDER / f"{name}.ipynb").is_file()
    code = "\n".join(source(cell) for cell in code_cells(read(name)))
    for preset in re.findall("`(.*?)`", hand):
        assert f'"{preset}"' in code, preset


def test_ten_demonstrations_and_only_commands_that_there_are():
    assert len(ROWS) == 10
    assert set(re.findall(r"python -m labkit (\w+)", PAGE)) <= set(COMMANDS)


def test_the_layer_is_lost_by_scipy_and_found_here():
    def by_scipy(**options):
        return solve_ivp(
            lambda t, y: [y[1], -9.81],
            (0, 2),
            [10.0, 0.0],
            events=lambda t, y: (y[0] - 0.4) * (y[0] - 0.6),
            **options,
        )

    lost, found = by_scipy(), by_scipy(max_step=0.0146)
    assert len(lost.t_events[0]) == 0 and len(found.t_events[0]) == 2
    assert (len(lost.t) - 1, len(found.t) - 1) == (6, 140)
    ball = System(
        "ball",
        {"y": "m", "v": "m/s"},
        {},
        [Mode("flight", lambda t, s, p: (s.v, -9.81))],
        [
            Transition(
                "flight",
                "flight",
                guard=lambda t, s, p: (s.y - 0.4) * (s.y - 0.6),
                direction=0,
                label="layer",
            )
        ],
        start={"y": 10.0, "v": 0.0},
    )
    instants = simulate(ball, 2.0).events["layer"].t
    assert instants.tolist() == pytest.approx([(2 * 9.4 / 9.81) ** 0.5, (2 * 9.6 / 9.81) ** 0.5])
