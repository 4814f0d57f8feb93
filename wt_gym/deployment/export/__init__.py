"""Trained agents in forms that need neither this package nor PyTorch."""
