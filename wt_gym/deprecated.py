"""Public names that have changed: the former ones stay for one minor version, with a `DeprecationWarning`.

Here stand those that `docs/versions.md` counts as public. ``scripts/rename.py``, which changes them in the sources of
others, reads these tables, so that this file needs Python alone.
"""

from __future__ import annotations

import functools
import importlib
import importlib.abc
import importlib.machinery
import sys
import types
import warnings
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

__all__ = [
    "GONE",
    "MODULES",
    "MOVED",
    "NAMES",
    "install",
    "renamed_arguments",
    "renamed_attribute",
    "renamed_keys",
    "renamed_names",
]

_F = TypeVar("_F")

NAMES: dict[str, dict[str, str]] = {
    "wt_gym.control": {"Aim": "AgentSetpoint"},
    "wt_gym.control.actions": {"Aim": "AgentSetpoint"},
    "wt_gym.control.controllers": {
        "RoscoLikeController": "TsrTrackingController",
        "RoscoLikeParameters": "TsrTrackingParameters",
    },
    "wt_gym.control.controllers.tsr_tracking": {
        "RoscoLikeController": "TsrTrackingController",
        "RoscoLikeParameters": "TsrTrackingParameters",
    },
    "wt_gym.experiment.pool": {"Contenders": "AgentPool"},
    "wt_gym.experiment.names": {"runs_beneath": "is_base_controller"},
    "wt_gym.experiment.comparison": {"BENEATH": "RESIDUAL_INTERFACE"},
    "wt_gym.experiment.evaluation_winds": {"met_wind": "actual_wind"},
    "wt_gym.experiment.trained_agent": {
        "BEST_NORMALISATION_FILE": "BEST_NORMALIZATION_FILE",
        "NORMALISATION_FILE": "NORMALIZATION_FILE",
        "read_normalisation": "read_normalization",
    },
    "wt_gym.experiment.task_scores": {"contender_label": "agent_label"},
    "wt_gym.learning.training.environments": {"normalised": "normalized"},
    "wt_gym.learning.training.resume": {"train_or_go_on": "resume_or_train"},
    "wt_gym.learning.training.selection": {"HeldBackEvaluation": "SelectionEvaluation"},
}
"""Former and present names by the module that has them."""

MODULES = {
    "wt_gym.control.controllers.rosco_like": "wt_gym.control.controllers.tsr_tracking",
    "wt_gym.agents.choices": "wt_gym.experiment.names",
    "wt_gym.agents.closed_loop": "wt_gym.runs.playing",
    "wt_gym.agents.contenders": "wt_gym.experiment.pool",
    "wt_gym.agents.entries": "wt_gym.experiment.benchmark_runs",
    "wt_gym.agents.distributed.connection": "wt_gym.runs.ray_cluster",
    "wt_gym.agents.distributed.ray_executor": "wt_gym.runs.ray_executor",
    "wt_gym.agents.environments": "wt_gym.experiment.pool",
    "wt_gym.agents.executors": "wt_gym.runs.executors",
    "wt_gym.agents.folder_lock": "wt_gym.runs.folder_lock",
    "wt_gym.agents.progress": "wt_gym.runs.progress",
    "wt_gym.agents.sweep_record": "wt_gym.runs.store",
    "wt_gym.agents.workers": "wt_gym.runs.executors",
    "wt_gym.agents.training.again": "wt_gym.learning.training.resume",
    "wt_gym.agents.training.held_back": "wt_gym.learning.training.selection",
}
"""Former and present modules."""

MOVED = {
    "wt_gym.agents.choices": {
        "expand_seeds": "wt_gym.experiment.former.expand_seeds",
        "kind_of": "wt_gym.experiment.former.kind_of",
    },
    "wt_gym.agents.entries": {
        "BASELINE": "wt_gym.experiment.names.BASELINE",
        "LEVELS": "wt_gym.experiment.names.LEVELS",
        "WORDS": "wt_gym.experiment.names.GROUPS",
    },
    "wt_gym.agents.sweep_record": {"sweep_recorded": "wt_gym.experiment.former.sweep_recorded"},
    "wt_gym.agents.workers": {
        "check_workers": "wt_gym.experiment.former.check_workers",
        "in_processes": "wt_gym.experiment.former.in_processes",
    },
}
"""Names of former modules that do not stand in the present one, and where they are."""

GONE = {
    "wt_gym.agents.fuzzing": "scripts/fuzzing, which scripts/fuzz.py runs",
    "wt_gym.agents.reward_study": "scripts/studies/reward_study.py",
}
"""Former modules that are no part of the package any more, with the place in a clone where their content is."""


def _warn(old: str, new: str, level: int = 3) -> None:
    warnings.warn(f"{old} is deprecated, use {new}", DeprecationWarning, stacklevel=level)


def renamed_names(module: str) -> Callable[[str], Any]:
    """Give the ``__getattr__`` of a module of `NAMES`.

    Parameters
    ----------
    module : str
        Its ``__name__``.
    """

    def __getattr__(name: str) -> Any:
        new = NAMES[module].get(name)
        if new is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        _warn(f"{module}.{name}", f"{module}.{new}")
        return getattr(sys.modules[module], new)

    return __getattr__


def renamed_arguments(**renamed: str) -> Callable[[_F], _F]:
    """Let a function, or what makes a class, take arguments by their former names.

    Parameters
    ----------
    **renamed : str
        Present name by former name.

    Raises
    ------
    TypeError
        When an argument is given by both names.
    """

    def decorate(target: Any) -> Any:
        function = vars(target)["__init__"] if isinstance(target, type) else target

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            for old in renamed.keys() & kwargs.keys():
                new = renamed[old]
                if new in kwargs:
                    raise TypeError(f"{target.__name__}() takes {new}; {old} is its former name: give one of them")
                _warn(f"the argument {old} of {target.__name__}()", new)
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        if isinstance(target, type):
            target.__init__ = call  # type: ignore[misc]
            return target
        return call

    return decorate


def renamed_attribute(old: str, new: str) -> Any:
    """Property that gives an attribute under its former name.

    Parameters
    ----------
    old, new : str
    """

    def get(self: Any) -> Any:
        _warn(f"{type(self).__name__}.{old}", f"{type(self).__name__}.{new}")
        return getattr(self, new)

    return property(get, doc=f"Former name of ``{new}``.")


def renamed_keys(values: Mapping[str, Any], renamed: Mapping[str, str], where: str | None = None) -> dict[str, Any]:
    """Mapping with present names in place of former ones.

    Parameters
    ----------
    values : mapping
    renamed : mapping
        Present name by former name.
    where : str, optional
        What the mapping is, for a warning; by default there is none, as for files that were written before.
    """
    if where is not None:
        for old in renamed.keys() & values.keys():
            _warn(f"{where}: {old}", renamed[old], level=4)
    return {renamed.get(name, name): value for name, value in values.items()}


class _FormerModules(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds modules under their former names, before any file that an earlier version has left behind."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Specification of a former module, None for others.

        Raises
        ------
        ModuleNotFoundError
            For one that was removed from the package; the message says where it is.
        """
        for gone, place in GONE.items():
            if fullname == gone or fullname.startswith(f"{gone}."):
                raise ModuleNotFoundError(
                    f"{fullname} is not part of the package any more: in a clone of the project it is {place}",
                    name=fullname,
                )
        return importlib.machinery.ModuleSpec(fullname, self) if fullname in MODULES else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        """Leave the module to the import system."""

    def exec_module(self, module: types.ModuleType) -> None:
        """Fill the module with what stands in the present one."""
        present = importlib.import_module(MODULES[module.__name__])
        warnings.warn(
            f"{module.__name__} is deprecated, use {present.__name__}", DeprecationWarning, stacklevel=2, source=None
        )
        moved = MOVED.get(module.__name__, {})
        vars(module).update(
            {name: value for name, value in vars(present).items() if not name.startswith("__") and name not in moved}
        )

        def __getattr__(name: str) -> Any:
            if name not in moved:
                return getattr(present, name)
            place, _, new = moved[name].rpartition(".")
            _warn(f"{module.__name__}.{name}", moved[name])
            return getattr(importlib.import_module(place), new)

        vars(module)["__getattr__"] = __getattr__


def install() -> None:
    """Let modules be imported under their former names."""
    if not any(isinstance(finder, _FormerModules) for finder in sys.meta_path):
        sys.meta_path.insert(0, _FormerModules())
