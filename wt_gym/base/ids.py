"""Environment ids of records: what an id of an earlier version stands for now."""

import gymnasium as gym

__all__ = ["name_of", "present_id"]


def name_of(env_id: str) -> str:
    """Name in an id, without namespace and version: that of a task in `wt_gym.tasks.TASKS` if it is one."""
    return env_id.removeprefix("wt_gym/").rpartition("-v")[0]


def present_id(env_id: str) -> str:
    """Id under which an environment of a record can be made.

    Parameters
    ----------
    env_id : str
        For example ``"wt_gym/LoadReduction-v1"`` in the record of a training.

    Returns
    -------
    str
        The id itself while it is registered, else the next one of its name; where there is none, the id as given.
    """
    name, mark, number = env_id.rpartition("-v")
    if env_id in gym.registry or not mark or not number.isdigit():
        return env_id
    newer = [
        int(known.rpartition("-v")[2])
        for known in gym.registry
        if known.rpartition("-v")[0] == name and int(known.rpartition("-v")[2]) > int(number)
    ]
    return f"{name}-v{min(newer)}" if newer else env_id
