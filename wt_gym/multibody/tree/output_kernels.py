"""Compiled quantities that follow from a known motion: energies, and the loads that the joints transmit."""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.tree.rotation_kernels import cross_add
from wt_gym.multibody.tree.tree_kernels import inertia_terms, kinematics


@kernel(separate=True)
def energies(y, tree, work):
    """Kinetic, elastic (bodies and joint springs about zero) and gravitational energy [J]; updates the kinematics."""
    n_q, n_u = tree.n_q, tree.n_u
    yd = y[n_q : n_q + n_u]
    kinematics(y, tree, work)
    inertia_terms(y, yd, tree, work)
    kinetic, elastic, potential = 0.0, 0.0, 0.0
    for b in range(tree.parent.shape[0]):
        v, w, mc, jj, rot = work.v[b], work.omega[b], work.first_moment[b], work.inertia[b], work.rot[b]
        m, nf, u0, q0 = tree.mass[b], tree.n_elastic[b], tree.elastic_u[b], tree.elastic_q[b]
        for i in range(3):
            work.one[i] = 0.0
        cross_add(w, mc, work.one)
        for i in range(3):
            kinetic += 0.5 * m * v[i] * v[i] + v[i] * work.one[i]
            center = m * work.r[b, i]
            for j in range(3):
                kinetic += 0.5 * w[i] * jj[i, j] * w[j]
                center += rot[i, j] * mc[j]
            potential -= tree.gravity[i] * center
        for k in range(nf):
            for i in range(3):
                kinetic += yd[u0 + k] * (v[i] * work.coupling_lin[b, i, k] + w[i] * work.coupling_ang[b, i, k])
            for j in range(nf):
                kinetic += 0.5 * yd[u0 + k] * work.elastic_mass[b, k, j] * yd[u0 + j]
                elastic += 0.5 * y[q0 + k] * tree.stiffness[b, k, j] * y[q0 + j]
    for i in range(n_u):
        kinetic += 0.5 * tree.dof_inertia[i] * yd[i] * yd[i]
        if tree.dof_stiffness[i] != 0.0:
            elastic += 0.5 * tree.dof_stiffness[i] * y[tree.dof_q[i]] ** 2
    if tree.added_body >= 0:
        kinetic += water_energy(tree.added_body, yd, tree, work)
    return kinetic, elastic, potential


@kernel
def water_energy(b, yd, tree, work):
    """Kinetic energy ½ νᵀ A ν [J] of the water that moves with body b, see `tree_kernels.water_inertia`."""
    velocity, spin, energy = work.one, work.two, 0.0
    for i in range(3):
        velocity[i], spin[i] = yd[tree.joint_u[b] + i], 0.0
        for j in range(3):
            spin[i] += work.rot[b, i, j] * work.omega[b, j]
    for i in range(3):
        for j in range(3):
            energy += 0.5 * velocity[i] * tree.added_mass[i, j] * velocity[j]
            energy += velocity[i] * tree.added_mass[i, 3 + j] * spin[j]
            energy += 0.5 * spin[i] * tree.added_mass[3 + i, 3 + j] * spin[j]
    return energy


@kernel(separate=True, distinct=True)
def joint_wrenches(y, acceleration, loads, tree, work, wrench):
    """Force and moment that each joint exerts on its body, at the body frame origin in body components.

    Inertia minus applied loads of the body plus what its children take through their joints (tip to root); a free body
    that a weld ties to another one counts as its child. Needs
    kinematics of the state y and servo accelerations up to date; ``acceleration`` is u̇ (n_u,), ``wrench`` (n_b, 6).
    """
    n_q = tree.n_q
    yd = y[n_q : n_q + tree.n_u]
    wrench[:, :] = 0.0
    a, al = work.acceleration, work.angular_acceleration
    inertia_terms(y, yd, tree, work)
    for b in range(tree.parent.shape[0] - 1, -1, -1):
        m, nf, mc, jj, h, rot = (
            tree.mass[b],
            tree.n_elastic[b],
            work.first_moment[b],
            work.inertia[b],
            work.bias_force[b],
            work.rot[b],
        )
        for i in range(3):
            a[i] = (
                work.bias_lin[b, i]
                - rot[0, i] * tree.gravity[0]
                - rot[1, i] * tree.gravity[1]
                - rot[2, i] * tree.gravity[2]
            )
            al[i] = work.bias_ang[b, i]
            for c in range(tree.n_col[b]):
                rate = acceleration[tree.cols[b, c]]
                a[i] += work.vl[b, i, c] * rate
                al[i] += work.va[b, i, c] * rate
        f, t = work.one, work.two
        for i in range(3):
            f[i] = m * a[i] + h[i] - loads[b, i]
            t[i] = jj[i, 0] * al[0] + jj[i, 1] * al[1] + jj[i, 2] * al[2] + h[3 + i] - loads[b, 3 + i]
            for k in range(nf):
                rate = acceleration[tree.elastic_u[b] + k]
                f[i] += work.coupling_lin[b, i, k] * rate
                t[i] += work.coupling_ang[b, i, k] * rate
        cross_add(al, mc, f)
        cross_add(mc, a, t)
        for i in range(3):
            wrench[b, i] += f[i]
            wrench[b, 3 + i] += t[i]
        p = tree.load_parent[b]
        if p >= 0:
            # into parent components: global difference of origins gives the lever
            pr = work.rot[p]
            for i in range(3):
                work.turn[i] = 0.0
                work.turn_rate[i] = 0.0
                work.place[i] = 0.0
                for j in range(3):
                    work.place[i] += pr[j, i] * (work.r[b, j] - work.r[p, j])
                    turn = pr[0, i] * rot[0, j] + pr[1, i] * rot[1, j] + pr[2, i] * rot[2, j]
                    work.turn[i] += turn * wrench[b, j]
                    work.turn_rate[i] += turn * wrench[b, 3 + j]
            cross_add(work.place, work.turn, work.turn_rate)
            for i in range(3):
                wrench[p, i] += work.turn[i]
                wrench[p, 3 + i] += work.turn_rate[i]
