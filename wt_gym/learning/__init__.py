"""Training of agents, pretraining, identification and linear design."""
