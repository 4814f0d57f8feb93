"""The models of a turbine: structure, bodies and lattice, made from its description."""
