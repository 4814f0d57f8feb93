"""What training is made of: configuration, hyperparameters, environments, callbacks, the folder of a run, search."""
