"""One aerodynamic time step of structure and air: motion, loads, measurement and checks."""
