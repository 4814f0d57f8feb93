"""A stand-in for the simulator whose signals are set by the test: for the logic of the environment, not for physics."""

import copy

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.envs.episode_start import RunningStart
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.simulation import Signals, channel_table
from wt_gym.simulation.fidelity import fidelity as named_fidelity


def scripted_signals(values: dict[str, float], n_blades: int = 3) -> Signals:
    """Signals with these values, zero where nothing is said."""
    return Signals(np.array([values.get(c.name, 0.0) for c in channel_table(n_blades)]), n_blades)


def use(monkeypatch, simulator: type) -> None:
    """Let environments have this simulator, and begin at operating points: the running turbine is a real one.

    The canary of the package is not measured, whose numbers would be those of this simulator in the user's cache.
    """
    monkeypatch.setattr(WindTurbineEnv, "make_simulator", staticmethod(simulator))
    monkeypatch.setattr(RunningStart, "draw", lambda *_: None)
    monkeypatch.setattr("wt_gym.envs.canary.cached_canary", lambda *_: {"residual/reward": "1 2 4"})
    monkeypatch.setattr("wt_gym.experiment.run.cached_canary", lambda *_: {})


class ScriptedSimulator:
    """Holds the demands it gets as if the actuators were ideal; everything else is constant or scripted.

    ``script`` maps a time [s] to signals that change then; ``break_at`` is the time at which `advance` fails.
    """

    script: dict[float, dict[str, float]] = {}  # noqa: RUF012 - replaced by tests
    break_at: float | None = None
    faults: tuple = ()
    time_step = 0.1

    def __init__(self, turbine, inflow, fidelity="training"):
        self.turbine, self.inflow, self.fidelity = turbine, inflow, named_fidelity(fidelity)
        self.time = 0.0

    def loads(self) -> dict[str, float]:
        """Signals that change with the time and the demands."""
        return {}

    def geometry(self) -> dict[str, np.ndarray]:
        """Shapes of the least size."""
        wake = np.zeros((2, self.turbine.n_blades, 2, 3))
        return {
            "blades": np.zeros((self.turbine.n_blades, 2, 2, 3)), "wake": wake, "wake_circulation": wake[:1, :, :1, 0],
            "tower": np.zeros((2, 3)), "tower_radius": np.ones(2), "hub": np.zeros(3), "nacelle": np.zeros((2, 3)),
        }  # fmt: skip

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
        self._values |= self.loads() | scripted
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


class Swinging(ScriptedSimulator):
    """With loads that swing and follow the pitch, so that every term pays and agents differ."""

    def loads(self):
        """Loads that swing by the time, less where the blades are pitched."""
        swing = np.sin(2.1 * self.time)
        loads = {"tower_base_fore_aft_moment": 4e7 + 1e7 * swing, "nacelle_acceleration_fore_aft": 0.1 + 0.3 * swing}
        for b in range(1, self.turbine.n_blades + 1):
            moment = 8e6 + 3e6 * np.sin(2.1 * self.time + b)
            loads[f"root_flap_moment_{b}"] = moment * (1.0 - self._values[f"pitch_{b}"])
        return loads
