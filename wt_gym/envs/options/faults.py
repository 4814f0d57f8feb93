"""Options of what breaks in an episode."""

from __future__ import annotations

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, as_pair, as_tuple, not_empty, option, option_record, shown

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


def _checked_kinds(kinds: str | tuple[str, ...]) -> tuple[str, ...]:
    names, known = FAULT_KINDS if kinds == ALL else as_tuple(kinds), (*FAULT_KINDS, *GRID_KINDS)
    if wrong := [name for name in names if name not in known]:
        raise ValueError(f"must be among {', '.join(known)}, got {shown(wrong[0])}{did_you_mean(wrong[0], known)}")
    return not_empty(names)


@option_record
class FaultOptions(Options):
    """Faults of an episode, see `wt_gym.envs.fault_draws`."""

    title = "faults"
    switch = "kinds"

    kinds: str | tuple[str, ...] | None = option(
        f'Kinds of faults; each episode draws one of them: {", ".join(FAULT_KINDS)}; "all" of them; and '
        f"{', '.join(GRID_KINDS)}. None: nothing breaks",
        default=None,
        flat="fault_kinds",
        kind="str or sequence of str, optional",
        check=_checked_kinds,
    )
    sizes: str = option(
        "Range that the size of a fault is drawn from: that for training, or one beyond it for tests",
        default="train",
        flat="fault_sizes",
        choices=SIZES,
    )
    time: float | tuple[float, float] = option(
        "When the fault begins; a range is drawn from. Ice is there from the start of the episode",
        default=(5.0, 20.0),
        flat="fault_time",
        unit="s",
        low=0.0,
        check=as_pair,
    )
