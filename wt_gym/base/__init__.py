"""Foundations that every package may use: errors, files, compiled kernels, child processes, caches."""
