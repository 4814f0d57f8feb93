"""Two running balances of energy: what the structure gains against what it is given, and what the air gives.

The structure's (first law, as an inequality). Kinetic, elastic and gravitational energy E of the turbine may rise by no
more than the work of the air on its bodies, of the generator and of the drives that turn nacelle and blades,

    E(t) - E(0) <= integral of (sum of loads . velocities + generator + drives) dt,

since all else, dampers and material, takes energy away. The work is that of the forces which the air exerts on the
blades at the end of each step, not of those under which the structure was integrated: passes of loads and structure
that do not agree, an integration that is not stable, or a drive with power of its own show in the same sum.

The air's (Betz 1920). A rotor takes at most 16/27 of the kinetic energy that the wind carries through the area it
sweeps, rho A <|V|^3> / 2, V being the undisturbed wind at the blades, over the swept area. For a while it takes more:
of the air that moves round it with the wind and with what the rotor itself induces (v^2 = F / 2 rho A, F the force of
the air on the blades, Rankine and Froude), which a wake has yet to slow. It is lent the kinetic energy of the sphere of
that air which it turns in, rho (4/3 pi R^3) <|V|^2 + v^2> / 2, at its most within `MEMORY`. Over any time T

    integral of the power of the air on the blades dt <= 16/27 integral of rho A <|V|^3> / 2 dt + loan (1 + T / MEMORY).

Sums below zero are forgotten, so that no energy given away earlier can hide what comes from nothing now.
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.output_kernels import energies
from wt_gym.multibody.tree.tree_kernels import OK

# Beyond the codes of the coupled step
STRUCTURE_GAINS, AIR_GIVES = 104, 105
BETZ = 16.0 / 27.0
SLACK = 0.01  # of the energy that passes through, for the rule by which its work is summed
CHECK_INTERVAL = 10  # steps from one sum of the energy of the structure to the next
MEMORY = 600.0  # [s] of the loan and of the wind it is measured by


@kernel(separate=True)
def check_energy(motion, e, wrench, blade_wind, dt):
    """Both balances at the end of a step dt [s] with the wind (n_blade, n_row, n_node, 3) at the blades; a code.

    motion : `Motion`, whose kinematics and rates belong to its newest state; e : `EnergyBalance`; ``wrench`` (n_b, 6)
    holds the forces and moments in the joints.
    """
    given, passing, of_air, force2 = powers(motion, e, wrench)
    speed3, speed2 = wind_at_disc(blade_wind, e.share)
    convected = e.flux * speed3
    square = speed2 + e.per_force * force2**0.5
    if e.steps_since_check[0] < 0:  # the first step after a start: from here on
        e.steps_since_check[0] = 0
        e.held[0] = whole_energy(motion)
        e.mean_square_speed[0] = square
    else:
        e.work[0] += 0.5 * dt * (given + e.given[0])
        e.traffic[0] += 0.5 * dt * (passing + e.passing[0])
        fade = 1.0 - dt / MEMORY
        excess = 0.5 * (of_air + e.of_air[0]) - 0.5 * (convected + e.convected_power[0])
        e.excess_energy[0] = max(fade * e.excess_energy[0] + excess * dt, 0.0)
        e.mean_square_speed[0] = max(square, fade * e.mean_square_speed[0])
        e.steps_since_check[0] += 1
    e.given[0], e.passing[0], e.of_air[0], e.convected_power[0] = given, passing, of_air, convected
    if e.steps_since_check[0] == CHECK_INTERVAL:
        e.steps_since_check[0] = 0
        energy = whole_energy(motion)
        e.gained[0] = max(e.gained[0] + energy - e.held[0] - e.work[0] - SLACK * e.traffic[0], 0.0)
        e.held[0], e.work[0], e.traffic[0] = energy, 0.0, 0.0
    if not e.gained[0] <= e.reserve:
        return STRUCTURE_GAINS
    return OK if e.excess_energy[0] <= e.sphere * e.mean_square_speed[0] else AIR_GIVES


@kernel(separate=True)
def whole_energy(motion):
    """Kinetic, elastic and gravitational energy of the turbine [J]."""
    kinetic, elastic, potential = energies(motion.state, motion.tree, motion.work)
    return kinetic + elastic + potential


@kernel
def wind_at_disc(wind, share):
    """Means over the swept area of |V|^3 and |V|^2, from the nodes of the blades' first row."""
    cube, square = 0.0, 0.0
    n_blade = wind.shape[0]
    for b in range(n_blade):
        for j in range(share.shape[0]):
            v2 = wind[b, 0, j, 0] ** 2 + wind[b, 0, j, 1] ** 2 + wind[b, 0, j, 2] ** 2
            cube += share[j] * v2 * v2**0.5 / n_blade
            square += share[j] * v2 / n_blade
    return cube, square


@kernel(separate=True)
def powers(motion, e, wrench):
    """Power given to the structure and the sum of the sizes of its parts [W], that of the air on the blades [W], F^2.

    Parts: of each body the loads with its frame and those on its elastic coordinates, of each coordinate its force, of
    each servo the moment in its joint.
    """
    tree, work, y, loads = motion.tree, motion.work, motion.state, motion.inputs.body_loads[1]
    n_q, n_u = tree.n_q, tree.n_u
    given, passing, of_air = 0.0, 0.0, 0.0
    for i in range(3):
        e.force[i] = 0.0
    for b in range(loads.shape[0]):
        rigid, elastic = 0.0, 0.0
        for i in range(3):
            rigid += loads[b, i] * work.v[b, i] + loads[b, 3 + i] * work.omega[b, i]
        for k in range(tree.n_elastic[b]):
            elastic += loads[b, 6 + k] * y[n_q + tree.elastic_u[b] + k]
        given += rigid + elastic
        passing += abs(rigid) + abs(elastic)
        if e.is_blade[b]:
            of_air += rigid + elastic
            for i in range(3):
                for k in range(3):
                    e.force[i] += work.rot[b, i, k] * loads[b, k]
    for i in range(n_u):
        power = motion.inputs.dof_force[1, i] * y[n_q + i]
        given += power
        passing += abs(power)
    for s in range(e.servo_body.shape[0]):
        moment = 0.0
        for i in range(3):
            moment += wrench[e.servo_body[s], 3 + i] * e.servo_axis[s, i]
        power = moment * y[n_q + n_u + tree.n_servo + s]
        given += power
        passing += abs(power)
    return given, passing, of_air, e.force[0] ** 2 + e.force[1] ** 2 + e.force[2] ** 2
