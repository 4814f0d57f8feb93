"""Constants, each in one place."""

AIR_DENSITY = 1.225
"""At sea level in the standard atmosphere [kg/m³] (ISO 2533), where nothing else is given."""

DAY = 86400.0
"""Length of a day [s]."""

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²] (3rd CGPM, 1901; ISO 80000-3), as in OpenFAST's model of the NREL 5-MW."""
