"""Compiled watch over the structural steps within an aerodynamic one: what is largest and smallest in between."""

import math

from wt_gym.base.compiled import kernel
from wt_gym.simulation.step.coupling_kernels import passing_clearance, read_gauges


@kernel(separate=True)
def watch_steps(motion, n_sub, g, m):
    """Take the extremes over the structural steps of the aerodynamic step that has just ended, and the pitch travel.

    Parameters
    ----------
    motion : Motion
        With the states and rates of the structural steps in ``motion.work.trail`` and ``trail_rate``.
    n_sub : int
        Their number.
    g : Gauges
    m : Monitor
    """
    loads = motion.inputs.body_loads
    for k in range(n_sub - 1):
        share = (k + 1.0) / n_sub
        for b in range(loads.shape[1]):
            for i in range(loads.shape[2]):
                m.loads[b, i] = loads[0, b, i] + share * (loads[1, b, i] - loads[0, b, i])
        watch(motion.work.trail[k], motion.work.trail_rate[k], m.loads, motion.tree, motion.work, g, m)
    watch(motion.state, motion.rate, loads[1], motion.tree, motion.work, g, m)  # rates under the final loads
    for i in range(m.pitch.shape[0]):
        pitch = motion.state[m.first_pitch + i]
        m.extremes.pitch_travel[i] += abs(pitch - m.pitch[i])
        m.pitch[i] = pitch


@kernel
def rotor_speed(y, m):
    """Speed of the hub against the nacelle [rad/s]."""
    return y[m.generator_u] + (y[m.torsion_u] if m.torsion_u >= 0 else 0.0)


@kernel(separate=True)
def watch(y, dy, loads, tree, work, g, m):
    """Let one state count, under loads of the air (n_b, 6 + n_f), and the way of the tips to it from that before."""
    read_gauges(y, dy, loads, tree, work, g)
    e = m.extremes
    e.rotor_speed_max[0] = max(e.rotor_speed_max[0], rotor_speed(y, m))
    base = g.wrench[m.tower]
    e.tower_base_moment_max[0] = max(e.tower_base_moment_max[0], math.hypot(base[3], base[4]))
    for i in range(g.blades.shape[0]):
        e.root_flap_moment_max[i] = max(e.root_flap_moment_max[i], abs(g.wrench[g.blades[i], 4]))
        e.tip_out_of_plane_max[i] = max(e.tip_out_of_plane_max[i], g.deflection[i, 0])
        e.tip_clearance_min[i] = min(e.tip_clearance_min[i], passing_clearance(m.passed[i], g.tower_view[i], m.between))
        for c in range(4):
            m.passed[i, c] = g.tower_view[i, c]
