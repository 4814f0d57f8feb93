"""Drives of pitch, yaw and generator, and their faults."""
