"""Sweeps, trainings and searches on a Ray cluster; importing its modules needs the extra ``ray``."""
