"""Constants, each in one place."""

__all__ = ["DAY", "GRAVITY"]

DAY = 86400.0
"""Length of a day [s]."""

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²] (3rd CGPM, 1901; ISO 80000-3), as in OpenFAST's model of the NREL 5-MW."""
