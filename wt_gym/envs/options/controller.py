"""Options of the base controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from wt_gym.control.controllers import Controller, FadeParameters
from wt_gym.envs.arguments import check_number, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["ControllerOptions"]


@option_group
class ControllerOptions(OptionGroup):
    """The base controller, and how residual pitch adds to it."""

    title = "controller"
    objects = {"residual_fade": FadeParameters}  # noqa: RUF012 - of the class, as its base says

    base: str | Controller | Callable[..., Any] = option(
        "str, Controller or callable",
        "What runs under residual actions, or decides on components left out: a name for "
        '`wt_gym.control.controllers.make_controller` (``"path/file.py:Class"`` among them), a controller, or a '
        "function that makes one for a turbine",
        default="discon",
        flat="controller",
    )
    residual_fade: bool | float | FadeParameters = option(
        "bool, float, FadeParameters or mapping",
        "Whether residual pitch acts only above rated wind, as additions to industrial controllers do "
        "(`wt_gym.control.controllers.AboveRated`): blades at fine pitch stay where they make the most power; a "
        "number is the pitch above fine pitch from which on it acts in full, in rad, a mapping has the arguments of "
        'FadeParameters. The share that acts can be observed as "residual_share". Other modes have none to fade',
        default=False,
        allowed="a pitch from 0.001 to 0.5 rad",
    )
    residual_washout: float | None = option(
        "float, optional",
        "Time constant of a high-pass filter on the mean of the blades' residual pitch: lasting offsets of all blades "
        "are left to the base controller, see `wt_gym.control.actions`. What acts can be observed as "
        '"residual_mean". It has no effect on tilt and yaw alone, or in other modes',
        default=None,
        unit="s",
        allowed="positive",
    )

    def check(self) -> None:
        """Refuse what cannot be a controller."""
        base = self.base
        if not (isinstance(base, str) or callable(base) or hasattr(base, "start")):
            raise ValueError(f"controller must be a name, a Controller or a function, got {shown(base)}")
        self._set_all(check_number, "residual_washout", unit="s")
