"""Controllers with stable-baselines3's ``predict()``: baseline and trained policies; training and evaluation."""

import sys
import warnings
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType

_MOVED = {
    "choices": "wt_gym.agents.names",
    "closed_loop": "wt_gym.runs.playing",
    "contenders": "wt_gym.agents.pool",
    "entries": "wt_gym.agents.benchmark_runs",
    "environments": "wt_gym.agents.pool",
    "executors": "wt_gym.runs.executors",
    "folder_lock": "wt_gym.runs.folder_lock",
    "progress": "wt_gym.runs.progress",
    "sweep_record": "wt_gym.runs.store",
    "workers": "wt_gym.runs.executors",
}
"""Modules of version 0.1 and where their contents are; they go with the next minor version."""


class _Moved:
    """Finds a module of before: whatever is asked of it comes from the present one."""

    def find_spec(self, name, path=None, target=None):
        """Spec of a module that has moved, None for any other."""
        package, _, last = name.rpartition(".")
        return ModuleSpec(name, self) if package == __name__ and last in _MOVED else None

    def create_module(self, spec):
        """Make it as always."""

    def exec_module(self, module: ModuleType) -> None:
        """Fill it."""
        present = _MOVED[module.__name__.rpartition(".")[2]]
        warnings.warn(f"{module.__name__} is now {present}", DeprecationWarning, stacklevel=2)
        module.__getattr__ = import_module(present).__getattribute__  # type: ignore[method-assign]


sys.meta_path.insert(0, _Moved())
