"""Options of the actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wt_gym.base.errors import did_you_mean
from wt_gym.control.actions import ACTION_MODES, COMPONENTS, PITCH_FORMS, RESIDUAL_FORMS
from wt_gym.envs.arguments import check_mapping, check_names
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["ActionOptions"]


@option_group
class ActionOptions(OptionGroup):
    """What the components of an action are and mean, see `wt_gym.control.ActionMap`."""

    title = "actions"

    mode: str = option('{"rate", "absolute", "residual"}', "What an action moves", default="rate", flat="action_mode")
    pitch: str = option(
        '{"collective", "individual", "fixed-frame", "cyclic"}',
        "Coordinates of the pitch",
        default="collective",
        allowed='"cyclic" with mode "residual"; the latter two with three blades or more',
    )
    components: Sequence[str] | None = option(
        'sequence of {"pitch", "yaw", "torque", "set_point"}, optional',
        'Components of the action, by default the first three as far as there are any; "set_point" moves that of '
        "a supervisor",
        default=None,
        flat="action_components",
    )
    spans: Mapping[str, float] | None = option(
        "mapping, optional",
        'Rates and limits other than the default ones: "pitch", "pitch_mean" [rad], "pitch_rate", "yaw_rate" [rad/s], '
        '"torque" [N m], "torque_rate" [N m/s], "set_point" [-], "set_point_rate" [1/s]; see '
        "`wt_gym.control.ActionMap`",
        default=None,
        flat="action_spans",
        allowed="positive, rates at most those of the drives",
    )

    residual: str = option(
        '{"rate", "offset"}',
        'What actions of mode "residual" say: the rate of an offset, or the offset itself, to which the present one '
        "moves at no more than the greatest rate",
        default="rate",
        flat="residual_form",
        allowed='"offset" with mode "residual"',
    )

    def check(self) -> None:
        """Refuse unknown modes, coordinates and components, and spans that are no numbers."""
        for name, value, allowed in (
            ("action_mode", self.mode, ACTION_MODES),
            ("pitch", self.pitch, PITCH_FORMS),
            ("residual_form", self.residual, RESIDUAL_FORMS),
        ):
            if value not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {value!r}{did_you_mean(value, allowed)}")
        if self.pitch == "cyclic" and self.mode != "residual":
            raise ValueError(
                f"pitch='cyclic' has no mean of its own: it needs action_mode='residual', got {self.mode!r}"
            )
        if self.residual != "rate" and self.mode != "residual":
            raise ValueError(f"residual_form={self.residual!r} needs action_mode='residual', got {self.mode!r}")
        self._set_all(check_names, "components")
        if self.components is not None and not (self.components and set(self.components) <= set(COMPONENTS)):
            raise ValueError(f"action_components must name some of {COMPONENTS}, got {self.components!r}")
        self._set_all(check_mapping, "spans")
