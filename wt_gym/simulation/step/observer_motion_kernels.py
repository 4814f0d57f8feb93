"""How a structure in local observer frames moves: the frames own the motion, the multibody system reads it.

After each structural step the motion is written into the state of the turbine's multibody system, in which the lattice,
the gauges, the monitor and the balance of energy read it. Arguments are ``motion``, `Motion`, and ``o``, `Observed`.
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.observer_frame.observer_frame_constraint_kernels import rows_of
from wt_gym.multibody.observer_frame.observer_frame_kernels import accelerations, hold_velocities, refresh, step
from wt_gym.multibody.tree.rate_kernels import prescribe_servos
from wt_gym.multibody.tree.tree_kernels import OK

# ---- what acts -----------------------------------------------------------------------------------------------------


@kernel
def turn_servos(motion, o, scheme, k):
    """Servos at the end of structural step k (from 1 on), into the state; drives of the observer frames follow them.

    One that no command prescribes, θ̈ = ω² (c − θ) − 2 ζ ω θ̇ with a command c linear in time, is integrated exactly:
    θ − c + 2 ζ ċ/ω and its rate move by the matrix exponential ``o.servo``.
    """
    tree, inputs, y, dy = motion.tree, motion.inputs, motion.state, motion.rate
    n_y, n_s = tree.n_q + tree.n_u, tree.n_servo
    before, now = (k - 1.0) / scheme.n_sub, k / scheme.n_sub
    prescribe_servos(y, now, inputs, n_y)
    for s in range(n_s):
        interval = inputs.servo_interval[1, s]
        if interval > 0.0:
            change = inputs.servo_rate[1, s] - inputs.servo_rate[0, s]
            dy[n_y + n_s + s] = 30.0 * (now * (1.0 - now)) ** 2 * change / interval
        else:
            wn, lag = tree.servo_frequency[s], 2.0 * tree.servo_damping[s]
            first, last = inputs.servo_command[0, s], inputs.servo_command[1, s]
            rate, e = (last - first) / scheme.dt, o.servo[s]
            if k > 0:
                error = y[n_y + s] - first - before * (last - first) + lag / wn * rate
                slope = y[n_y + n_s + s] - rate
                y[n_y + s] = e[0, 0] * error + e[0, 1] * slope + first + now * (last - first) - lag / wn * rate
                y[n_y + n_s + s] = e[1, 0] * error + e[1, 1] * slope + rate
            ahead = first + now * (last - first) - y[n_y + s]
            dy[n_y + n_s + s] = wn * wn * ahead - lag * wn * y[n_y + n_s + s]
        dy[n_y + s] = y[n_y + n_s + s]
    for d in range(o.drives.shape[0]):
        s, drive = o.drives[d], o.work.drive[d]
        drive[0], drive[1], drive[2] = y[n_y + s], y[n_y + n_s + s], dy[n_y + n_s + s]


@kernel
def act(motion, o, tau):
    """Loads on the bodies, torques and references of hinges at the fraction tau of the aerodynamic step."""
    tree, inputs, w = motion.tree, motion.inputs, o.work
    first, last = inputs.body_loads[0], inputs.body_loads[1]
    for i in range(o.bodies.shape[0]):
        b, load = o.bodies[i], w.body_load[i]
        n = tree.n_elastic[b]
        for k in range(n):
            u = tree.elastic_u[b] + k
            load[k] = first[b, 6 + k] + tau * (last[b, 6 + k] - first[b, 6 + k])
            load[k] += inputs.dof_force[0, u] + tau * (inputs.dof_force[1, u] - inputs.dof_force[0, u])
        for k in range(6):
            load[n + k] = first[b, k] + tau * (last[b, k] - first[b, k])
    for i in range(o.hinges.shape[0]):
        u, spring = o.hinges[i, 3], w.spring[o.hinges[i, 1]]
        spring[0] = inputs.reference[0, u] + tau * (inputs.reference[1, u] - inputs.reference[0, u])
        spring[1] = inputs.reference_rate[0, u] + tau * (inputs.reference_rate[1, u] - inputs.reference_rate[0, u])
        spring[2] = inputs.dof_force[0, u] + tau * (inputs.dof_force[1, u] - inputs.dof_force[0, u])


# ---- what is seen --------------------------------------------------------------------------------------------------


@kernel
def tell_tree(motion, o):
    """Write the motion of the observer frames into the newest state of the multibody system and its rates.

    Elastic coordinates are the same; angles, rates and accelerations of hinges are values, rates and Φ̈ = B q̈ + bias of
    their rows, which belong to the present state.
    """
    tree, y, dy, s = motion.tree, motion.state, motion.rate, o.state
    n_q = tree.n_q
    for i in range(o.bodies.shape[0]):
        b = o.bodies[i]
        q, u = tree.elastic_q[b], n_q + tree.elastic_u[b]
        for k in range(tree.n_elastic[b]):
            y[q + k], y[u + k] = s.q[i, k], s.v[i, k]
            dy[q + k], dy[u + k] = s.v[i, k], s.a[i, k]
    for r in range(o.work.row_change.shape[0]):
        o.work.row_change[r] = o.work.row_bias[r]
    rows_of(o.model, s.a, o.work, o.work.row_change)
    for i in range(o.hinges.shape[0]):
        r, q, u = o.hinges[i, 0], o.hinges[i, 2], n_q + o.hinges[i, 3]
        y[q], y[u] = o.work.row_value[r], o.work.row_rate[r]
        dy[q], dy[u] = o.work.row_rate[r], o.work.row_change[r]


@kernel
def keep(source, target):
    """Copy all numbers of a state in observer frames and of the multibody system (flat arrays and frame counts)."""
    for i in range(source.numbers.shape[0]):
        target.numbers[i] = source.numbers[i]
    for i in range(source.counts.shape[0]):
        target.counts[i] = source.counts[i]


@kernel
def save_frames(motion, o):
    """Keep the motion at the start of an aerodynamic step."""
    keep(o.now, o.saved)
    for i in range(o.tree_state.shape[0]):
        o.tree_state[i] = motion.state[i]


@kernel
def restore_frames(motion, o):
    """Take the motion back to what was kept; returns a code."""
    keep(o.saved, o.now)
    for i in range(o.tree_state.shape[0]):
        motion.state[i] = o.tree_state[i]
    return refresh(o.model, o.state, o.work)


# ---- the step ------------------------------------------------------------------------------------------------------


@kernel(separate=True)
def begin_frames(motion, o, scheme):
    """Consistent velocities and accelerations for a state that was just set; returns a code."""
    turn_servos(motion, o, scheme, int(0))
    act(motion, o, 0.0)
    code = refresh(o.model, o.state, o.work)
    if code == OK:
        code = hold_velocities(o.model, o.state, o.work)
    if code == OK:
        code = accelerations(o.loads, o.model, o.state, o.work)
    tell_tree(motion, o)
    return code


@kernel(separate=True)
def move_frames(motion, o, scheme):
    """The structure through one aerodynamic step; states and rates of all structural steps into the trail."""
    y, dy, work = motion.state, motion.rate, motion.work
    for k in range(scheme.n_sub):
        turn_servos(motion, o, scheme, k + 1)
        act(motion, o, (k + 1.0) / scheme.n_sub)
        code = step(scheme.h, o.loads, o.n_iterations, o.threshold, o.model, o.state, o.work)
        if code != OK:
            return code
        tell_tree(motion, o)
        for i in range(y.shape[0]):
            work.trail[k, i], work.trail_rate[k, i] = y[i], dy[i]
    return OK


@kernel
def end_frames(motion, o):
    """Accelerations under the loads at the end of an aerodynamic step; returns a code."""
    act(motion, o, 1.0)
    code = accelerations(o.loads, o.model, o.state, o.work)
    if code == OK:
        tell_tree(motion, o)
    return code
