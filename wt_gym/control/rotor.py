"""The quasi-steady rotor of a turbine: blade elements, and tables of its coefficients.

*Blade elements* (`Rotor`): all numbers follow from the turbine's own blade and polars
(`wt_gym.turbines.blade_element`), in a fraction of a second. The blade is rigid and straight, the wind uniform along
the shaft; tower, tilt and deflection are left out. The lattice of the simulator makes up to a tenth more power than
blade-element theory below rated wind.

*Tables* (`RotorTable`): controllers that estimate the wind or limit the thrust need the quasi-steady rotor. The tables
of the catalog's turbines stand in their records and were made by ``scripts/studies/rotor_table.py``: the rotor of the
coupled simulator (lattice, wake, flexible blades and tower, tilt, cone, tower shadow), held at a speed and a pitch in a
steady uniform wind until the wake has settled (``measure_rotor`` there). Any other turbine gets its table by blade
elements (`blade_element_table`) in about a second; below rated wind the simulator's rotor makes up to a tenth more
power. A table measured by the script goes before it: put into the folder ``rotor`` of the user's cache
(`measured_table_path`).
"""

import json
import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from wt_gym.base.user_cache import user_cache
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import Turbine
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements
from wt_gym.turbines.model import at_controller_density, without_site

_N_SPAN = 30
"""Sections; the power changes by less than 0.3 % with twice as many."""
_RATIOS = np.concatenate([np.arange(1.5, 6.0, 0.5), np.arange(6.0, 12.0, 0.4), np.arange(12.0, 22.1, 1.25)])
_PITCH = np.radians(np.arange(-8.0, 40.1, 1.25))
"""Grid of the splines: tip-speed ratios and pitch angles [rad]."""
_FINE_RATIOS = np.arange(3.0, 14.01, 0.05)
_LOWEST_FINE, _HIGHEST_FINE = math.radians(-5.0), math.radians(10.0)
"""Range in which the pitch of the largest power coefficient is looked for [rad]."""


@dataclass(frozen=True)
class RotorSlopes:
    """Derivatives of the aerodynamic moment about the shaft and of the thrust at a point."""

    torque_wind: float  #: [N m/(m/s)]
    torque_speed: float  #: [N m/(rad/s)]
    torque_pitch: float  #: [N m/rad]
    thrust_wind: float  #: [N/(m/s)]
    thrust_speed: float  #: [N/(rad/s)]
    thrust_pitch: float  #: [N/rad]


class Rotor:
    """Rotor of a turbine by blade elements."""

    def __init__(self, turbine: Turbine):
        self.elements = BladeElements(BladeElementRotor.of_turbine(turbine), _N_SPAN)
        self.radius, self.air_density = turbine.rotor_diameter / 2, turbine.air_density
        self._lowest = max(turbine.pitch.min_pitch, _LOWEST_FINE)

    def power(self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike) -> NDArray[np.float64]:
        """Aerodynamic power [W], shape (n,), of points (n,): wind [m/s], rotor speed [rad/s] and pitch [rad]."""
        return self._forces(wind, rotor_speed, pitch)[0]

    def thrust(self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike) -> NDArray[np.float64]:
        """Thrust [N], shape (n,); arguments as `power`."""
        return self._forces(wind, rotor_speed, pitch)[1]

    def _forces(
        self, wind: ArrayLike, rotor_speed: ArrayLike, pitch: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Power [W] and thrust [N] of points (n,): by the splines, or solved where a point lies beyond them."""
        given = (np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in (wind, rotor_speed, pitch))
        winds, speeds, angles = np.broadcast_arrays(*given)
        ratio = speeds * self.radius / winds
        inside = (ratio >= _RATIOS[0]) & (ratio <= _RATIOS[-1]) & (angles >= _PITCH[0]) & (angles <= _PITCH[-1])
        if not inside.all():
            solved = self.elements.solve(winds, speeds, angles)
            return solved["power"], solved["thrust"]
        pressure = 0.5 * self.air_density * math.pi * self.radius**2 * winds**2
        power, thrust = self._splines
        return pressure * winds * power.ev(ratio, angles), pressure * thrust.ev(ratio, angles)

    @cached_property
    def _splines(self) -> tuple[RectBivariateSpline, RectBivariateSpline]:
        """Power and thrust coefficients over tip-speed ratio and pitch [rad], cubic between solved points."""
        values = self.coefficients(_RATIOS, _PITCH)
        return RectBivariateSpline(_RATIOS, _PITCH, values[0]), RectBivariateSpline(_RATIOS, _PITCH, values[1])

    def coefficients(
        self, ratio: NDArray[np.float64], pitch: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Solve power and thrust coefficients (n, m) over tip-speed ratios (n,) and pitch angles (m,) [rad]."""
        ratios, angles = (x.ravel() for x in np.meshgrid(ratio, pitch, indexing="ij"))
        wind = 10.0
        solved = self.elements.solve(wind, ratios * wind / self.radius, angles)
        reference = 0.5 * self.air_density * math.pi * self.radius**2 * wind**2
        shape = ratio.size, pitch.size
        return (solved["power"] / (reference * wind)).reshape(shape), (solved["thrust"] / reference).reshape(shape)

    @cached_property
    def optimum(self) -> tuple[float, float, float]:
        """Tip-speed ratio, pitch [rad] and power coefficient of the largest power coefficient.

        The pitch lies within the range of the drives, from -5 to 10 deg.
        """
        pitch = np.linspace(self._lowest, _HIGHEST_FINE, 121)
        power = self._splines[0](_FINE_RATIOS, pitch)
        i, j = np.unravel_index(int(np.argmax(power)), power.shape)
        return float(_FINE_RATIOS[i]), float(pitch[j]), float(power[i, j])

    def best_ratio(self, pitch: float) -> tuple[float, float]:
        """Tip-speed ratio of the largest power at a pitch [rad], and the power coefficient there."""
        power = self._splines[0](_FINE_RATIOS, [pitch])[:, 0]
        k = int(np.argmax(power))
        return float(_FINE_RATIOS[k]), float(power[k])

    def power_coefficient(self, ratio: float, pitch: float) -> float:
        """Power coefficient at a tip-speed ratio and a pitch [rad]."""
        wind = 10.0
        reference = 0.5 * self.air_density * math.pi * self.radius**2 * wind**3
        return float(self.power(wind, ratio * wind / self.radius, pitch)[0]) / reference

    def pitch_of_power(
        self, wind: ArrayLike, rotor_speed: float, power: float, least: ArrayLike, most: float = 0.66
    ) -> NDArray[np.float64]:
        """Smallest pitch from ``least`` on at which the power falls to ``power`` [rad], shape (n,).

        For winds (n,) [m/s], a rotor speed [rad/s] and an aerodynamic power [W]; ``least`` (n,) and ``most`` are the
        ends of the search [rad].
        """
        winds = np.atleast_1d(np.asarray(wind, dtype=np.float64))
        low = np.broadcast_to(np.asarray(least, dtype=np.float64), winds.shape).copy()
        enough = self.power(winds, rotor_speed, low) > power
        # the power rises with the pitch where a blade leaves stall: begin beyond its last crossing
        steps = np.linspace(0.0, 1.0, 71)
        angles = low[:, None] + steps[None, :] * (most - low)[:, None]
        surplus = self.power(np.repeat(winds, steps.size), rotor_speed, angles.ravel()).reshape(angles.shape) > power
        last = np.where(surplus.any(axis=1), surplus.shape[1] - 1 - np.argmax(surplus[:, ::-1], axis=1), 0)
        last = np.minimum(last, steps.size - 2)
        rows = np.arange(winds.size)
        a, b = angles[rows, last], angles[rows, last + 1]
        for _ in range(36):
            middle = 0.5 * (a + b)
            above = self.power(winds, rotor_speed, middle) > power
            a, b = np.where(above, middle, a), np.where(above, b, middle)
        return np.where(enough | surplus.any(axis=1), 0.5 * (a + b), low)

    def slopes(self, wind: float, rotor_speed: float, pitch: float) -> RotorSlopes:
        """Derivatives at a steady point, by central differences with the induction in equilibrium.

        The point is a wind [m/s], a rotor speed [rad/s] and a pitch [rad].
        """
        changes = (0.02 * wind, 0.01 * rotor_speed, math.radians(0.25))
        points = np.tile([wind, rotor_speed, pitch], (6, 1))
        for k, change in enumerate(changes):
            points[2 * k, k] += change
            points[2 * k + 1, k] -= change
        power, thrust = self._forces(*points.T)
        torque = power / points[:, 1]
        found = [
            (values[2 * k] - values[2 * k + 1]) / (2.0 * change)
            for values in (torque, thrust)
            for k, change in enumerate(changes)
        ]
        return RotorSlopes(*map(float, found))

    def frozen_pitch_slope(self, wind: float, rotor_speed: float, pitch: float) -> float:
        """Change of the power with the pitch while the induced velocities are held [W/rad].

        So NREL/TP-500-38060, section 7.3, defines the sensitivity behind the gains of the pitch controller: a speed
        loop is faster than the wake.
        """
        change = math.radians(0.25)
        moved = self.elements.frozen_wake(wind, rotor_speed, pitch, (change, -change))["power"]
        return float((moved[0] - moved[1]) / (2.0 * change))

    def frozen_torque_slopes(
        self, wind: float, rotor_speed: float, pitch: float
    ) -> tuple[tuple[float, float, float], float]:
        """Derivatives of the moment about the shaft while the induced velocities are held, and the mean induction.

        At a wind [m/s], a rotor speed [rad/s] and a pitch [rad]: the slopes over the wind [N m/(m/s)], the speed
        [N m/(rad/s)] and the pitch [N m/rad], and the mean axial induction factor over the disc [-].
        """
        steps = np.array([0.02 * wind, 0.01 * rotor_speed, math.radians(0.25)])
        winds, speeds, angles = np.vstack([np.diag(steps), -np.diag(steps)]).T
        moved = self.elements.frozen_wake(wind, rotor_speed, pitch, angles, winds, speeds)
        torque = moved["power"] / (rotor_speed + speeds)
        slopes = (torque[:3] - torque[3:]) / (2.0 * steps)
        induction = float(np.average(moved["axial"][2], weights=self.elements.radius))  # there the pitch moved alone
        return (float(slopes[0]), float(slopes[1]), float(slopes[2])), induction


@lru_cache(maxsize=32)
def rotor_of(turbine: Turbine) -> Rotor:
    """Rotor of a turbine; the same object for the same turbine."""
    return Rotor(turbine)


@lru_cache(maxsize=32)
def fine_pitch(turbine: Turbine) -> float:
    """Pitch of optimal power below rated [rad].

    The least pitch of a published schedule over the wind, else the published fine pitch, else that of the largest power
    coefficient by blade elements; never below the range of the drives.
    """
    own, lowest = turbine.control, turbine.pitch.min_pitch
    if own is not None and own.min_pitch is not None:
        return max(float(own.min_pitch.min()), lowest)
    if own is not None and own.fine_pitch is not None:
        return max(own.fine_pitch, lowest)
    return max(rotor_of(turbine).optimum[1], lowest)


_known: "dict[str, RotorTable]" = {}
_MEASUREMENT = 2
"""Of tables in the cache; one more when `measure_rotor` or what it runs on measures anything else."""


@dataclass(frozen=True, eq=False)
class RotorTable:
    """Power and thrust coefficients, bilinear between the points and held beyond the ends."""

    turbine: str  #: name
    radius: float  #: to which coefficients and tip-speed ratio refer, half the rotor diameter [m]
    air_density: float  #: [kg/m^3]
    tip_speed_ratio: NDArray[np.float64]  #: ascending, shape (n,)
    pitch: NDArray[np.float64]  #: ascending [rad], shape (m,)
    power: NDArray[np.float64]  #: coefficients of the aerodynamic power [-], shape (n, m)
    thrust: NDArray[np.float64]  #: coefficients of the force of the air along the shaft [-], shape (n, m)
    made_by: str  #: fidelity and version with which the table was measured

    def __deepcopy__(self, memo: dict[int, object]) -> "RotorTable":
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
        plain = {name: getattr(self, name) for name in ("turbine", "radius", "air_density", "made_by")}
        coefficients = {
            name: [[round(x, 5) for x in row] for row in getattr(self, name).tolist()] for name in ("power", "thrust")
        }
        grid = {"tip_speed_ratio": self.tip_speed_ratio.tolist(), "pitch_deg": np.degrees(self.pitch).round(6).tolist()}
        return plain | grid | coefficients

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "RotorTable":
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
    def load(cls, path: Path) -> "RotorTable":
        """Read what `save` wrote."""
        return cls.from_json(json.loads(path.read_text(encoding="utf-8")))

    def put_into(self, path: Path) -> None:
        """Write the table into the record of a turbine (`wt_gym.turbine_records`), in place of the one there."""
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
    """
    from wt_gym.simulation.contract import fingerprint

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
    """Table of a turbine by blade elements (`wt_gym.control.rotor`), from its fine pitch on."""
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
            same = RECORDS[record.rotor_table.get("same_as", record.name)].rotor_table
            table = RotorTable.from_json(cast("dict[str, Any]", same))
            if math.isclose(table.radius, turbine.rotor_diameter / 2, rel_tol=1e-6):
                return table
    return None


def measured_table_path(turbine: Turbine) -> Path | None:
    """Path of a table of this turbine measured by ``scripts/studies/rotor_table.py``; None without a cache."""
    from wt_gym.simulation.contract import fingerprint

    folder = user_cache()
    return folder / "rotor" / f"{fingerprint(turbine)[:20]}-{_MEASUREMENT}.json" if folder is not None else None
