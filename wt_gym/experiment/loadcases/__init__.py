"""Design load cases of IEC 61400-1 for any agent or controller."""
