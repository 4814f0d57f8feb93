"""What a linear optimal controller reads: six quantities in the fixed frame that any turbine's bus can carry."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.coleman import to_harmonic

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import Turbine

__all__ = ["OUTPUTS", "channels_read", "measured_outputs", "recorded_outputs", "side_sign"]

OUTPUTS = ("flap_mean", "flap_tilt", "flap_yaw", "acceleration_fore_aft", "acceleration_side_side", "rotor_speed")
"""Flapwise root moments [N m], accelerations of the nacelle [m/s^2] and rotor speed [rad/s]."""

_SINGLE = ("azimuth", "nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side", "rotor_speed")


def channels_read(n_blades: int) -> tuple[str, ...]:
    """Names of the signals from which `OUTPUTS` follow."""
    return (*_SINGLE, *(f"root_flap_moment_{b + 1}" for b in range(n_blades)))


def side_sign(turbine: Turbine) -> float:
    """Sign of what points to the side, so that the mirror image of a turbine has the same outputs."""
    return 1.0 if turbine.rotation == "clockwise" else -1.0


def measured_outputs(signals: Readings, n_blades: int, sign: float, out: NDArray[np.float64]) -> None:
    """Put `OUTPUTS` of one instant into an array (6,).

    Parameters
    ----------
    signals : Readings
    n_blades : int
    sign : float
        Of `side_sign`.
    out : numpy.ndarray, shape (6,)
    """
    moments = [signals[f"root_flap_moment_{b + 1}"] for b in range(n_blades)]
    tilt, yaw = to_harmonic(moments, signals["azimuth"])
    out[0] = sum(moments) / n_blades
    out[1], out[2] = tilt, yaw
    out[3] = signals["nacelle_acceleration_fore_aft"]
    out[4] = sign * signals["nacelle_acceleration_side_side"]
    out[5] = signals["rotor_speed"]


def recorded_outputs(channels: Mapping[str, NDArray[np.float64]], n_blades: int, sign: float) -> NDArray[np.float64]:
    """`OUTPUTS` of a record (6, n), from channels (n,) by name."""
    angles = channels["azimuth"][None] + 2.0 * math.pi / n_blades * np.arange(n_blades)[:, None]
    moments = np.stack([channels[f"root_flap_moment_{b + 1}"] for b in range(n_blades)])
    return np.stack([
        moments.mean(0),
        2.0 / n_blades * (moments * np.cos(angles)).sum(0),
        2.0 / n_blades * (moments * np.sin(angles)).sum(0),
        channels["nacelle_acceleration_fore_aft"],
        sign * channels["nacelle_acceleration_side_side"],
        channels["rotor_speed"],
    ])  # fmt: skip
