"""Linear optimal pitch in the fixed frame: the offsets, what is read of the turbine, and designs as files."""

import wt_gym.control.controllers  # noqa: F401  # its parts and those of this room need each other: it must come first
