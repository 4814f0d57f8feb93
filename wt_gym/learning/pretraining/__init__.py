"""Pretraining of a policy by gradient on an identified model, in recorded winds."""
