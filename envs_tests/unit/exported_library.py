"""An exported library and Python's controllers on the same readings, for tests."""

import math
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from wt_gym.control import Demand
from wt_gym.control.bladed.controller import Library
from wt_gym.control.bladed.records import (
    PLATFORM_CHANNELS,
    new_swap,
    write_demand,
    write_lidar,
    write_platform,
    write_readings,
    write_turbine,
)
from wt_gym.control.design import reference_flap_moment

INTERVAL = 0.1
"""Step of exported controllers [s]."""
OUT_OF_PLANE, IN_PLANE, PITCH = (30, 31, 32), (69, 70, 71), (4, 33, 34)


class Exported:
    """A loaded library, called like a simulation does."""

    def __init__(self, path, turbine, input_file="", demand=None, individual=True, lidar=None):
        self.library, self.turbine, self.input_file = Library(Path(path)), turbine, str(input_file)
        self.swap = new_swap()
        write_turbine(self.swap, turbine, individual, (self.input_file, self.library.output_name))
        if demand is not None:
            write_demand(self.swap, demand)
        self.lidar, self.calls, self.flag, self.message = lidar, 0, 0, ""

    def read(self, signals):
        """Take readings and give them back as the library has them: in single precision."""
        write_all_readings(self.swap, signals, self.turbine)
        if self.lidar is not None:
            write_lidar(self.swap, signals, self.lidar, self.turbine.hub_height, self.turbine.rotation)
        return as_read(self.swap, self.turbine)

    def call(self, time, interval, status=None):
        """Call once and return the demands."""
        self.swap[:3] = (0 if self.calls == 0 else 1) if status is None else status, time, interval
        self.flag, self.message = self.library.call(self.swap, self.input_file)
        self.calls += 1
        n = self.turbine.n_blades
        return Demand(self.swap[41 : 41 + n].astype(float), float(self.swap[47]), float(self.swap[46]))


def together(*flights, spoil=None, dt=INTERVAL, first=0):
    """Demands of libraries with their readings, a list for each, and what the first one said: call, flag, message.

    ``spoil(k, swap)`` changes the records of the first one behind a reading.
    """
    demands, said, ours = [[] for _ in flights], [], flights[0][0]
    for k, rows in enumerate(zip(*(readings for _, readings in flights), strict=True), first):
        for (library, _), now in zip(flights, rows, strict=True):
            library.read(now)
        if spoil is not None:
            spoil(k, ours.swap)
        for made, (library, _) in zip(demands, flights, strict=True):
            made.append(library.call(k * dt, dt))
        if ours.flag:
            said.append((k, ours.flag, ours.message))
    return *demands, said


def lost(*records, since=0, until=math.inf, value=math.nan):
    """What spoils records in some calls, for `together`."""

    def spoil(k, swap):
        if since <= k < until:
            swap[[record - 1 for record in records]] = value

    return spoil


def pitches(demands):
    return np.array([demand.pitch for demand in demands])


def torques(demands):
    return np.array([demand.generator_torque for demand in demands])


def compiled(source, main, folder, sanitizers="address,undefined"):
    """Path of a program of a source and a main function, a file of `data`, under sanitizers."""
    if not (compiler := shutil.which("gcc") or shutil.which("clang")):
        pytest.skip("gcc or clang is needed")
    path = folder / "program"
    main = Path(__file__).with_name("data") / main
    path.with_suffix(".c").write_text(f'#include "{source}"\n#include "{main}"\n', encoding="utf-8")
    flags = ["-std=c99", "-g", "-O1", f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all"]
    command = [compiler, *flags, "-o", str(path), f"{path}.c", "-lm"]
    built = subprocess.run(command, capture_output=True, text=True)
    if "cannot find" in built.stderr:
        pytest.skip("the libraries of the sanitizers are not installed")
    assert built.returncode == 0, built.stderr
    return str(path)


def write_all_readings(swap, signals, turbine):
    """Write the readings of an instant, of a floating turbine with those of its platform."""
    write_readings(swap, signals, turbine.n_blades)
    if turbine.floater is not None:
        write_platform(swap, signals)


def as_read(swap, turbine):
    """Signals by name as records hold them."""
    swap = swap.astype(np.float64)
    yaw = swap[36] - swap[1005]  # record 37 has the yaw of the platform in it
    cos, sin = math.cos(yaw), math.sin(yaw)
    read = {
        "generator_speed": swap[19], "rotor_speed": swap[20], "generator_power": swap[14], "generator_torque": swap[22],
        "yaw_error": swap[23], "yaw": yaw, "wind_x": swap[26], "wind_y": 0.0, "azimuth": swap[59],
        "nacelle_acceleration_fore_aft": cos * swap[52] + sin * swap[53],
        "nacelle_acceleration_side_side": cos * swap[53] - sin * swap[52],
    }  # fmt: skip
    if swap[12] > 0.0:
        read["demanded_power"] = swap[12]
    for b in range(turbine.n_blades):
        out, within, angle = (swap[records[b] - 1] for records in (OUT_OF_PLANE, IN_PLANE, PITCH))
        read[f"pitch_{b + 1}"] = angle
        read[f"root_flap_moment_{b + 1}"] = out * math.cos(angle) + within * math.sin(angle)
        read[f"root_edge_moment_{b + 1}"] = within * math.cos(angle) - out * math.sin(angle)
    if turbine.floater is not None:
        read |= dict(zip(PLATFORM_CHANNELS, swap[1000:1018], strict=True))
    read |= {f"lidar_{k + 1}": swap[2004 + k] for k in range(round(swap[2002]))}
    return {name: float(value) for name, value in read.items()}


def random_readings(turbine, count, seed, dt, n_gates=0):
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
        "yaw": (-3.0, 3.0, 0.002),
    }  # fmt: skip
    names |= {f"pitch_{b + 1}": (-0.05, 0.5, 0.01) for b in range(n)}
    names |= {f"root_{kind}_moment_{b + 1}": (-moment, moment, 0.03) for kind in ("flap", "edge") for b in range(n)}
    names |= {f"lidar_{k + 1}": (3.0, 25.0, 0.02) for k in range(n_gates)}
    if turbine.floater is not None:
        names |= dict.fromkeys(PLATFORM_CHANNELS, (-0.1, 0.1, 0.02))
    walks = {name: walk(*row) for name, row in names.items()}
    azimuth = rng.uniform(0.0, 2.0 * math.pi)
    for k in range(count):
        now = {name: next(walk) for name, walk in walks.items()}
        azimuth = (azimuth + now["rotor_speed"] * dt) % (2.0 * math.pi)
        torque = now.pop("torque_part") * drive.max_generator_torque
        generator_speed = now["rotor_speed"] * drive.gear_ratio
        yield now | {
            "time": k * dt, "wind_y": 0.0, "azimuth": azimuth, "generator_speed": generator_speed,
            "generator_torque": torque, "generator_power": torque * generator_speed, "shaft_torque": 0.0,
            "rotor_thrust": 0.0, "nacelle_acceleration_fore_aft": now.pop("fore_aft"),
            "nacelle_acceleration_side_side": now.pop("side_side"),
        }  # fmt: skip


def numbers_read(source, texts, folder, locale=None, environment=None):
    """Numbers that the parameter file of a source would have of texts, and how many characters each took."""
    words = [compiled(source, "read_numbers.c", folder), *([locale] if locale else [])]
    text = "".join(f"{line}\n" for line in texts)
    done = subprocess.run(words, input=text, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    return [(struct.unpack(">d", bytes.fromhex(bits))[0], int(count)) for bits, count in rows]


def sanitized(source, parameters, folder):
    """Run a source with random and missing readings under the sanitizers of addresses and undefined behavior."""
    program = compiled(source, "random_readings.c", folder, "address,undefined,float-cast-overflow")
    done = subprocess.run([program, str(parameters), str(folder / "out")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
