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

from wt_gym.tasks import LINEAR, TASKS
from wt_gym.turbine_records import RECORDS

__all__ = ["__version__"]
__version__ = "0.1.0"


def _register(
    env_id: str, arguments: dict[str, Any], single: str = "wt_gym.envs.turbine_env:WindTurbineEnv",
    vector: str = "wt_gym.envs.vector_env:WindTurbineVectorEnv", **limits: Any,
) -> None:  # fmt: skip
    """Register an id; ``arguments`` go to the environment, which learns of the id what of them a user may replace."""
    register(
        id=env_id,
        entry_point=single,
        vector_entry_point=vector,
        kwargs={**arguments, "env_id": env_id},
        disable_env_checker=True,  # `gymnasium.make` decides by the id alone, and it warns of a vector reward
        **limits,
    )


for _record in RECORDS.values():
    for _id, _arguments in _record.ids:
        _register(_id, _arguments)

for _task in TASKS.values():
    _register(_task.id, _task.arguments, max_episode_steps=_task.max_episode_steps)

for _task in (TASKS[name] for name in LINEAR):
    _register(
        f"wt_gym/{_task.name}-Linear-v0", {"modeled": _task.id}, "wt_gym.learning.linear_env:LinearTurbineEnv",
        "wt_gym.learning.linear_env:LinearVectorEnv", max_episode_steps=_task.max_episode_steps,
    )  # fmt: skip
