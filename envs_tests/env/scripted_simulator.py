"""A stand-in for the simulator whose signals are set by the test: for the logic of the environment, not for physics."""

from __future__ import annotations

import copy

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.envs.episode_start import RunningStart
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import channel_table


def scripted_signals(values: dict[str, float], n_blades: int = 3) -> Signals:
    """Signals with these values, zero where nothing is said."""
    return Signals(np.array([values.get(c.name, 0.0) for c in channel_table(n_blades)]), n_blades)


def use(monkeypatch, simulator: type) -> None:
    """Let environments have this simulator, and begin at operating points: the running turbine is a real one."""
    monkeypatch.setattr(WindTurbineEnv, "make_simulator", staticmethod(simulator))
    monkeypatch.setattr(RunningStart, "draw", lambda *_: None)


class ScriptedSimulator:
    """Holds the demands it gets as if the actuators were ideal; everything else is constant or scripted.

    ``script`` maps a time [s] to signals that change then; ``break_at`` is the time at which `advance` fails.
    """

    script: dict[float, dict[str, float]] = {}  # noqa: RUF012 - replaced by tests
    break_at: float | None = None
    faults: tuple = ()

    def __init__(self, turbine, inflow, fidelity="training"):
        self.turbine, self.inflow, self.fidelity = turbine, inflow, fidelity
        self.time = 0.0

    def state(self):
        """All that changes in an episode."""
        return copy.deepcopy({name: value for name, value in vars(self).items() if name not in ("turbine", "inflow")})

    def restore(self, state):
        """Continue from a state."""
        vars(self).update(copy.deepcopy(state))

    def reset(self, rotor_speed, pitch, azimuth=0.0, yaw=0.0, generator_torque=0.0, **of_running_turbine):
        """Start at the given state."""
        pitch = np.broadcast_to(pitch, self.turbine.n_blades).tolist()
        self.time = 0.0
        self._values = {
            "time": 0.0, "azimuth": azimuth, "yaw": yaw, "yaw_rate": 0.0, "yaw_error": 0.0,
            "wind_x": self.inflow.mean_speed, "wind_y": 0.0, "wind_z": 0.0,
            "generator_torque": generator_torque,
            "tower_base_fore_aft_moment": 4e7, "tower_base_side_side_moment": 1e6,
            "tower_top_fore_aft": 0.3, "tower_top_side_side": -0.03,
            "nacelle_acceleration_fore_aft": 0.1, "nacelle_acceleration_side_side": 0.0,
        }  # fmt: skip
        for blade in range(1, self.turbine.n_blades + 1):
            self._values |= {
                f"pitch_{blade}": pitch[blade - 1], f"pitch_rate_{blade}": 0.0, f"pitch_travel_{blade}": 0.0,
                f"tip_out_of_plane_{blade}": 3.0,
                f"tip_in_plane_{blade}": -0.3, f"root_flap_moment_{blade}": 8e6, f"root_edge_moment_{blade}": 1e6,
                f"tip_clearance_{blade}": 12.0, f"tip_clearance_min_{blade}": 11.0,
            }  # fmt: skip
        self._set_speed(rotor_speed)
        self._seen = dict(self._values)
        return scripted_signals(self._values, self.turbine.n_blades)

    def advance(self, duration, pitch, yaw_rate, generator_torque, accumulate=False):
        """Take over the demands and the scripted values; extremes and ways go on where that is asked for."""
        self.time = round(self.time + duration, 9)
        if self.break_at is not None and self.time >= self.break_at:
            raise SimulationError(f"scripted failure at {self.time} s")
        for blade, angle in enumerate(pitch, start=1):
            self._values[f"pitch_rate_{blade}"] = (angle - self._values[f"pitch_{blade}"]) / duration
            self._values[f"pitch_travel_{blade}"] = abs(angle - self._values[f"pitch_{blade}"])
            self._values[f"pitch_{blade}"] = float(angle)
        self._values |= {"time": self.time, "yaw_rate": yaw_rate, "generator_torque": generator_torque}
        scripted = self.script.get(self.time, {})
        self._values |= scripted
        self._set_speed(self._values["rotor_speed"])
        if "rotor_speed_max" in scripted:
            self._values["rotor_speed_max"] = scripted["rotor_speed_max"]
        self._seen = self._combined() if accumulate else dict(self._values)
        return scripted_signals(self._seen, self.turbine.n_blades)

    def _combined(self) -> dict[str, float]:
        """The present values, with extremes and ways since the interval began."""
        seen = dict(self._values)
        for name, before in self._seen.items():
            if "_max" in name:
                seen[name] = max(seen[name], before)
            elif "_min" in name:
                seen[name] = min(seen[name], before)
            elif "_travel" in name:
                seen[name] += before
        return seen

    def _set_speed(self, rotor_speed: float) -> None:
        drivetrain = self.turbine.drivetrain
        speed = rotor_speed * drivetrain.gear_ratio
        power = self._values["generator_torque"] * speed * drivetrain.generator_efficiency
        self._values |= {"rotor_speed": rotor_speed, "rotor_speed_max": rotor_speed}
        self._values |= {"generator_speed": speed, "generator_power": power}
