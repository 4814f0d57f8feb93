"""Validation cases: the simulator's structural core against exact, published or independently computed numbers."""
