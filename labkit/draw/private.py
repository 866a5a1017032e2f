"""What this package takes of Matplotlib that is private, or does not do what its manual says.

Each has a test in tests/test_draw.py; pyproject.toml bounds the versions for which they hold.
"""

from __future__ import annotations

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path

__all__ = ["closed", "reshape"]


def reshape(patch: PathPatch, path: Path) -> None:
    """reshape(patch, path): PathPatch.set_path, which forgets to say that the patch has changed."""
    patch.set_path(path)
    patch.stale = True


def closed(*polygons: np.ndarray) -> Path:
    """closed((n, 2), (m, 2)) -> one path of closed polygons; of none, an empty one."""
    shown = [polygon for polygon in polygons if len(polygon)]
    if not shown:
        return Path(np.zeros((0, 2)))
    points = np.concatenate([np.append(polygon, polygon[:1], axis=0) for polygon in shown])
    codes = np.full(len(points), Path.LINETO, dtype=Path.code_type)
    ends = np.cumsum([len(polygon) + 1 for polygon in shown])
    codes[np.append(0, ends[:-1])], codes[ends - 1] = Path.MOVETO, Path.CLOSEPOLY
    return Path(points, codes)
