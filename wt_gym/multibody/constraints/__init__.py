"""Constraint equations with multipliers, and the descriptor form."""
