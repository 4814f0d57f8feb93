"""One aerodynamic step of structure and air together, in one compiled call that allocates nothing.

The structure moves by the kernels of `wt_gym.simulation.step.structure_motion_kernels`, in whatever form it is. Where
the lattice computes the induction of a big wake in threads, Python runs `coupled_step` part by part
(`wt_gym.simulation.step.coupling`): the order of the parts stands here alone.

Constants among the arguments of big kernels stand as ``bool(True)`` or ``int(0)``: a bare one would compile a form of
the kernel for this value alone, beside the one that Python calls.
"""

from wt_gym.aerodynamics.lattice.section_kernels import DISAGREEMENT
from wt_gym.aerodynamics.step_kernels import accept, convect_wake, prepare, settle, solve
from wt_gym.base.compiled import kernel
from wt_gym.hydrodynamics.loads_kernels import accept_step
from wt_gym.multibody.tree.tree_kernels import OK
from wt_gym.simulation.step.coupling_kernels import rotor_loads, tower_drag
from wt_gym.simulation.step.energy_kernels import check_energy
from wt_gym.simulation.step.measurement_kernels import fill_channels
from wt_gym.simulation.step.monitor_kernels import rotor_speed, watch_steps
from wt_gym.simulation.step.structure_motion_kernels import (
    end_motion,
    move_lattice,
    move_structure,
    restore_motion,
    save_motion,
)
from wt_gym.simulation.step.water_kernels import fill_platform, floater_loads

# Beyond the codes of the multibody kernels
OVERSPEED, DEFLECTION, UNSETTLED, LINE_FAILS = 101, 102, 103, 106
MOST_PASSES = 20  # of loads and structure, where they do not come to agree
SECANT_MEMORY = 0.9  # a step: what the share of the loads' change keeps of the steps before
LEAST_SHARE, LARGEST_SHARE = 0.05, 1.5


@kernel(nogil=True)
def coupled_step(air, structure, x, scheme, gauges, monitor, blade_wind):
    """Advance structure and air by one aerodynamic step.

    The wake moves on first and then stands still while structure and loads are iterated to agreement at the end of the
    step. The first pass of the structure is not corrected by its scheme: it only has to tell where the blades will be.

    Parameters
    ----------
    air : Air
        The wind at the control points of closed bodies is in ``air.body_work.wind``.
    structure : Structure
    x : CouplingData
    scheme : Scheme
    gauges : Gauges
    monitor : Monitor
    blade_wind : (n_blade, n_chord + 1, n_span + 1, 3)
        Wind at the lattice nodes at the end of the step [m/s].

    Returns
    -------
    int
        OK, a code of the multibody kernels, OVERSPEED, DEFLECTION, UNSETTLED, or a code of `energy_kernels`.
    """
    code = predict_step(air, structure, x, scheme)
    if code == OK:
        prepare_air(air, x.nodes)
        code = correct_step(air, structure, x, scheme, blade_wind)
    if code == OK:
        accept_air(air)
        code = end_step(structure, x, scheme, gauges, monitor, air.arrays.forces, blade_wind)
    return code


@kernel
def prepare_air(air, nodes):
    """What of the air is computed once a step, for lattice nodes where they were predicted."""
    prepare(air.planform, air.constants, air.arrays, air.work, nodes, bool(True), air.bodies, air.body_work)


@kernel
def accept_air(air):
    """Shed the newest ring, and compute the velocities that move the wake next."""
    accept(air.planform, air.constants, air.arrays, air.work, bool(True), bool(False), air.bodies, air.body_work)


@kernel(separate=True)
def predict_step(air, structure, x, scheme):
    """Move the wake, and the structure under extrapolated loads; arguments as for `coupled_step`."""
    convect_wake(air.constants, air.arrays, scheme.dt)
    save_motion(structure)
    motion = structure.motion
    extrapolate_loads(motion.inputs, x.previous_loads)
    code = move_structure(structure, scheme, scheme.iterations > 1)
    if code == OK:
        move_lattice(motion.state, motion.tree, motion.work, x)
    return code


@kernel(separate=True)
def correct_step(air, structure, x, scheme, blade_wind):
    """Loads and structure in turn until they agree; arguments as for `coupled_step`.

    What the last pass leaves is a force under which the structure has moved and which the air does not exert: its work
    comes from nothing. As many passes as the scheme has leave some per cent of the loads, of either sign; where they
    leave more than ``scheme.loosest`` others follow.
    """
    shape = (x.nodes.shape[0], x.nodes.shape[1] * x.nodes.shape[2], 3)
    motion = structure.motion
    forces, loads = air.arrays.forces.reshape(shape), motion.inputs.body_loads[1]
    share = x.relaxation[0]
    for iteration in range(MOST_PASSES):
        copy_loads(loads, x.passes[0])
        solve(air.planform, air.constants, air.arrays, air.work, x.nodes, x.velocities, blade_wind, scheme.dt,
              bool(False))  # fmt: skip
        change = rotor_loads(forces, motion.work.rot, x.elastic, x.points, x.lattice_bodies, x.sub_bodies, loads)
        tower_drag(motion.state, motion.tree, motion.work, x.tower, loads[x.tower.body])
        code = water_loads(x.water, motion.work, loads)
        if code != OK:
            return code
        if iteration > 0:  # the prediction was not corrected yet: one pass at least
            share = secant_share(loads, x.passes, share, x.relaxation)
            if change <= scheme.tolerance:
                break
        if iteration >= scheme.iterations - 1 and (change <= scheme.loosest or iteration == MOST_PASSES - 1):
            break
        relax_loads(loads, x.passes, share)
        code = restore_motion(structure)
        if code == OK:
            code = move_structure(structure, scheme, bool(False))
        if code != OK:
            return code
        move_lattice(motion.state, motion.tree, motion.work, x)
    code = check_sections(air.arrays)
    if code == UNSETTLED:
        settle(air.planform, air.constants, air.arrays, air.work, scheme.dt)
        solve(air.planform, air.constants, air.arrays, air.work, x.nodes, x.velocities, blade_wind, scheme.dt,
              bool(False))  # fmt: skip
        rotor_loads(forces, motion.work.rot, x.elastic, x.points, x.lattice_bodies, x.sub_bodies, loads)
        tower_drag(motion.state, motion.tree, motion.work, x.tower, loads[x.tower.body])
        code = check_sections(air.arrays)
    return code


@kernel(separate=True)
def end_step(structure, x, scheme, gauges, monitor, forces, blade_wind):
    """Rates under the final loads; signals; is anything out of range or balance?

    ``forces``, of the air, stand at the lattice nodes as ``blade_wind`` does; other arguments as for `coupled_step`.
    """
    code = end_motion(structure)
    if code != OK:
        return code
    motion = structure.motion
    accept_water(x.water)
    watch_steps(motion, scheme.n_sub, gauges, monitor)
    shape = (x.nodes.shape[0], x.nodes.shape[1] * x.nodes.shape[2], 3)
    fill_channels(motion.state, x.nodes.reshape(shape), forces.reshape(shape), motion.tree, motion.work, gauges)
    fill_water(x.water, motion, gauges.values)
    copy_loads(motion.inputs.body_loads[0], x.previous_loads)
    code = check_range(motion.state, x, monitor, x.sub_bodies, gauges)
    if code == OK:
        code = check_energy(motion, x.energy, gauges.wrench, blade_wind, scheme.dt)
    pass_on(motion.inputs)
    return code


# ---- water ---------------------------------------------------------------------------------------------------------
# By the type of the first argument the compiler drops what does not apply on the ground.


@kernel
def water_loads(water, work, loads):
    """Loads of the floater at the end of a step among those of all bodies (n_b, 6 + n_f); a code."""
    if water is not None:
        return OK if floater_loads(work, water, loads[water.body]) == OK else LINE_FAILS
    return OK


@kernel
def accept_water(water):
    """Let the motion of the last pass count for the memory of the water."""
    if water is not None:
        accept_step(water.platform)


@kernel
def fill_water(water, motion, values):
    """Channels of the platform; the kinematics and rates belong to the newest state."""
    if water is not None:
        fill_platform(motion.state, motion.rate, motion.tree, motion.work, water, values)


# ---- loads ---------------------------------------------------------------------------------------------------------


@kernel
def extrapolate_loads(inputs, previous):
    """First guess of the loads at the end of a step: those of the last two steps, continued in a straight line."""
    first, last = inputs.body_loads[0], inputs.body_loads[1]
    for b in range(first.shape[0]):
        for k in range(first.shape[1]):
            last[b, k] = 2.0 * first[b, k] - previous[b, k]


@kernel
def copy_loads(source, target):
    """Loads (n_b, 6 + n_f) from one array to another."""
    for b in range(source.shape[0]):
        for k in range(source.shape[1]):
            target[b, k] = source[b, k]


@kernel
def relax_loads(new, passes, share):
    """Take a share of the change of the loads; ``passes`` (2, n_b, 6 + n_f) receives loads taken and whole change."""
    for b in range(new.shape[0]):
        for k in range(new.shape[1]):
            change = new[b, k] - passes[0, b, k]
            passes[1, b, k] = change
            new[b, k] = passes[0, b, k] + share * change


@kernel
def secant_share(new, passes, share, memory):
    """The share of the change of the loads that a secant through the last two passes gives; returns it.

    Aitken's relaxation (Irons & Tuck, Int. J. Numer. Methods Eng. 1, 1969; Kuettler & Wall, Comput. Mech. 43, 2008):
    from pass to pass the change of the loads is multiplied by minus what the air resists over what the structure
    resists within a step: the mass of the air that moves with a blade and the damping of its lift, which grows with the
    speed of the blade, over its mass. On light blades and at high speed it would grow, -0.7 to -1.2 at 1.6 times rated
    speed of a 15-MW rotor against -0.3 to -0.5 in operation, and a step that ends after two passes then works on the
    blades with a force that lags behind the air's: vibrations gain energy from nothing.

    Steps resemble each other: ``memory`` (3,) holds the share with which the next step begins, and the sums, fading
    with the steps, of the numerators and denominators of the secants that it comes from. Small changes weigh little in
    them.

    Parameters
    ----------
    new : (n_b, 6 + n_f)
        Loads that follow from the motion under ``passes[0]``.
    passes : (2, n_b, 6 + n_f)
        Loads under which the blades have moved, and the change of the pass before.
    share : float
        What was taken of that change.
    """
    product, square = 0.0, 0.0
    for b in range(new.shape[0]):
        for k in range(new.shape[1]):
            difference = new[b, k] - passes[0, b, k] - passes[1, b, k]
            product -= share * passes[1, b, k] * difference
            square += difference * difference
    memory[1] = SECANT_MEMORY * memory[1] + product
    memory[2] = SECANT_MEMORY * memory[2] + square
    if memory[2] > 0.0:
        memory[0] = min(max(memory[1] / memory[2], LEAST_SHARE), LARGEST_SHARE)
    return min(max(product / square, LEAST_SHARE), LARGEST_SHARE) if square > 0.0 else share


@kernel
def pass_on(inputs):
    """What acts at the end of a step acts at the start of the next."""
    loads = inputs.body_loads
    for b in range(loads.shape[1]):
        for k in range(loads.shape[2]):
            loads[0, b, k] = loads[1, b, k]
    for k in range(inputs.dof_force.shape[1]):
        inputs.dof_force[0, k] = inputs.dof_force[1, k]
        inputs.reference[0, k], inputs.reference_rate[0, k] = inputs.reference[1, k], inputs.reference_rate[1, k]
    for s in range(inputs.servo_command.shape[1]):
        inputs.servo_command[0, s], inputs.servo_rate[0, s] = inputs.servo_command[1, s], inputs.servo_rate[1, s]
        inputs.servo_interval[0, s] = inputs.servo_interval[1, s]


# ---- limits ------------------------------------------------------------------------------------------------------


@kernel
def check_range(y, x, monitor, sub_bodies, gauges):
    """OK, or what has left the range in which the model has a meaning; the speeds are those of generator and rotor.

    The tips of blades of several sub-bodies (`SubBodyNodes`) are where the gauges have seen them.
    """
    if not (abs(y[monitor.generator_u]) < x.max_speed and abs(rotor_speed(y, monitor)) < x.max_speed):
        return OVERSPEED
    if sub_bodies is not None:
        for i in range(gauges.deflection.shape[0]):
            d = gauges.deflection[i]
            if not d[0] ** 2 + d[1] ** 2 + d[2] ** 2 < x.max_deflection**2:
                return DEFLECTION
        return OK
    for i in range(x.elastic_q.shape[0]):
        size2 = 0.0
        for c in range(3):
            tip = 0.0
            for k in range(x.elastic_q.shape[1]):
                tip += x.tip[c, k] * y[x.elastic_q[i, k]]
            size2 += tip * tip
        if not size2 < x.max_deflection**2:
            return DEFLECTION
    return OK


@kernel
def check_sections(a):
    """OK, or UNSETTLED where circulation and polars have not come to agree."""
    fastest = 0.0
    for k in range(a.speed.shape[0]):
        fastest = max(fastest, a.speed[k])
    return OK if a.residual[0] <= DISAGREEMENT * (fastest + 1e-3) else UNSETTLED
