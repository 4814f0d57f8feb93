"""Options of the actions."""

from __future__ import annotations

from collections.abc import Mapping

from wt_gym.base.options import Options, not_empty, option, option_record
from wt_gym.control.actions import ACTION_MODES, COMPONENTS, PITCH_FORMS, RESIDUAL_FORMS

__all__ = ["ActionOptions"]


@option_record
class ActionOptions(Options):
    """Components of an action and their meaning, see `wt_gym.control.ActionMap`."""

    title = "actions"

    mode: str = option("What an action moves", default="rate", flat="action_mode", choices=ACTION_MODES)
    pitch: str = option(
        'Coordinates of the pitch: "cyclic" with mode "residual", the latter two with three blades or more',
        default="collective",
        choices=PITCH_FORMS,
    )
    components: tuple[str, ...] | None = option(
        'Components of the action, by default the first three as far as there are any; "set_point" moves that of '
        "a supervisor",
        default=None,
        flat="action_components",
        choices=COMPONENTS,
        check=not_empty,
    )
    spans: Mapping[str, float] | None = option(
        'Rates and limits other than the default ones: "pitch", "pitch_mean" [rad], "pitch_rate", "yaw_rate" [rad/s], '
        '"torque" [N m], "torque_rate" [N m/s], "set_point" [-], "set_point_rate" [1/s]; positive, rates at most those '
        "of the drives; see `wt_gym.control.ActionMap`",
        default=None,
        flat="action_spans",
    )
    residual: str = option(
        'Meaning of actions of mode "residual": the rate of an offset, or the offset itself, to which the present one '
        "moves at no more than the greatest rate",
        default="rate",
        flat="residual_form",
        choices=RESIDUAL_FORMS,
    )

    def check(self) -> None:
        """Refuse forms of residual actions in other modes."""
        for name, value, usual in (("pitch", self.pitch, PITCH_FORMS[:3]), ("residual_form", self.residual, ("rate",))):
            if value not in usual and self.mode != "residual":
                raise ValueError(f"{name}={value!r} needs action_mode='residual', got {self.mode!r}")
