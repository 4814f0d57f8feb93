"""One step of structure and air together, in one compiled call that allocates nothing.

Constants among the arguments of big kernels stand as ``bool(True)`` or ``int(0)``: a bare one would compile a form of
the kernel for this value alone, beside the one that Python calls.
"""

from wt_gym.aerodynamics.step_kernels import accept, convect_wake, prepare, solve
from wt_gym.compiled import kernel
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.tree.tree_kernels import OK, kinematics
from wt_gym.simulation.coupling_kernels import rotor_loads, rotor_motion

# Beyond the codes of the multibody kernels
OVERSPEED, DEFLECTION, UNSETTLED = 101, 102, 103
DISAGREEMENT = 1e-3  # of circulation and polars, over the largest speed of a section, with which a step may end
# The predictor alone is unstable: what it amplifies in so few sub-steps is less than the change of the loads.
MOST_UNCORRECTED = 4


@kernel
def move_lattice(y, tree, work, x):
    """Lattice nodes and their velocities for the state y; the kinematics are then up to date. x: `Exchange`."""
    kinematics(y, tree, work)
    for i in range(x.elastic.shape[0]):
        for k in range(x.elastic.shape[1]):
            x.elastic[i, k] = y[x.elastic_q[i, k]]
            x.elastic_rate[i, k] = y[x.elastic_u[i, k]]
    n_blade, n_point = x.elastic.shape[0], x.points.position.shape[0]
    shape = (n_blade, n_point, 3)
    rotor_motion(work.rot, work.r, work.v, work.omega, x.elastic, x.elastic_rate, x.points, x.blades,
                 x.nodes.reshape(shape), x.velocities.reshape(shape))  # fmt: skip


@kernel
def copy_history(source, target):
    """Points of the multistep scheme from one set of arrays to another."""
    for k in range(source.y.shape[0]):
        for i in range(source.y.shape[1]):
            target.y[k, i] = source.y[k, i]
            target.f[k, i] = source.f[k, i]
    for i in range(source.error.shape[0]):
        target.error[i] = source.error[i]
    target.filled[0] = source.filled[0]


@kernel
def check_range(y, x):
    """OK, or what has left the range in which the model has a meaning."""
    if not abs(y[x.speed_index]) < x.max_speed:
        return OVERSPEED
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
def extrapolate_loads(inputs, previous):
    """First guess of the loads at the end of a step: those of the last two steps, continued in a straight line."""
    first, last = inputs.body_loads[0], inputs.body_loads[1]
    for b in range(first.shape[0]):
        for k in range(first.shape[1]):
            last[b, k] = 2.0 * first[b, k] - previous[b, k]


@kernel
def coupled_step(p, o, a, w, x, history, saved, inputs, tree, work, blade_wind, dt, h, n_sub, n_corrections,
                 iterations, tolerance, constrained=None, bodies=None, body_work=None):  # fmt: skip
    """Advance structure and air by one aerodynamic step dt.

    The wake moves on first and then stands still while structure and loads are iterated to agreement at the end of the
    step. The first pass of the structure is not corrected by its scheme: it only has to tell where the blades will be.

    Parameters
    ----------
    p, o, a, w : PlanformArrays, AeroConstants, AeroArrays, AeroWork
    x : Exchange
    history, saved : HammingHistory
        Points of the structure's multistep scheme, and room for a copy.
    inputs, tree, work : arrays of the multibody system
    blade_wind : (n_blade, n_chord + 1, n_span + 1, 3)
        Wind at the lattice nodes at the end of the step [m/s].
    dt, h : float
        Aerodynamic and structural step [s], n_sub of these.
    iterations, tolerance
        Most passes, and the relative change of the loads at which they end.
    bodies, body_work : BodyArrays, BodyWork, optional
        Closed bodies in the flow; the wind at their control points is in ``body_work.wind``.

    Returns
    -------
    int
        OK, a code of the multibody kernels, OVERSPEED, DEFLECTION or UNSETTLED.
    """
    code = predict_step(o, a, x, history, saved, inputs, tree, work, dt, h, n_sub, n_corrections, iterations,
                        constrained)  # fmt: skip
    if code == OK:
        prepare(p, o, a, w, x.nodes, bool(True), bodies, body_work)
        code = correct_step(p, o, a, w, x, history, saved, inputs, tree, work, blade_wind, dt, h, n_sub, n_corrections,
                            iterations, tolerance, constrained)  # fmt: skip
    if code == OK:
        accept(p, o, a, w, bool(True), bool(False), bodies, body_work)
        code = end_step(x, history, inputs, tree, work, constrained)
    return code


@kernel
def predict_step(o, a, x, history, saved, inputs, tree, work, dt, h, n_sub, n_corrections, iterations,
                 constrained=None):  # fmt: skip
    """Move the wake, and the structure under extrapolated loads; arguments as for `coupled_step`."""
    convect_wake(o, a, dt)
    copy_history(history, saved)
    extrapolate_loads(inputs, x.previous_loads)
    # The Cartesian coordinates of a free blade turn with the rotor: their prediction needs a correction.
    rough = constrained is None and iterations > 1 and n_sub <= MOST_UNCORRECTED
    guess = 0 if rough else n_corrections
    code = hamming_advance(history, inputs, tree, work, h, n_sub, guess, constrained, bool(False))
    if code == OK:
        move_lattice(history.y[3], tree, work, x)
    return code


@kernel
def correct_step(p, o, a, w, x, history, saved, inputs, tree, work, blade_wind, dt, h, n_sub, n_corrections, iterations,
                 tolerance, constrained=None):  # fmt: skip
    """Loads and structure in turn until they agree; arguments as for `coupled_step`."""
    n_blade, n_point = x.elastic.shape[0], x.points.position.shape[0]
    share = 1.0
    for iteration in range(iterations):
        copy_loads(inputs.body_loads[1], x.passes[0])
        solve(p, o, a, w, x.nodes, x.velocities, blade_wind, dt, bool(False))
        change = rotor_loads(a.forces.reshape((n_blade, n_point, 3)), work.rot, x.elastic, x.points, x.blades,
                             inputs.body_loads[1])  # fmt: skip
        # the prediction was not corrected yet: one pass at least
        if iteration == iterations - 1 or (iteration > 0 and change < tolerance):
            break
        share = relax_loads(inputs.body_loads[1], x.passes, share, iteration)
        copy_history(saved, history)
        code = hamming_advance(history, inputs, tree, work, h, n_sub, n_corrections, constrained, bool(False))
        if code != OK:
            return code
        move_lattice(history.y[3], tree, work, x)
    return check_sections(a)


@kernel
def check_sections(a):
    """OK, or UNSETTLED where circulation and polars have not come to agree."""
    fastest = 0.0
    for k in range(a.speed.shape[0]):
        fastest = max(fastest, a.speed[k])
    return OK if a.residual[0] <= DISAGREEMENT * (fastest + 1e-3) else UNSETTLED


@kernel
def copy_loads(source, target):
    """Loads (n_b, 6 + n_f) from one array to another."""
    for b in range(source.shape[0]):
        for k in range(source.shape[1]):
            target[b, k] = source[b, k]


@kernel
def relax_loads(new, passes, share, iteration):
    """Take the share of the change of the loads that a secant through the last two passes wants; returns the share.

    Aitken's relaxation (Irons & Tuck, Int. J. Numer. Methods Eng. 1, 1969; Kuettler & Wall, Comput. Mech. 43, 2008):
    from pass to pass the change of the loads is multiplied by minus the mass of the air that moves with a blade over
    the mass of the blade; on light blades it would grow. ``passes`` (2, n_b, 6 + n_f) holds the loads under which the
    blades have moved and the change of the pass before.
    """
    product, square = 0.0, 0.0
    for b in range(new.shape[0]):
        for k in range(new.shape[1]):
            difference = new[b, k] - passes[0, b, k] - passes[1, b, k]
            product += passes[1, b, k] * difference
            square += difference * difference
    if iteration > 0 and square > 0.0:
        share = min(max(-share * product / square, 0.05), 1.5)
    for b in range(new.shape[0]):
        for k in range(new.shape[1]):
            change = new[b, k] - passes[0, b, k]
            passes[1, b, k] = change
            new[b, k] = passes[0, b, k] + share * change
    return share


@kernel
def end_step(x, history, inputs, tree, work, constrained=None):
    """Rates that belong to the stored state and the final loads; has anything left the range of the model?"""
    code = hamming_advance(history, inputs, tree, work, 1.0, int(0), int(0), constrained, bool(True))
    if code != OK:
        return code
    for b in range(x.previous_loads.shape[0]):
        for k in range(x.previous_loads.shape[1]):
            x.previous_loads[b, k] = inputs.body_loads[0, b, k]
    return check_range(history.y[3], x)
