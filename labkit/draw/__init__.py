"""Pictures: time plots, curves, phase portraits, sketches. Each is an ordinary Matplotlib figure
in one house style.

time_plot(run, "x", ("V", "F"))
phase_portrait(system, "x", "v", starts=40, horizon=10.0)
Sketch(8, 3)
"""

from .curves import Curves, curves
from .figure import COLORS, Figure, figure, mode_colors
from .overlay import Handle
from .phase import PhasePortrait, phase_portrait
from .planes import Planes, arrow_heads, flow_lines, planes
from .sketch import Motion, Sketch
from .time import TimePlot, time_plot
from .view import Only, View

__all__ = [
    "COLORS",
    "Curves",
    "Figure",
    "Handle",
    "Motion",
    "Only",
    "PhasePortrait",
    "Planes",
    "Sketch",
    "TimePlot",
    "View",
    "arrow_heads",
    "curves",
    "figure",
    "flow_lines",
    "mode_colors",
    "phase_portrait",
    "planes",
    "time_plot",
]
