"""Options of what breaks in an episode."""

from __future__ import annotations

from collections.abc import Sequence

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_names, real_number, real_numbers, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group

__all__ = ["FAULT_KINDS", "GRID_KINDS", "NO_FAULT", "SIZES", "FaultOptions"]

NO_FAULT, ALL = "none", "all"
"""Kind of an episode in which nothing breaks, and what stands for all kinds."""
FAULT_KINDS = (
    NO_FAULT, "stuck_blade", "slow_drive", "misaligned_blade", "iced_blade", "biased_rotor_speed", "dead_rotor_speed",
    "biased_generator_speed", "biased_moment", "dead_moment", "biased_pitch", "dead_pitch", "biased_vane", "dead_vane",
)  # fmt: skip
"""What may break."""
GRID_KINDS = ("voltage_dip",)
"""What may happen to the grid; "all" does not stand for it."""
SIZES = ("train", "held_back")
"""Ranges that the sizes of faults are drawn from."""


@option_group
class FaultOptions(OptionGroup):
    """What breaks in an episode, see `wt_gym.envs.fault_draws`."""

    title = "faults"

    kinds: Sequence[str] | None = option(
        "str or sequence of str, optional",
        f'Kinds of faults; each episode draws one of them: {", ".join(FAULT_KINDS)}; "all" of them; and '
        f"{', '.join(GRID_KINDS)}. None: nothing breaks",
        default=None,
        flat="fault_kinds",
    )
    sizes: str = option(
        '{"train", "held_back"}',
        "Range that the size of a fault is drawn from: that for training, or one beyond it for tests",
        default="train",
        flat="fault_sizes",
    )
    time: float | Sequence[float] = option(
        "float or (float, float)",
        "When the fault begins; a range is drawn from. Ice is there from the start of the episode",
        default=(5.0, 20.0),
        flat="fault_time",
        unit="s",
        allowed="at least 0",
    )

    def check(self) -> None:
        """Refuse unknown kinds and times without meaning."""
        if self.kinds is not None:
            given = FAULT_KINDS if self.kinds == ALL else self.kinds
            kinds = check_names("fault_kinds", (given,) if isinstance(given, str) else given)
            if not kinds or len(set(kinds)) < len(kinds):
                raise ValueError(f"fault_kinds must have names, each once, got {shown(kinds)}")
            for name in kinds:
                if name not in (known := (*FAULT_KINDS, *GRID_KINDS)):
                    raise ValueError(
                        f"fault_kinds must be among {', '.join(known)}, got {name!r}{did_you_mean(name, known)}"
                    )
            self._set("kinds", kinds)
        if self.sizes not in SIZES:
            raise ValueError(
                f"fault_sizes must be one of {', '.join(SIZES)}, got {shown(self.sizes)}"
                f"{did_you_mean(self.sizes, SIZES)}"
            )
        single, ends = real_number(self.time), real_numbers(self.time)
        low, high = (single, single) if single is not None else ends if len(ends) == 2 else (-1.0, -1.0)
        if not 0.0 <= low <= high < float("inf"):
            raise ValueError(f"fault_time must be a number or a range (low, high) from 0 s on, got {shown(self.time)}")
        self._set("time", (float(low), float(high)))
