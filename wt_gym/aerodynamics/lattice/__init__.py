"""Blades as lattices: planform, edges, boundary condition, sections, loads."""
