"""What a simulator of a counter-clockwise rotor reflects: it simulates the mirror image, whose rotor turns clockwise.

The equations of motion and of the air know no left and right: the mirror image, y → −y, of a motion in a wind is the
motion of the mirror image in the mirrored wind. So a turbine with ``rotation="counter-clockwise"`` is simulated as its
clockwise image (`wt_gym.turbines.variants`) in the mirrored wind (`wt_gym.wind.MirroredInflow`), with yaw angle and yaw
rate of the other sign, and what comes out is reflected back: signals by their parity (`Channel.parity`), points and
forces by S = diag(1, −1, 1), moments by −S. OpenFAST's ``MirrorRotor`` (drafted for its release 5.1) does the same with
the rotor alone. Snapshots hold the state of the image.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.simulation.channels import EVEN, ODD
from wt_gym.turbines.variants import REFLECTION, REFLECTION_6

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

__all__ = ["reflected_loads", "reflected_shapes", "state_parities", "state_parity"]

_BLADES = re.compile(r"(blade_\d|pitch_|(flap|edge|torsion)_\d+_(collective|cosine|sine))")
_SHAFT = ("azimuth", "shaft_torsion")
_YAW = ("yaw", "yaw_twist")
_PLANES = {"fore_aft": EVEN, "side_side": ODD, "torsion": ODD}
_DIRECTIONS = {"x": EVEN, "y": ODD, "z": EVEN, "turn_x": ODD, "turn_y": EVEN, "turn_z": ODD}


def reflected_loads(loads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force and moment (6,) in global axes, of the other side of the mirror."""
    out: NDArray[np.float64] = loads * REFLECTION_6
    return out


def reflected_shapes(shapes: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Shapes of `wt_gym.simulation.Simulator.geometry`, of the other side of the mirror.

    Vorticity is a pseudovector: by the right-hand rule the circulation along a reflected filament has the other sign.
    """
    signs = {"tower_radius": 1.0, "wake_circulation": -1.0}
    return {name: values * signs.get(name, REFLECTION) for name, values in shapes.items()}


def state_parity(name: str) -> int:
    """Parity of a state of the multibody system under the reflection.

    Coordinates of blades and shaft are in frames that are reflected with them; those of the tower are along axes that
    stay.

    Parameters
    ----------
    name : str
        Of `MultibodySystem.state_names`, rates included.

    Raises
    ------
    KeyError
        If the name is not one of a turbine's.
    """
    base = name.removesuffix("_rate")
    if _BLADES.match(base) or base in _SHAFT:
        return EVEN
    if base in _YAW:
        return ODD
    for pattern, parities in ((r"(\w+)_\d+", _PLANES), (r"(?:tower_)?node_\d+_(\w+)", _DIRECTIONS)):
        match = re.fullmatch(pattern, base)
        if match and match[1] in parities:
            return parities[match[1]]
    raise KeyError(f"no parity of the state {name!r} is known")


def state_parities(names: Iterable[str]) -> NDArray[np.float64]:
    """Parity of each of the states (n,)."""
    return np.array([float(state_parity(name)) for name in names])
