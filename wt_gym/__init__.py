"""A Gymnasium environment for learning to control a wind turbine on a full aeroelastic simulator.

Importing this package registers the environments and loads nothing heavy; the simulator is imported when the first
environment is made.

===================================  ==============================================================
id                                   turbine and wind
===================================  ==============================================================
``wt_gym/NREL5MW-Steady-v1``         NREL 5-MW, steady sheared wind
``wt_gym/NREL5MW-Turbulent-v1``      NREL 5-MW, IEC Kaimal turbulence
``wt_gym/IEA15MW-Steady-v2``         IEA 15-MW (240 m rotor), steady sheared wind
``wt_gym/IEA15MW-Turbulent-v2``      IEA 15-MW, IEC Kaimal turbulence
``wt_gym/IEA22MW-Steady-v0``         IEA 22-MW (284 m rotor), steady sheared wind
``wt_gym/IEA22MW-Turbulent-v0``      IEA 22-MW, IEC Kaimal turbulence
``wt_gym/Gebhardt45m-Steady-v1``     45-m blades, 68-m tower (Gebhardt et al. 2012), steady sheared wind
``wt_gym/Gebhardt45m-Turbulent-v1``  the same, IEC Kaimal turbulence
``wt_gym/NadaSmall-Steady-v1``       0.5-m rotor on a copper rod (Nada & Al-Shahrani 2019), steady sheared wind
``wt_gym/NadaSmall-Turbulent-v1``    the same, IEC Kaimal turbulence
===================================  =======================================================

Examples
--------
>>> import gymnasium as gym, wt_gym
>>> env = gym.make("wt_gym/NREL5MW-Turbulent-v1", wind_speed=12.0)
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
_VERSIONS: dict[str, tuple[int, tuple[dict, ...]]] = {
    "nrel_5mw": (1, ({},)),
    "iea_15mw": (2, (TWISTING,)),
    "gebhardt_45m": (1, ({},)),
    "nada_small": (1, ({},)),
}
"""Of a turbine's plain ids: number of the oldest version, and what each from there on adds. Tasks tell their own."""


def _register(name, first, versions, arguments, **limits):
    """Register an id in all its versions; ``arguments`` go to the environment."""
    for version, more in enumerate(versions, first):
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
        _register(f"{_label}-{_inflow_label}", *_VERSIONS.get(_turbine, (0, ({},))), _arguments)

for _task in TASKS.values():
    _register(
        _task.name, _task.first_version, _task.versions, _task.arguments, max_episode_steps=_task.max_episode_steps
    )
