"""Power and thrust coefficients of a rotor over tip-speed ratio and pitch, as the simulator makes them.

Controllers that estimate the wind or limit the thrust need the quasi-steady rotor. The tables of the catalogue's
turbines stand in their records and were made by ``scripts/rotor_table.py``: the rotor of the coupled simulator
(lattice, wake, flexible blades and tower, tilt, cone, tower shadow), held at a speed and a pitch in a steady uniform
wind until the wake has settled (`rotor_measurement.measure_rotor`). Any other turbine gets its table by blade elements
(`blade_element_table`) in about a second; below rated wind the simulator's rotor makes up to a tenth more power. A
table measured by the script goes before it: put into the folder ``rotor`` of the user's cache (`measured_table_path`).
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.user_cache import user_cache
from wt_gym.control.design import fine_pitch
from wt_gym.control.rotor import rotor_of
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines.site import at_controller_density, without_site

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine

__all__ = ["RotorTable", "blade_element_table", "measured_table_path", "rotor_table"]

_known: dict[str, RotorTable] = {}
_MEASUREMENT = 2
"""Of tables in the cache; one more when `measure_rotor` or what it runs on measures anything else."""


@dataclass(frozen=True, eq=False)
class RotorTable:
    """Power and thrust coefficients, bilinear between the points and held beyond the ends.

    Attributes
    ----------
    turbine : str
        Name.
    radius : float
        To which coefficients and tip-speed ratio refer, half the rotor diameter [m].
    air_density : float
        [kg/m^3].
    tip_speed_ratio : numpy.ndarray, shape (n,)
        Ascending.
    pitch : numpy.ndarray, shape (m,)
        Ascending [rad].
    power, thrust : numpy.ndarray, shape (n, m)
        Coefficients of the aerodynamic power and of the force of the air along the shaft [-].
    made_by : str
        Fidelity and version with which the table was measured.
    """

    turbine: str
    radius: float
    air_density: float
    tip_speed_ratio: NDArray[np.float64]
    pitch: NDArray[np.float64]
    power: NDArray[np.float64]
    thrust: NDArray[np.float64]
    made_by: str

    def __deepcopy__(self, memo: dict[int, object]) -> RotorTable:
        """A table never changes: copies of controllers share it."""
        return self

    @cached_property
    def _rows(self) -> tuple[list[float], list[float], list[list[float]], list[list[float]]]:
        """Grid and values as lists: single look-ups in them are faster than in arrays."""
        return self.tip_speed_ratio.tolist(), self.pitch.tolist(), self.power.tolist(), self.thrust.tolist()

    def _interpolate(self, values: list[list[float]], ratio: float, pitch: float) -> float:
        ratios, pitches = self._rows[:2]
        i, u = _place(ratios, ratio)
        j, v = _place(pitches, pitch)
        low, high = values[i], values[i + 1]
        return float((1 - u) * ((1 - v) * low[j] + v * low[j + 1]) + u * ((1 - v) * high[j] + v * high[j + 1]))

    def power_coefficient(self, ratio: float, pitch: float) -> float:
        """Power coefficient at a tip-speed ratio and a pitch [rad]."""
        return self._interpolate(self._rows[2], ratio, pitch)

    def thrust_coefficient(self, ratio: float, pitch: float) -> float:
        """Thrust coefficient at a tip-speed ratio and a pitch [rad]."""
        return self._interpolate(self._rows[3], ratio, pitch)

    def torque(self, wind: float, rotor_speed: float, pitch: float) -> float:
        """Moment of the air about the shaft [N m] in a wind [m/s], at a rotor speed [rad/s] and pitch [rad]."""
        coefficient = self.power_coefficient(rotor_speed * self.radius / wind, pitch)
        return 0.5 * self.air_density * math.pi * self.radius**2 * wind**3 * coefficient / rotor_speed

    def thrust_force(self, wind: float, rotor_speed: float, pitch: float) -> float:
        """Force of the air along the shaft [N]; arguments as `torque`."""
        coefficient = self.thrust_coefficient(rotor_speed * self.radius / wind, pitch)
        return 0.5 * self.air_density * math.pi * self.radius**2 * wind**2 * coefficient

    @cached_property
    def optimum(self) -> tuple[float, float]:
        """Tip-speed ratio and power coefficient of the largest power at the finest pitch of the table.

        The top of the parabola through the highest point and its neighbors.
        """
        column = self.power[:, 0]
        k = int(np.clip(np.argmax(column), 1, len(column) - 2))
        a, b, c = np.polyfit(self.tip_speed_ratio[k - 1 : k + 2], column[k - 1 : k + 2], 2)
        top = float(-b / (2 * a)) if a < 0 else float(self.tip_speed_ratio[k])
        return top, float(np.polyval((a, b, c), top))

    def best_pitch(self, ratio: float) -> float:
        """Pitch of the largest power at a tip-speed ratio [rad], among the pitches of the table and between them."""
        fine = np.linspace(self.pitch[0], self.pitch[-1], 20 * len(self.pitch))
        return float(fine[np.argmax([self.power_coefficient(ratio, p) for p in fine])])

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values: pitch in degrees, coefficients with five digits behind the point."""
        coefficients = {
            name: [[round(x, 5) for x in row] for row in getattr(self, name).tolist()] for name in ("power", "thrust")
        }
        return {
            "turbine": self.turbine,
            "radius": self.radius,
            "air_density": self.air_density,
            "made_by": self.made_by,
            "tip_speed_ratio": self.tip_speed_ratio.tolist(),
            "pitch_deg": np.degrees(self.pitch).round(6).tolist(),
            **coefficients,
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RotorTable:
        """Table of what `to_json` gave."""
        arrays: dict[str, Any] = {
            name: np.array(content[name], dtype=np.float64) for name in ("tip_speed_ratio", "power", "thrust")
        }
        plain = {name: content[name] for name in ("turbine", "radius", "air_density", "made_by")}
        return cls(**(plain | arrays), pitch=np.radians(content["pitch_deg"]))

    def save(self, path: Path) -> None:
        """Write the table as JSON."""
        path.write_text(_text(self.to_json()) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> RotorTable:
        """Read what `save` wrote."""
        return cls.from_json(json.loads(path.read_text(encoding="utf-8")))

    def put_into(self, path: Path) -> None:
        """Write the table into the record of a turbine, in place of the one there.

        Parameters
        ----------
        path : pathlib.Path
            File of the record (`wt_gym.turbine_records`).
        """
        record = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(_text({**record, "rotor_table": self.to_json()}) + "\n", encoding="utf-8")


def _text(value: Any, depth: int = 1) -> str:
    """JSON with a line for each entry of the record and of the table, and for each row of coefficients."""
    indent = " " * depth
    if isinstance(value, dict) and (depth == 1 or "tip_speed_ratio" in value):
        lines = [f"{indent}{json.dumps(key)}: {_text(part, depth + 1)}" for key, part in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent[1:]}}}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return f"[\n{indent}" + f",\n{indent}".join(map(json.dumps, value)) + f"\n{indent[1:]}]"
    return json.dumps(value)


def _place(grid: list[float], value: float) -> tuple[int, float]:
    """Interval of an ascending grid and the fraction in it, held at the ends."""
    k = min(max(bisect_right(grid, value) - 1, 0), len(grid) - 2)
    return k, min(max((value - grid[k]) / (grid[k + 1] - grid[k]), 0.0), 1.0)


def rotor_table(turbine: Turbine) -> RotorTable:
    """Table of a turbine: measured where there is one, else by blade elements.

    Coefficients do not depend on the density of the air: at a site with another the table is that of the turbine in the
    air of its controller, with forces and torques of the site's.

    Parameters
    ----------
    turbine : Turbine

    Returns
    -------
    RotorTable
    """
    from wt_gym.simulation.contract import fingerprint  # the simulator is heavy, and rarely needed here

    home = at_controller_density(turbine)
    if home.rotation != "clockwise":  # a rotor and its mirror image have the same coefficients
        home = replace(home, rotation="clockwise", notes=without_site(home.notes))
    key = fingerprint(home)
    if key not in _known:
        path = measured_table_path(home)
        measured = RotorTable.load(path) if path is not None and path.is_file() else None
        _known[key] = _stored(home) or measured or blade_element_table(home)
    table = _known[key]
    return table if table.air_density == turbine.air_density else replace(table, air_density=turbine.air_density)


@lru_cache(maxsize=32)
def blade_element_table(turbine: Turbine) -> RotorTable:
    """Table of a turbine by blade elements (`wt_gym.control.rotor`), from its fine pitch on.

    Parameters
    ----------
    turbine : Turbine
    """
    fine = fine_pitch(turbine)
    pitch = fine + np.radians(np.concatenate([np.arange(0.0, 6.0, 0.5), np.arange(6.0, 36.1, 1.5)]))
    ratios = np.concatenate([np.arange(2.0, 6.0, 0.5), np.arange(6.0, 11.0, 0.25), np.arange(11.0, 16.1, 0.5)])
    rotor = rotor_of(turbine)
    power, thrust = rotor.coefficients(ratios, pitch)
    return RotorTable(
        turbine=turbine.name,
        radius=rotor.radius,
        air_density=turbine.air_density,
        tip_speed_ratio=ratios,
        pitch=pitch,
        power=power,
        thrust=thrust,
        made_by="blade elements",
    )


def _stored(turbine: Turbine) -> RotorTable | None:
    """Table in the record of a turbine of this name and size."""
    for record in RECORDS.values():
        if record.rotor_table is not None and record.rotor_table["turbine"] == turbine.name:
            table = RotorTable.from_json(record.rotor_table)
            if math.isclose(table.radius, turbine.rotor_diameter / 2, rel_tol=1e-6):
                return table
    return None


def measured_table_path(turbine: Turbine) -> Path | None:
    """Where a table of this turbine, measured by ``scripts/rotor_table.py``, is looked for; None without a cache."""
    from wt_gym.simulation.contract import fingerprint

    folder = user_cache()
    return folder / "rotor" / f"{fingerprint(turbine)[:20]}-{_MEASUREMENT}.json" if folder is not None else None
