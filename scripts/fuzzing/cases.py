"""What a fuzzed episode is made of, drawn from its number alone: the same number gives the same case for ever."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wt_gym.control.actions import ACTION_MODES
from wt_gym.envs.channels import OBSERVATION_GROUPS
from wt_gym.envs.faults import FAULT_KINDS
from wt_gym.envs.wind_sampler import GUSTS
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.wind import SteadyInflow

POLICY_NAMES = ("random", "constant", "corner", "component", "bang-bang", "walk", "mixed", "controller")
"""See `fuzzing.policies`."""

_SEEDS = (1, 2)  # of turbulence: few boxes to make, which differ enough
_STEPS_OF_AN_EPISODE = 300
_CONTROLLERS = (
    "discon",
    "retuned",
    "tsr_tracking",
    "discon+yaw",
    "tower_dampers",
    "ipc",
    "tsr_tracking+ipc_2p",
    "constrained_ipc+yaw",
    "lidar+ipc",
)
_THREE_BLADES = 3
_WITH_TABLES = ("nrel_5mw", "iea_15mw", "gebhardt_45m")
"""Turbines whose wind estimator has a measured table."""


@dataclass(frozen=True)
class FuzzCase:
    """One environment, its policy and its starts."""

    number: int  #: from which all else is drawn
    turbine: str
    wind: str  #: of `WINDS`
    policy: str  #: of `POLICY_NAMES`
    arguments: dict[str, Any]  #: of `wt_gym.envs.turbine_env.WindTurbineEnv`
    odd_starts: bool  #: some episodes start away from an operating point

    def __str__(self) -> str:
        mode, pitch = self.arguments["action_mode"], self.arguments["pitch"]
        return f"case {self.number}: {self.turbine}, {self.wind}, {mode} {pitch}, {self.policy}"


_FAULTS = tuple(kind for kind in FAULT_KINDS if kind != "iced_blade")
"""What may break; a blade with ice is another model, which would be kept."""


def _operating(turbine: Turbine, **more: Any) -> dict[str, Any]:
    return {"inflow": "steady", "wind_speed": (turbine.cut_in, turbine.cut_out), **more}


def _turbulent(turbine: Turbine, **more: Any) -> dict[str, Any]:
    return _operating(turbine) | {"inflow": "turbulent", "wind_seeds": _SEEDS, **more}


def _own(turbine: Turbine, speed: float, **more: float) -> dict[str, Any]:
    return {"inflow": SteadyInflow(float(speed), turbine.hub_height, **more), "wind_speed": None}


def _veer(turbine: Turbine, rng: np.random.Generator) -> dict[str, Any]:
    """Shear, veer of up to 30 degrees over the rotor and upflow."""
    veer = rng.uniform(-0.5, 0.5) / turbine.rotor_diameter
    profile = {"shear_exponent": rng.uniform(0.0, 1.0), "veer": float(np.clip(veer, -0.05, 0.05))}
    return _own(turbine, rng.uniform(turbine.cut_in, turbine.cut_out), **profile, inclination=rng.uniform(-0.5, 0.5))


WINDS: dict[str, Callable[[Turbine, np.random.Generator], dict[str, Any]]] = {
    "steady": lambda t, rng: _operating(t, shear_exponent=float(rng.choice([0.0, 0.2, 0.5]))),
    "turbulent": lambda t, rng: _turbulent(t),
    "extreme turbulence": lambda t, rng: _turbulent(t, turbulence_model="ETM"),
    "gusts": lambda t, rng: _turbulent(t, inflow="gusts", gusts=GUSTS),
    "from behind": lambda t, rng: _operating(t, wind_direction=(0.75 * math.pi, math.pi)),
    "from the side": lambda t, rng: _turbulent(t, wind_direction=(-0.6 * math.pi, 0.6 * math.pi)),
    "wandering": lambda t, rng: _turbulent(t, wind_wander=(0.5, 10.0)),
    "veer and upflow": _veer,
    "calm": lambda t, rng: _own(t, rng.choice([1e-3, 0.1, 1.0])),
    "beyond cut-out": lambda t, rng: _own(t, rng.uniform(t.cut_out, 2.0 * t.cut_out), shear_exponent=0.1),
    "storm": lambda t, rng: {"inflow": "extreme", "wind_speed": None, "standstill_limit": -1.0},
    "turbulent storm": lambda t, rng: {
        "inflow": "extreme-turbulent", "wind_speed": None, "standstill_limit": -1.0, "wind_seeds": _SEEDS,
    },
}  # fmt: skip
"""Winds by name: from turbine and random numbers to arguments of the environment."""


def draw_case(number: int, turbines: Sequence[str], fidelity: str = "training") -> FuzzCase:
    """Draw a case; another choice of turbines gives other cases."""
    rng = np.random.default_rng([number, 7])
    name = str(rng.choice(list(turbines)))
    wind, policy = str(rng.choice(list(WINDS))), str(rng.choice(POLICY_NAMES))
    turbine = load_turbine(name)
    step = fidelity_of(fidelity).step_for(turbine.drivetrain.rated_rotor_speed)
    control_dt = step * int(rng.choice([1, 2, 2, 4]))
    arguments = {
        "turbine": name,
        "fidelity": fidelity,
        "control_dt": control_dt,
        "episode_length": _STEPS_OF_AN_EPISODE * control_dt,
        "sensor_noise": float(rng.choice([0.0, 1.0, 10.0])),
        "sensor_delay": control_dt * int(rng.choice([0, 0, 3])),
        "history": int(rng.choice([1, 1, 3])),
        "overspeed_limit": float(rng.choice([1.25, 1.25, 1.6])),
        "standstill_limit": (None, 0.0, -1.0)[rng.integers(3)],
        "reward": {name: float(rng.choice([0.0, 1.0])) for name in ("tip_deflection", "tower_load", "damage")},
        **_drawn_action(turbine, name in _WITH_TABLES, policy, rng),
        **WINDS[wind](turbine, rng),
    }
    odd_starts = bool(rng.random() < 0.3)
    if rng.random() < 0.25:
        arguments |= {"fault_kinds": _FAULTS, "fault_time": (0.0, 5.0)}
    return FuzzCase(number, name, wind, policy, arguments, odd_starts)


def _drawn_action(turbine: Turbine, has_table: bool, policy: str, rng: np.random.Generator) -> dict[str, Any]:
    """What the actions mean, what runs beneath them and what is seen."""
    turns = turbine.n_blades >= _THREE_BLADES
    mode = str(rng.choice(ACTION_MODES))
    pitch = str(rng.choice(["collective", "individual", *(["fixed-frame"] if turns else [])]))
    if mode == "residual" and turns and rng.random() < 0.3:
        pitch = "cyclic"
    wanted: list[str] | None = [name for name in ("pitch", "yaw", "torque") if rng.random() < 0.8]
    usable = [name for name in _CONTROLLERS if has_table or "tsr_tracking" not in name]
    beneath = str(rng.choice([name for name in usable if turns or "ipc" not in name]))
    more: dict[str, Any] = {"residual_fade": bool(rng.random() < 0.5)}
    more["residual_washout"] = 10.0 if rng.random() < 0.3 else None
    absent = (
        {"disturbances", "own_response", "model_fit", "supervisor", "power_reference", "power_forecast", "dial"}
        | ({"dead_band"} if "yaw" not in beneath else set())
        | (set() if has_table else {"wind_estimate"})
        | (set() if turbine.floater is not None else {"platform", "platform_position", "wave"})
    )
    groups = [name for name in OBSERVATION_GROUPS if name not in absent]
    if policy == "controller":  # which acts itself, on all that there is
        mode, pitch, wanted = ("rate", "absolute")[rng.integers(2)], "individual" if turns else "collective", None
    drives = {"pitch": True, "yaw": turbine.nacelle.max_yaw_rate > 0.0, "torque": turbine.drivetrain.takes_torque}
    components = tuple(name for name in wanted or () if drives[name]) or None
    if mode == "residual" or (components is not None and not {"pitch", "torque"} <= set(components)):
        more["controller"] = beneath
    else:
        groups.remove("controller")
        groups = [name for name in groups if name != "dead_band"]
    if mode != "residual" or components == ("yaw",):  # of which there are no offsets
        groups.remove("offsets")
    if not turns:
        groups.remove("fixed_frame")
    return {"action_mode": mode, "pitch": pitch, "action_components": components, "observation": tuple(groups), **more}
