"""The lidar of an environment: which one is read, with what noise, and its channels of an observation."""

import math

import numpy as np

from wt_gym.base.options import shown
from wt_gym.control import Channel, Lidar
from wt_gym.control.controllers import Controller, lidar_of
from wt_gym.envs.channels import Observed, Situation
from wt_gym.envs.terms import Term

LIDAR_NOISE = 0.1
"""Noise of the mean over the beams of a gate of a lidar, at level 1 [m/s]."""


def lidar_noise(lidar: Lidar) -> float:
    """Noise of a reading of a lidar at level 1 [m/s].

    That of a beam apart is so much larger that the mean over the beams of a gate, whose noises are independent, has
    `LIDAR_NOISE`.
    """
    return LIDAR_NOISE * math.sqrt(lidar.n_beams) if lidar.apart else LIDAR_NOISE


def look(situation: Situation) -> np.ndarray:
    """Readings of the lidar [m/s]."""
    result: np.ndarray = situation.operation.seen()
    return result


class LidarTerm(Term):
    """Channels of a lidar: that of the options, that of the base controller, or one for the rotor diameter [m].

    Raises
    ------
    ValueError
        If the base controller reads another lidar than that of the options.
    """

    def __init__(self, rotor_diameter: float, choice: Lidar | None = None, controller: Controller | None = None):
        of_controller = None if controller is None else lidar_of(controller)
        if choice is not None and of_controller is not None and not choice.serves(of_controller):
            raise ValueError(
                f"the base controller reads {of_controller}; lidar must be the same, the same with apart=True, or "
                f"None, got {shown(choice)}"
            )
        self.lidar = choice or of_controller or Lidar.for_rotor(rotor_diameter)

    def groups(self) -> dict[str, list[Observed]]:
        """Channel of each gate or beam; beams count in the sense of rotation, hence all are even."""
        lidar = self.lidar
        texts = [f"wind {distance:.0f} m ahead, mean over the beams of a cone" for distance in lidar.ranges]
        if lidar.apart:
            texts = [
                f"wind {distance:.0f} m ahead, beam at an azimuth of {360 * beam / lidar.n_beams:.0f} degrees on a cone"
                for distance in lidar.ranges
                for beam in range(lidar.n_beams)
            ]
        noise = lidar_noise(lidar)
        return {
            "lidar": [
                Observed(Channel(name, "m/s", 12.0, 4.0, 0.0, 60.0, noise, text), function=look, index=k)
                for k, (name, text) in enumerate(zip(lidar.names, texts, strict=True))
            ]
        }
