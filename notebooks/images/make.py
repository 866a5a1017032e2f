"""python notebooks/images/make.py: the picture of README.md, from the dry friction sample's own model."""

import json
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent.parent))

from labkit import figure, phase_portrait, simulate, time_plot  # noqa: E402


def model() -> object:
    """The notebook's `system`: its code cells run until it is there."""
    notebook = json.loads((FOLDER.parent / "part3" / "00_sample_dry_friction.ipynb").read_text(encoding="utf-8"))
    scope: dict = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code" and "system" not in scope:
            exec("".join(cell["source"]), scope)
    return scope["system"]


system = model()
run = simulate(system, 12.0)
fig = figure(2, 2, width=10, height=4.6, widths=(3, 2))
grid = fig.axes[0].get_gridspec()
for axes in (fig.axes[3], fig.axes[1]):
    axes.remove()
time_plot(run, "x", ("V", "F"), title="a block pulled by a spring: sticks, slips", axes=fig.axes[:2])
phase_portrait(system, "x", "V", run=run, mode="slip", nullclines=False, title="the same run in the phase plane", limits=((-0.4, 4.6), (-0.4, 5.4)), axes=fig.add_subplot(grid[:, 1]))
fig.save_png(FOLDER / "dry_friction.png")
print(len(fig.png()), "bytes")
