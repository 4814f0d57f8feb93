"""Numbers of the site at which a turbine stands, and of its operation there, in place of those of its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Protocol, TypeVar

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.turbines.checks import check_number

__all__ = ["SITE", "at_controller_density", "with_site", "without_site"]

SITE = {
    "air_density": "kg/m^3",
    "controller_air_density": "kg/m^3",
    "cut_in": "m/s",
    "cut_out": "m/s",
    "iec_class": "",
    "turbulence_class": "",
    "rotation": "",
}
"""Numbers and names of a site, with their units."""

_NOTE = "site: "


class _Sited(Protocol):
    """What a site changes of a turbine, which knows its site: its class stands above this module."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def air_density(self) -> float: ...
    @property
    def controller_air_density(self) -> float: ...
    @property
    def rated_wind_speed(self) -> float: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


_T = TypeVar("_T", bound=_Sited)


def with_site(turbine: _T, site: Mapping[str, Any] | None) -> _T:
    """Return a turbine at a site.

    =========================== ====================================================================================
    ``air_density``             [kg/m^3], 0.1 to 10: density in aerodynamics, tower drag, operating points, available
                                power and reference loads. The rated wind speed scales with ρ^(-1/3), which keeps the
                                power of the wind at rated
    ``controller_air_density``  density that the controller is designed for [kg/m^3]; by default that of the turbine's
                                file, so that the region-2 gain does not change
    ``cut_in``, ``cut_out``     [m/s]: range of wind speeds in which the turbine operates
    ``iec_class``               "I" to "IV": reference wind speed and wind climate
    ``turbulence_class``        "A+", "A", "B" or "C"
    ``rotation``                "clockwise" or "counter-clockwise": direction in which the rotor turns, seen looking
                                downwind
    =========================== ====================================================================================

    Parameters
    ----------
    turbine : Turbine
    site : mapping or None
        Any of the above; None or empty: the turbine as it is.

    Raises
    ------
    TurbineDefinitionError
        If a name is unknown or a value out of range.

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> high = with_site(load_turbine("nrel_5mw"), {"air_density": 1.0})
    >>> round(high.rated_wind_speed, 2)
    12.2
    """
    if site is None:
        return turbine
    if not isinstance(site, Mapping):
        raise TurbineDefinitionError(f"site must map names to values, got {site!r:.100}; names: {', '.join(SITE)}")
    for name in site:
        if name not in SITE:
            near = did_you_mean(name, SITE, ".")
            raise TurbineDefinitionError(f"site has no {name!r:.60}{near} Allowed: {', '.join(SITE)}")
    changes: dict[str, Any] = {name: site[name] for name in site if name != "controller_air_density"}
    if "air_density" in site:
        density = check_number("site['air_density']", site["air_density"], 0.1, 10.0)
        changes["rated_wind_speed"] = turbine.rated_wind_speed * (turbine.air_density / density) ** (1.0 / 3.0)
    designed = turbine.controller_air_density
    if "controller_air_density" in site:
        designed = check_number("site['controller_air_density']", site["controller_air_density"], 0.1, 10.0)
    if designed != changes.get("air_density", turbine.air_density) or "controller_air_density" in site:
        changes["design_air_density"] = designed
    told = [f"{name} {site[name]} {unit}".strip() for name, unit in SITE.items() if name in site]
    return replace(turbine, **changes, notes=(*turbine.notes, _NOTE + ", ".join(told))) if site else turbine


def at_controller_density(turbine: _T) -> _T:
    """The turbine in the air for which its controller is designed: of it the controller's rules take their numbers.

    Parameters
    ----------
    turbine : Turbine
    """
    density = turbine.controller_air_density
    if density == turbine.air_density:
        return turbine
    return replace(
        turbine,
        air_density=density,
        # as many digits as tell the rounding of the way there and back from a turbine's number
        rated_wind_speed=round(turbine.rated_wind_speed * (turbine.air_density / density) ** (1.0 / 3.0), 9),
        design_air_density=None,
        notes=without_site(turbine.notes),
    )


def without_site(notes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the notes of a turbine without those of its site."""
    return tuple(note for note in notes if not note.startswith(_NOTE))
