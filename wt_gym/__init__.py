"""A Gymnasium environment for learning to control a wind turbine on a full aeroelastic simulator.

Importing this package registers the environments and loads nothing heavy; the simulator is imported when the first
environment is made.

===================================  ==============================================================
id                                   turbine and wind
===================================  ==============================================================
``wt_gym/NREL5MW-Steady-v0``         NREL 5-MW, steady sheared wind
``wt_gym/NREL5MW-Turbulent-v0``      NREL 5-MW, IEC Kaimal turbulence
``wt_gym/IEA15MW-Steady-v0``         IEA 15-MW (240 m rotor), steady sheared wind
``wt_gym/IEA15MW-Turbulent-v0``      IEA 15-MW, IEC Kaimal turbulence
``wt_gym/Gebhardt45m-Steady-v0``     45-m blades, 68-m tower (Gebhardt et al. 2012), steady sheared wind
``wt_gym/Gebhardt45m-Turbulent-v0``  the same, IEC Kaimal turbulence
``wt_gym/NadaSmall-Steady-v0``       0.5-m rotor on a copper rod (Nada & Al-Shahrani 2019), steady sheared wind
``wt_gym/NadaSmall-Turbulent-v0``    the same, IEC Kaimal turbulence
===================================  ==============================================================

and the tasks of `wt_gym.tasks`: ``wt_gym/LoadReduction-v0``, ``wt_gym/FullRange-v0``, ``wt_gym/MaxPower-v0``,
``wt_gym/Yaw-v0``, ``wt_gym/Gusts-v0`` and ``wt_gym/IEA15MW-LoadReduction-v0``.

Examples
--------
>>> import gymnasium as gym, wt_gym
>>> env = gym.make("wt_gym/NREL5MW-Turbulent-v0", wind_speed=12.0)
"""

from gymnasium.envs.registration import register

from wt_gym.tasks import TASKS

__all__ = ["__version__"]
__version__ = "0.1.0"

_TURBINES = {"NREL5MW": "nrel_5mw", "IEA15MW": "iea_15mw", "Gebhardt45m": "gebhardt_45m", "NadaSmall": "nada_small"}
_OWN = {"nada_small": {"wind_speed": (6.0, 10.0), "control_dt": 0.02, "episode_length": 4.0}}
"""Arguments of turbines for which the defaults do not fit: four seconds are a hundred turns of the small rotor."""
_INFLOWS = {"Steady": "steady", "Turbulent": "turbulent"}

for _turbine_label, _turbine_name in _TURBINES.items():
    for _inflow_label, _inflow_kind in _INFLOWS.items():
        register(
            id=f"wt_gym/{_turbine_label}-{_inflow_label}-v0",
            entry_point="wt_gym.envs.turbine_env:WindTurbineEnv",
            vector_entry_point="wt_gym.envs.vector_env:WindTurbineVectorEnv",
            kwargs={"turbine": _turbine_name, "inflow": _inflow_kind, **_OWN.get(_turbine_name, {})},
        )

for _task in TASKS.values():
    register(
        id=f"wt_gym/{_task.name}-v0",
        entry_point="wt_gym.envs.turbine_env:WindTurbineEnv",
        vector_entry_point="wt_gym.envs.vector_env:WindTurbineVectorEnv",
        kwargs=_task.arguments,
        max_episode_steps=_task.max_episode_steps,
    )
