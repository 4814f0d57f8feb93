"""A Gymnasium environment for learning to control a wind turbine on a full aeroelastic simulator.

Importing this package registers the environments and loads nothing heavy; the simulator is imported when the first
environment is made.

===================================  ==============================================================
id                                   turbine and wind
===================================  ==============================================================
``wt_gym/NREL5MW-Steady-v0``         NREL 5-MW, steady sheared wind
``wt_gym/NREL5MW-Turbulent-v0``      NREL 5-MW, IEC Kaimal turbulence
``wt_gym/IEA15MW-Steady-v1``         IEA 15-MW (240 m rotor), steady sheared wind
``wt_gym/IEA15MW-Turbulent-v1``      IEA 15-MW, IEC Kaimal turbulence
``wt_gym/IEA22MW-Steady-v0``         IEA 22-MW (284 m rotor), steady sheared wind
``wt_gym/IEA22MW-Turbulent-v0``      IEA 22-MW, IEC Kaimal turbulence
``wt_gym/Gebhardt45m-Steady-v0``     45-m blades, 68-m tower (Gebhardt et al. 2012), steady sheared wind
``wt_gym/Gebhardt45m-Turbulent-v0``  the same, IEC Kaimal turbulence
``wt_gym/NadaSmall-Steady-v0``       0.5-m rotor on a copper rod (Nada & Al-Shahrani 2019), steady sheared wind
``wt_gym/NadaSmall-Turbulent-v0``    the same, IEC Kaimal turbulence
===================================  ==============================================================

and the tasks of `wt_gym.tasks`: ``wt_gym/LoadReduction-v0``, ``wt_gym/FullRange-v0``, ``wt_gym/MaxPower-v0``,
``wt_gym/Yaw-v1``, ``wt_gym/Gusts-v1``, ``wt_gym/IEA15MW-LoadReduction-v1`` and ``wt_gym/IEA22MW-LoadReduction-v0``. The
blades of the 15-MW turbine twist in the ids of version 1; those of version 0, which stay for a while, have blades that
only bend. The blades of the 22-MW turbine twist in all ids. Version 0 of the gusts has no extreme turbulence.

Examples
--------
>>> import gymnasium as gym, wt_gym
>>> env = gym.make("wt_gym/NREL5MW-Turbulent-v0", wind_speed=12.0)
"""

from typing import Any

from gymnasium.envs.registration import register

from wt_gym.tasks import TASKS, TWISTING

__all__ = ["__version__"]
__version__ = "0.1.0"

_TURBINES = {
    "NREL5MW": "nrel_5mw",
    "IEA15MW": "iea_15mw",
    "IEA22MW": "iea_22mw",
    "Gebhardt45m": "gebhardt_45m",
    "NadaSmall": "nada_small",
}
_OWN: dict[str, dict[str, Any]] = {
    "iea_22mw": TWISTING,
    "nada_small": {"wind_speed": (6.0, 10.0), "control_dt": 0.02, "episode_length": 4.0},
}
"""Arguments of turbines for which the defaults do not fit: blades of 138 m twist by two degrees, and four seconds are a
hundred turns of the small rotor."""
_INFLOWS = {"Steady": "steady", "Turbulent": "turbulent"}
_VERSIONS: dict[str, tuple[dict, ...]] = {"iea_15mw": ({}, TWISTING)}
"""What each version of a turbine's plain ids adds; turbines without an entry have version 0. Tasks tell their own."""


def _register(name, versions, arguments, **limits):
    """Register an id in all its versions; ``arguments`` go to the environment."""
    for version, more in enumerate(versions):
        register(
            id=f"wt_gym/{name}-v{version}",
            entry_point="wt_gym.envs.turbine_env:WindTurbineEnv",
            vector_entry_point="wt_gym.envs.vector_env:WindTurbineVectorEnv",
            kwargs={**arguments, **more},
            **limits,
        )


for _label, _turbine in _TURBINES.items():
    for _inflow_label, _inflow in _INFLOWS.items():
        _arguments = {"turbine": _turbine, "inflow": _inflow, **_OWN.get(_turbine, {})}
        _register(f"{_label}-{_inflow_label}", _VERSIONS.get(_turbine, ({},)), _arguments)

for _task in TASKS.values():
    _register(_task.name, _task.versions, _task.arguments, max_episode_steps=_task.max_episode_steps)
