"""labkit: models with modes and events as objects; simulate, draw, slide their parameters.

    from labkit import Mode, Parameter, System, Transition, simulate, explore

Names load on first use, so `import labkit` costs next to nothing and works before anything is
installed (`python -m labkit` sets the environment up).
"""

from __future__ import annotations

import gc
from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Libraries and figures make many objects that stay. To look for cyclic garbage among them after
# every 700 new ones, which is Python's rule, takes half a second of a notebook.
gc.set_threshold(max(gc.get_threshold()[0], 10_000), *gc.get_threshold()[1:])

_HOMES = {
    "model": "At Every Held Mode ModelError Output Parameter System Transition",
    "equations": "equations jacobian parameter_table",
    "diagram": "mode_diagram",
    "solve": "METHODS simulate simulate_many",
    "exports": "repeated",
    "run": "Ended Event Run Touch Work load_npz",
    "runs": "Runs",
    "table": "Table",
    "draw": "COLORS Handle Motion Only Sketch View curves figure mode_colors phase_portrait planes "
    "time_plot",
    "linear": "affine borders classify eigenlines eigenvalues equilibrium error_table exact "
    "true_error",
    "answers": "Check check",
    "sweeps": "Sweep sweep",
    "poincare": "Section section",
    "cycles": "Cycle Monodromy monodromy periodic",
    "similarity": "canonical check_design design matrix_a matrix_b reflection rotation",
    "families": "decomposition describe family",
    "characteristics": "Branch Characteristic characteristic from_points",
    "points": "Movable movable",
    "panel": "explore",
    "course": "assignment catalogue choose project",
}
_HOME = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"labkit has no {name!r}; it has {', '.join(__all__)}")
    home = _HOME[name]
    module = import_module(f".{home}", __name__)
    if home in _HOME:  # equations: importing the module has put it in the place of the function
        globals()[home] = getattr(module, home)
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
