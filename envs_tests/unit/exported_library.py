"""An exported library and Python's controllers on the same readings, for tests."""

import math
from pathlib import Path

import numpy as np

from wt_gym.control import Demand
from wt_gym.control.bladed.library import Library
from wt_gym.control.bladed.records import new_swap, write_demand, write_readings, write_turbine
from wt_gym.control.reference_loads import reference_flap_moment

OUT_OF_PLANE, IN_PLANE, PITCH = (30, 31, 32), (69, 70, 71), (4, 33, 34)


class Exported:
    """A loaded library, called like a simulation does."""

    def __init__(self, path, turbine, input_file="", demand=None, individual=True):
        self.library, self.turbine, self.input_file = Library(Path(path)), turbine, str(input_file)
        self.swap = new_swap()
        write_turbine(self.swap, turbine, individual, (self.input_file, self.library.output_name))
        if demand is not None:
            write_demand(self.swap, demand)
        self.calls, self.flag, self.message = 0, 0, ""

    def read(self, signals):
        """Take readings and give them back as the library has them: in single precision."""
        write_readings(self.swap, signals, self.turbine.n_blades)
        return as_read(self.swap, self.turbine.n_blades)

    def call(self, time, interval, status=None):
        """Call once and return the demands."""
        self.swap[:3] = (0 if self.calls == 0 else 1) if status is None else status, time, interval
        self.flag, self.message = self.library.call(self.swap, self.input_file)
        self.calls += 1
        n = self.turbine.n_blades
        return Demand(self.swap[41 : 41 + n].astype(float), float(self.swap[47]), float(self.swap[46]))


def as_read(swap, n_blades):
    """Signals by name as records hold them."""
    swap = swap.astype(np.float64)
    read = {
        "generator_speed": swap[19], "rotor_speed": swap[20], "generator_power": swap[14], "generator_torque": swap[22],
        "yaw_error": swap[23], "yaw": swap[36], "wind_x": swap[26], "wind_y": 0.0,
        "nacelle_acceleration_fore_aft": swap[52], "nacelle_acceleration_side_side": swap[53], "azimuth": swap[59],
    }  # fmt: skip
    for b in range(n_blades):
        out, within, angle = (swap[records[b] - 1] for records in (OUT_OF_PLANE, IN_PLANE, PITCH))
        read[f"pitch_{b + 1}"] = angle
        read[f"root_flap_moment_{b + 1}"] = out * math.cos(angle) + within * math.sin(angle)
        read[f"root_edge_moment_{b + 1}"] = within * math.cos(angle) - out * math.sin(angle)
    return {name: float(value) for name, value in read.items()}


def random_readings(turbine, count, seed, dt):
    """Readings that wander over everything that a turbine meets, with jumps."""
    rng = np.random.default_rng(seed)
    drive = turbine.drivetrain
    n, moment = turbine.n_blades, 2.0 * reference_flap_moment(turbine)

    def walk(low, high, rate):
        """A value that wanders and sometimes jumps, kept in a range by reflection."""
        value = rng.uniform(low, high)
        for _ in range(count):
            if rng.random() < 0.005:
                value = rng.uniform(low, high)
            value += rate * (high - low) * rng.normal()
            value = low + abs(value - low) if value < low else high - abs(high - value) if value > high else value
            yield min(max(value, low), high)

    speed = drive.rated_rotor_speed
    names = {
        "rotor_speed": (0.0, 1.3 * speed, 0.01), "torque_part": (0.0, 1.1, 0.02), "wind_x": (1.0, 30.0, 0.02),
        "yaw_error": (-0.6, 0.6, 0.02), "fore_aft": (-1.0, 1.0, 0.1), "side_side": (-0.5, 0.5, 0.1),
    }  # fmt: skip
    names |= {f"pitch_{b + 1}": (-0.05, 0.5, 0.01) for b in range(n)}
    names |= {f"root_{kind}_moment_{b + 1}": (-moment, moment, 0.03) for kind in ("flap", "edge") for b in range(n)}
    walks = {name: walk(*row) for name, row in names.items()}
    azimuth = rng.uniform(0.0, 2.0 * math.pi)
    for k in range(count):
        now = {name: next(walk) for name, walk in walks.items()}
        azimuth = (azimuth + now["rotor_speed"] * dt) % (2.0 * math.pi)
        torque = now.pop("torque_part") * drive.max_generator_torque
        generator_speed = now["rotor_speed"] * drive.gear_ratio
        yield now | {
            "time": k * dt, "wind_y": 0.0, "azimuth": azimuth, "yaw": 0.0, "generator_speed": generator_speed,
            "generator_torque": torque, "generator_power": torque * generator_speed, "shaft_torque": 0.0,
            "rotor_thrust": 0.0, "nacelle_acceleration_fore_aft": now.pop("fore_aft"),
            "nacelle_acceleration_side_side": now.pop("side_side"),
        }  # fmt: skip
