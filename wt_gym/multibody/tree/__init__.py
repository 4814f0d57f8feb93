"""Bodies and joints as a tree: kinematics, inertia, rates, points, outputs."""
