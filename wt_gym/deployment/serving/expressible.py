"""Which agents ROSCO's interface has room for: what it sends of what they observe, what it takes of what they do."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from wt_gym.base.errors import ControllerError
from wt_gym.bridges.rosco import READINGS
from wt_gym.bridges.rosco.messages import MOST_BLADES

if TYPE_CHECKING:
    from wt_gym.envs.layout import EnvLayout
    from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["check_expressible", "missing_channels"]

SENT = (
    "rotor_speed", "generator_speed", "generator_power", "generator_torque", "wind_speed", "yaw_error", "azimuth_sin",
    "azimuth_cos", "nacelle_acceleration_fore_aft",
    *(f"root_out_of_plane_moment_{part}" for part in (1, 2, 3, "mean", "tilt", "yaw")),
)  # fmt: skip
"""Channels that are among the readings, or follow from them."""
_OWN = re.compile(r"pitch_offset_\d|residual_mean|previous_.+")
"""Channels of what the agent itself asked for."""


def missing_channels(layout: EnvLayout) -> list[str]:
    """Channels of an observation that ROSCO does not send, each once, whatever its age."""
    names = dict.fromkeys(name.partition("@")[0] for name in layout.observation.names)
    return [name for name in names if name not in SENT and not _OWN.fullmatch(name)]


def check_expressible(env: WindTurbineEnv) -> None:
    """Refuse what cannot act through ROSCO's interface.

    Parameters
    ----------
    env : WindTurbineEnv
        That an agent acts in.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        With all reasons.
    """
    layout, action, reasons = env.layout, env.layout.action, []
    if layout.turbine.n_blades > MOST_BLADES:
        reasons.append(f"it has set points for at most {MOST_BLADES} blades, the turbine has {layout.turbine.n_blades}")
    if action.mode != "residual":
        reasons.append(
            f"it takes offsets on its own demands: action_mode must be 'residual', got {action.mode!r} actions, which "
            "are the demands themselves"
        )
    if "yaw" in action.components:
        reasons.append("it takes an offset of the yaw error and no yaw rate: action_components must leave out 'yaw'")
    if "torque" in action.components:
        reasons.append(
            "it takes a torque offset, but version 2.10 does not apply it: action_components must leave out 'torque'"
        )
    if action.mode == "residual" and env.operation.residual is not None and env.operation.residual.fades:
        reasons.append("it does not send the pitch, by which residual_fade fades the offsets: it must be False")
    if missing := missing_channels(layout):
        reasons.append(
            f"of the observation it does not send {', '.join(missing)}; what follows from its {len(READINGS)} readings "
            f"is {', '.join(SENT)}"
        )
    if reasons:
        raise ControllerError(f"ROSCO's interface cannot serve this agent: {'; '.join(reasons)}")
