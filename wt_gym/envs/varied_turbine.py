"""Turbines that differ from a model by a few factors: what their controllers do not know."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from wt_gym.turbines.checks import check_number
from wt_gym.turbines.model import with_site

if TYPE_CHECKING:
    from wt_gym.turbines.blade import BeamStations
    from wt_gym.turbines.model import PitchSystem, Support, Tower, Turbine

__all__ = ["varied_turbine"]


def varied_turbine(
    turbine: Turbine,
    *,
    tower_frequency: float = 1.0,
    tower_damping: float = 1.0,
    blade_stiffness: float = 1.0,
    air_density: float = 1.0,
    drive_lag: float = 0.0,
    pitch_rate: float = 1.0,
) -> Turbine:
    """Return a turbine with other structure, air or pitch drives; without a change the turbine itself.

    Parameters
    ----------
    turbine : Turbine
    tower_frequency : float
        Factor on the frequencies of the tower [-]: its stiffness, that of a monopile and that of the foundation are
        multiplied by the square. Gravity, which softens a tower by some percent, stays.
    tower_damping : float
        Factor on the damping ratio of the tower [-].
    blade_stiffness : float
        Factor on the stiffness of all sections of the blades [-]. The stiffness that the rotation adds stays.
    air_density : float
        Factor on the density of the air [-]. Density for which controllers are designed stays, and the rated wind speed
        follows (`wt_gym.turbines.model.with_site`).
    drive_lag : float
        Lag of the pitch drives behind a moving demand [s]: they become critically damped servos of frequency 2 / lag,
        or of 2 ζ / (lag + the lag that the turbine's servos have already). Zero: the drives of the turbine.
    pitch_rate : float
        Factor on the greatest pitch rate [-].

    Raises
    ------
    TurbineDefinitionError
        If a number is out of range.

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> soft = varied_turbine(load_turbine("nrel_5mw"), tower_frequency=0.9, drive_lag=0.4)
    >>> round(soft.pitch.servo_frequency, 3)
    5.0
    """
    for name, value, low, high in (
        ("tower_frequency", tower_frequency, 0.3, 3.0),
        ("tower_damping", tower_damping, 0.0, 20.0),
        ("blade_stiffness", blade_stiffness, 0.2, 5.0),
        ("air_density", air_density, 0.3, 3.0),
        ("drive_lag", drive_lag, 0.0, 10.0),
        ("pitch_rate", pitch_rate, 0.05, 20.0),
    ):
        check_number(name, value, low, high)
    changed = turbine
    if tower_frequency != 1.0 or tower_damping != 1.0:
        changed = replace(changed, tower=_tower(turbine.tower, tower_frequency**2, tower_damping))
    if blade_stiffness != 1.0:
        blade = turbine.blade
        changed = replace(changed, blade=replace(blade, structure=_stiffened(blade.structure, blade_stiffness)))
    if air_density != 1.0:
        changed = with_site(changed, {"air_density": air_density * turbine.air_density})
    if drive_lag != 0.0 or pitch_rate != 1.0:
        changed = replace(changed, pitch=_drives(turbine.pitch, drive_lag, pitch_rate))
    return changed


def _stiffened(beam: BeamStations, factor: float) -> BeamStations:
    return replace(beam, stiffness=factor * beam.stiffness)


def _tower(tower: Tower, stiffness: float, damping: float) -> Tower:
    support = tower.support
    if support is not None and stiffness != 1.0:
        support = _support(support, stiffness)
    structure = tower.structure if stiffness == 1.0 else _stiffened(tower.structure, stiffness)
    return replace(tower, structure=structure, support=support, damping_ratio=damping * tower.damping_ratio)


def _support(support: Support, stiffness: float) -> Support:
    foundation = None if support.foundation is None else stiffness * support.foundation
    return replace(support, structure=_stiffened(support.structure, stiffness), foundation=foundation)


def _drives(pitch: PitchSystem, lag: float, rate: float) -> PitchSystem:
    changes: dict[str, float] = {"max_rate": rate * pitch.max_rate}
    if lag > 0.0:
        own = 0.0 if pitch.servo_frequency is None else 2.0 * pitch.servo_damping / pitch.servo_frequency
        damping = 1.0 if pitch.servo_frequency is None else pitch.servo_damping
        changes |= {"servo_frequency": 2.0 * damping / (lag + own), "servo_damping": damping}
    return replace(pitch, **changes)
