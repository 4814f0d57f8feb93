"""Tasks: environments as people train on them, each with its wind, its action and its score.

Importing this module loads nothing heavy; `wt_gym` registers the tasks under ``wt_gym/<name>-v<version>``. Any argument
of `wt_gym.envs.turbine_env.WindTurbineEnv` can be given to ``gymnasium.make`` on top.
"""

import math
from dataclasses import dataclass
from typing import Any

from wt_gym.turbine_records import RECORDS

__all__ = ["DEFAULT_ENV", "TASKS", "Task", "task_of"]


@dataclass(frozen=True)
class Task:
    """One task.

    Attributes
    ----------
    name : str
    version : int
        ``wt_gym/<name>-v<version>`` is the id (``docs/versions.md``).
    goal : str
        What is to be done, in one sentence.
    score : str
        What counts, as metrics of `wt_gym.analysis.metrics`, against the base controller in the same winds.
    episode : float
        Length of an episode [s]; ``max_episode_steps`` of the id.
    arguments : dict
        Arguments of the environment.
    """

    name: str
    version: int
    goal: str
    score: str
    episode: float
    arguments: dict[str, Any]

    @property
    def id(self) -> str:
        """Id of the environment."""
        return f"wt_gym/{self.name}-v{self.version}"

    @property
    def max_episode_steps(self) -> int:
        """Control steps of an episode."""
        return round(self.episode / float(self.arguments["control_dt"]))


# What a turbine measures, at the step of the simulator. Two simulators agree on what changes of loads, not on their
# means, so these are washed out, as is the mean of the blades' offsets, which the integrator of the controller takes
# back above rated wind. The reward is relative to the controller alone, whose own is recorded once a start: there are
# as many as make four or five hours of wind.
_RESIDUAL = {
    "turbine": "nrel_5mw",
    "inflow": "turbulent",
    "action_mode": "residual",
    "episode_length": None,
    "observation": ("measurable",),
    "sensor_washout": 20.0,
    "control_dt": 0.1,
    "relative_reward": True,
    "starts": 256,
}
# An early end costs more than the worst operation for as long as the discount of the training looks ahead.
_FIXED_FRAME = {**_RESIDUAL, "pitch": "fixed-frame", "residual_washout": 15.0, "termination_penalty": 200.0}
# Loads are to be spared at no cost in power. An agent adds offsets to a controller that damps the tower to the side by
# torque, which no pitch does as well. It sees what disturbs the loads, which no action changes, and what its offsets
# have done: from disturbances alone a law needs a long memory, from loads alone its loop may become unstable. Offsets
# reach what linear optimal pitch does, and fade out below rated wind, where they would cost power. Weights price loads
# as the lifetime cost does, with rewards of order one, and each action is paid its own effects (`wt_gym.envs.credit`).
_OFFSETS: dict[str, Any] = {
    **_FIXED_FRAME,
    "residual_form": "offset",
    "residual_fade": True,
    "residual_washout": None,
    "action_components": ("pitch",),
    "action_spans": {
        "pitch_mean": math.radians(2.0), "pitch": math.radians(4.0), "pitch_rate": math.radians(5.0),
    },
    "controller": "discon+side_side_damper+observer",
    "observation": ("disturbances", "own_response", "offsets"),
    "sensor_washout": None,
    "control_dt": 0.2,
    "reward": {
        "power": 5.0, "blade_fatigue": 7.5, "tower_fore_aft_fatigue": 10.0, "tower_side_side_fatigue": 2.0,
        "actuator_use": 3.0, "overspeed": 2.0,
    },
    "reward_credit": True,
    "termination_penalty": 1000.0,
}  # fmt: skip
_LOAD_REDUCTION = {**_OFFSETS, "wind_speed": (12.0, 20.0)}


def _spans(degrees: float) -> dict[str, float]:
    """Spans of a turbine whose pitch drives are slow: as far and as fast as they follow at rated speed."""
    return {"pitch": math.radians(degrees), "pitch_rate": math.radians(1.0)}


# A year of operation passes in ten minutes: the wind is averaged over a minute in place of ten. Energy comes first,
# since a turbine that stands has no fatigue; loads count as changes and, beyond the reference moments, as extremes.
_FULL_OPERATION = {
    **_RESIDUAL,
    "inflow": "path",
    "wind_speed": (0.0, 32.0),
    "pitch": "fixed-frame",
    "action_spans": {"pitch_mean": math.radians(0.5)},
    "action_components": ("pitch", "torque", "set_point"),
    "controller": "discon+supervisor:averaging=60",
    "observation": ("measurable", "supervisor"),
    "standstill_limit": -0.5,
    "reward": {
        "blade_fatigue": 0.5,
        "tower_fore_aft_fatigue": 0.3,
        "tower_side_side_fatigue": 0.1,
        "extreme_loads": 1.0,
        "actuator_use": 0.02,
        "overspeed": 1.0,
    },
    "termination_penalty": 600.0,
}

_MODERATE = {"blade_fatigue": 0.3, "tower_fore_aft_fatigue": 0.2, "tower_side_side_fatigue": 0.05}


def _chain_strength(diameter: float) -> float:
    """Breaking load of a studless chain of grade R3 [N], of nominal diameter [mm] (IACS, Unified Requirement W22)."""
    return 22.3 * diameter**2 * (44.0 - 0.08 * diameter)


# A floating platform swings for minutes: an episode lasts ten of its periods, and the discount of the training looks
# 60 s ahead at this step. Mean offsets are washed out slower than the platform swings. Weights price loads as those of
# LoadReduction do; torque, which damps roll, and pitch cost travel. Misaligned waves make roll and side-side loads.
_FLOATING: dict[str, Any] = {
    **_RESIDUAL,
    "pitch": "fixed-frame",
    "residual_form": "offset",
    "residual_fade": True,
    "residual_washout": 60.0,
    "action_components": ("pitch", "torque"),
    "action_spans": {"pitch_mean": math.radians(3.0), **_spans(2.0)},
    "wind_speed": (12.0, 20.0),
    "turbulence_class": "B",
    "sea": {"misalignment": math.radians(30.0)},
    "observation": ("measurable", "platform", "offsets"),
    "sensor_washout": None,
    "control_dt": 0.3,
    "starts": 64,
    "reward": {
        "power": 5.0, "blade_fatigue": 5.0, "tower_fore_aft_fatigue": 10.0, "tower_side_side_fatigue": 2.0,
        "platform_motion": 5.0, "actuator_use": 3.0, "overspeed": 0.0, "high_speed": 5.0,
    },
    "termination_penalty": 3000.0,
}  # fmt: skip

TASKS = {
    task.name: task
    for task in (
        Task(
            "LoadReduction",
            3,
            "Less blade fatigue above rated wind, without more tower fatigue, by pitch on top of the controller.",
            "flap DEL at no less than 99.5 % of the energy; pitch travel beside it",
            60.0,
            _LOAD_REDUCTION,
        ),
        Task(
            "FullRange",
            3,
            "The same over the whole range of winds, with torque too.",
            "flap and tower DEL weighted over the winds, energy, pitch travel",
            60.0,
            {
                **_OFFSETS,
                "action_components": ("pitch", "torque"),
                "wind_speed": (5.0, 22.0),
                "observation": ("rotor", "power", "disturbances", "own_response", "offsets"),
            },
        ),
        Task(
            "MaxPower",
            2,
            "Make the most of winds below rated by collective pitch and torque.",
            "energy, corrected for the rotor's kinetic energy, at no higher DELs",
            60.0,
            {
                **_RESIDUAL,
                "action_components": ("pitch", "torque"),
                "wind_speed": (5.0, 10.0),
                "observation": ("measurable", "wind_estimate"),
                "reward": _MODERATE,
                "termination_penalty": 150.0,
            },
        ),
        Task(
            "Yaw",
            3,
            "Keep the rotor in a wind whose direction wanders, by a noisy vane, on top of the dead-band controller.",
            "energy against yaw travel",
            300.0,
            {
                **_RESIDUAL,
                "action_components": ("yaw",),
                "controller": "discon+yaw",
                "wind_speed": (6.0, 14.0),
                "wind_direction": (-0.35, 0.35),
                "wind_wander": (0.15, 120.0),
                "sensor_noise": 1.0,
                "sensors": "all",
                "observation": ("measurable", "dead_band"),
                "starts": 64,
                "reward": {**_MODERATE, "actuator_use": 0.02},
                "termination_penalty": 800.0,
            },
        ),
        Task(
            "Gusts",
            3,
            "Survive the gusts of IEC 61400-1 (gust, change of direction, both, shear, extreme turbulence) "
            "with the least loads.",
            "share of survived episodes, largest flap and tower moments, largest rotor speed",
            40.0,
            {
                **_FIXED_FRAME,
                "inflow": "gusts",
                "action_components": ("pitch", "torque"),
                "wind_speed": (6.0, 22.0),
                "gusts": ("EOG", "EDC", "ECD", "EWS", "ETM"),
            },
        ),
        Task(
            "IEA15MW-LoadReduction",
            4,
            "Load reduction on a turbine of three times the power: does a method carry over?",
            "as LoadReduction",
            60.0,
            {
                **_LOAD_REDUCTION,
                **RECORDS["iea_15mw"].arguments,
                "turbine": "iea_15mw",
                "wind_speed": (11.0, 20.0),
                "action_spans": _spans(1.6),
            },
        ),
        Task(
            "IEA22MW-LoadReduction",
            3,
            "Load reduction on a turbine of 22 MW, whose own controller cuts the peak of the thrust.",
            "as LoadReduction",
            60.0,
            {
                **_LOAD_REDUCTION,
                **RECORDS["iea_22mw"].arguments,
                "turbine": "iea_22mw",
                "action_spans": _spans(1.7),
                # its drives move heavy blades slowly: at a higher price their use hides what offsets do to the loads
                "reward": {**_OFFSETS["reward"], "actuator_use": 1.2},
            },
        ),
        Task(
            "OC4-FloatingLoadReduction",
            1,
            "Less fatigue of tower and blades and less motion of a floating platform, in wind and waves, by pitch and "
            "torque on top of a controller with detuned gains.",
            "lifetime cost and standard deviation of the platform's pitch, at no less than 99.5 % of the energy",
            300.0,
            {**_FLOATING, "turbine": "oc4_nrel_5mw", "line_tension_limit": _chain_strength(76.6)},
        ),
        Task(
            "VolturnUS-FloatingLoadReduction",
            1,
            "The same on a platform with a turbine of three times the power.",
            "as OC4-FloatingLoadReduction",
            300.0,
            {
                **_FLOATING,
                **RECORDS["volturnus_iea_15mw"].arguments,
                "turbine": "volturnus_iea_15mw",
                "line_tension_limit": _chain_strength(185.0),
            },
        ),
        Task(
            "FullOperation",
            0,
            "From standstill to storm: most energy for the least extreme and lifetime loads, by pitch, torque and the "
            "set point of a supervisor that starts, holds back and stops the turbine.",
            "energy; flap and tower DEL, largest flap and tower moments",
            600.0,
            _FULL_OPERATION,
        ),
        Task(
            "PowerTracking",
            1,
            "Make the power that a grid operator asks for, neither less nor more, with the least loads.",
            "tracking error of the power and flap DEL; tower DELs and pitch travel beside them",
            60.0,
            {
                **_OFFSETS,
                "action_components": ("pitch", "torque"),
                "action_spans": {**_OFFSETS["action_spans"], "torque": 800.0},
                "controller": "discon+derate_kinetic+side_side_damper+observer",
                "power_reference": ("reserve", "steps", "ramps", "regulation"),
                "wind_speed": (12.0, 18.0),
                "observation": ("rotor", "power", "disturbances", "own_response", "offsets", "power_reference"),
                "reward": {**_OFFSETS["reward"], "power": 0.0, "power_tracking": 2.5, "overspeed": 0.0},
                # errors and an emptied rotor cost up to 230 a second, and the discount looks 10 s ahead
                "termination_penalty": 5000.0,
            },
        ),
        Task(
            "Dial",
            1,
            "Load reduction whose weights of fatigue, power and travel change within an episode and are observed: one "
            "policy for every compromise.",
            "hypervolume of fatigue, power and pitch travel against policies for single weights; monotone in each",
            60.0,
            {
                **_LOAD_REDUCTION,
                "observation": (*_OFFSETS["observation"], "dial"),
                "reward_credit": False,  # the dial turns before the effects come
                "dial_weights": "log_uniform",
                # with all of the dial on fatigue the worst second costs 61, and the discount looks 10 s ahead
                "termination_penalty": 1250.0,
            },
        ),
        Task(
            "Faults",
            1,
            "Less blade fatigue while drives, sensors and blades fail: detect what is broken, keep what can be kept, "
            "and fall back.",
            "flap DEL, energy and early ends in each fault; share of the gain that is kept in it",
            60.0,
            {
                **_LOAD_REDUCTION,
                "controller": "discon+side_side_damper+observer+yaw",
                "fault_kinds": "all",
                # a turbine that is stopped stands, and makes no power
                "standstill_limit": -0.5,
            },
        ),
    )
}
"""Tasks by name."""


LINEAR = ("LoadReduction", "IEA15MW-LoadReduction", "IEA22MW-LoadReduction")
"""Tasks with a linear model to learn on, ``wt_gym/<name>-Linear-v0`` (`wt_gym.learning.linear_env`)."""


def task_of(env_id: str) -> Task | None:
    """Task with an id; None where there is none."""
    return next((task for task in TASKS.values() if task.id == env_id), None)


DEFAULT_ENV = TASKS["LoadReduction"].id
"""Environment of commands that are not told another one."""
