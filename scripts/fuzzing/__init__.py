"""Fuzzing of the environment: drawn winds, turbines, arguments and policies, with its contract checked in each step."""
