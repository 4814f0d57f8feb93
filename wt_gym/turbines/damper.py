"""Turbines whose generator is a linear damper, M = c Ω, and takes no demand (Gebhardt et al. 2012)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from wt_gym.turbines.checks import fail

if TYPE_CHECKING:
    from wt_gym.turbines.model import Drivetrain, Turbine

__all__ = ["GENERATORS", "damped_speed", "with_damper", "with_generator"]

MOST_TORQUE = 1.1
"""Greatest torque that a damper is to bear, over that at rated power, for the range of sensors."""


def damped_speed(drivetrain: Drivetrain, power: float) -> float:
    """Rotor speed [rad/s] at which a damper makes an electrical power [W]: P = η c Ω².

    η is the efficiency of gearbox and generator, c ``drivetrain.generator_damping``.
    """
    efficiency = drivetrain.gearbox_efficiency * drivetrain.generator_efficiency
    return math.sqrt(power / (efficiency * drivetrain.generator_damping))


def with_damper(turbine: Turbine) -> Turbine:
    """Return the turbine with its generator as a linear damper, which takes no demand.

    Rated rotor speed is then that at which the damper makes the rated power, unless the rotor's own is lower: with
    2.0e6 N m s/rad and 2.3 MW 10.2 rpm instead of 16 rpm. A turbine with a damper is returned as it is.

    Parameters
    ----------
    turbine : Turbine

    Raises
    ------
    TurbineDefinitionError
        If the turbine's generator has no damping.
    """
    drivetrain = turbine.drivetrain
    if not drivetrain.takes_torque:
        return turbine
    if not drivetrain.generator_damping > 0.0:
        raise fail(
            f"generator of {turbine.name!r}", "damper", "'torque': its Drivetrain.generator_damping [N m s/rad] is 0"
        )
    speed = min(damped_speed(drivetrain, drivetrain.rated_power), drivetrain.rated_rotor_speed)
    torque = drivetrain.generator_damping * speed * drivetrain.gearbox_efficiency / drivetrain.gear_ratio
    damped = replace(
        drivetrain,
        rated_rotor_speed=speed,
        min_rotor_speed=min(drivetrain.min_rotor_speed, 0.6 * speed),
        max_generator_torque=MOST_TORQUE * torque,
        max_torque_rate=0.0,
    )
    return replace(turbine, drivetrain=damped)


GENERATORS = ("torque", "damper")

Law = TypeVar("Law")
"""A custom law, see `wt_gym.simulation.drivetrain.drives`."""


def with_generator(turbine: Turbine, choice: str | Law | None) -> tuple[Turbine, Law | None]:
    """A turbine with the generator that is chosen by name, and what is left of the choice: a custom law, or None.

    Parameters
    ----------
    turbine : Turbine
    choice : "torque", "damper", None or object
        None: what the turbine has.

    Raises
    ------
    TurbineDefinitionError
        If the turbine cannot have it.
    """
    if not isinstance(choice, str):
        return turbine, choice
    if choice not in GENERATORS:
        raise fail("generator", choice, f"one of {GENERATORS} or a law of wt_gym.simulation.drivetrain.drives")
    if choice == "damper":
        return with_damper(turbine), None
    if not turbine.drivetrain.takes_torque:
        raise fail(f"generator of {turbine.name!r}", choice, "'damper': its generator takes no demand")
    return turbine, None
