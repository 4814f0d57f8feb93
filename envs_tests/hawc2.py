"""Boxes of turbulence as HAWC2's files."""

from pathlib import Path

import numpy as np


def write_hawc2(box, files):
    """Write the fluctuations of a box as three files, of u, v and w; give the spacing (dx, dy, dz) [m]."""
    samples = np.moveaxis(box.scale * box.fluctuation[::-1], (3, 0, 2, 1), (0, 1, 2, 3))
    for path, component in zip(files, samples, strict=True):
        Path(path).write_bytes(np.ascontiguousarray(component, dtype="<f4").tobytes())
    return box.time_step * box.mean_speed, box.spacing_y, box.spacing_z
