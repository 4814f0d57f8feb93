"""Velocities of vortex segments: direct sums, tree code, threads."""
