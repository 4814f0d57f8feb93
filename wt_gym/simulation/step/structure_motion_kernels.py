"""What a structure is to the air: something that moves on through an aerodynamic step and can be taken back.

The step (`wt_gym.simulation.step.coupled_step_kernels`) knows a `Structure` by these kernels alone:

- `save_motion` keeps the motion at the start of an aerodynamic step, `restore_motion` returns to it;
- `move_structure` moves on to the end of the step under the loads of the inputs, and leaves the structural steps in the
  trail of the work arrays;
- `end_motion` gives the accelerations under the final loads;
- `move_lattice` places the lattice.

After each of them the newest state of the turbine's multibody system and its rates stand in ``structure.motion``, where
lattice, gauges, monitor and energy balance read them, whatever owns the motion. The forms are told apart by the members
of `Structure` that are None: they are arguments of their own below, by whose types the compiler drops what does not
apply.
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.integrators.advance_kernels import advance, end_rates
from wt_gym.multibody.tree.tree_kernels import OK, kinematics
from wt_gym.simulation.step.coupling_kernels import rotor_motion
from wt_gym.simulation.step.observer_motion_kernels import end_frames, move_frames, restore_frames, save_frames


@kernel
def save_motion(structure):
    """Keep the motion at the start of an aerodynamic step; structure: `Structure`."""
    save_by(structure.observed, structure)


@kernel
def save_by(observed, structure):
    """As `save_motion`, of the form that the type of the first argument tells."""
    if observed is not None:
        save_frames(structure.motion, observed)
    else:
        copy_history(structure.history, structure.saved)


@kernel
def restore_motion(structure):
    """Return to the motion that `save_motion` has kept; a code."""
    return restore_by(structure.observed, structure)


@kernel
def restore_by(observed, structure):
    """As `restore_motion`, of the form that the type of the first argument tells."""
    if observed is not None:
        return restore_frames(structure.motion, observed)
    copy_history(structure.saved, structure.history)
    return OK


@kernel
def copy_history(source, target):
    """What an integration continues from, from one set of arrays to another."""
    for k in range(source.y.shape[0]):
        for i in range(source.y.shape[1]):
            target.y[k, i] = source.y[k, i]
            target.f[k, i] = source.f[k, i]
    for i in range(source.memory.shape[0]):
        target.memory[i] = source.memory[i]
    for i in range(source.counters.shape[0]):
        target.counters[i] = source.counters[i]


@kernel(separate=True)
def move_structure(structure, scheme, rough):
    """Move the structure through one aerodynamic step, without the rates at its end.

    Parameters
    ----------
    structure : Structure
    scheme : Scheme
    rough : bool
        Whether the motion only has to tell where the blades will be.

    Returns
    -------
    int
        A code of the multibody kernels.
    """
    return move_by(structure.observed, structure, scheme, rough)


@kernel
def move_by(observed, structure, scheme, rough):
    """As `move_structure`, of the form that the type of the first argument tells."""
    s, m = structure, structure.motion
    if observed is not None:
        return move_frames(m, observed, scheme)
    return advance(s.method, s.history, m.inputs, m.tree, m.work, scheme.h, scheme.n_sub, scheme.n_corrections, rough,
                   s.constrained)  # fmt: skip


@kernel(separate=True)
def end_motion(structure):
    """Rates that belong to the newest state and the loads at the end of the step, and the kinematics; a code."""
    return end_by(structure.observed, structure)


@kernel
def end_by(observed, structure):
    """As `end_motion`, of the form that the type of the first argument tells."""
    s, m = structure, structure.motion
    if observed is not None:
        return end_frames(m, observed)
    return end_rates(s.method, s.history, m.inputs, m.tree, m.work, m.state, m.rate, s.constrained)


@kernel(separate=True, distinct=True)
def move_lattice(y, tree, work, x):
    """Lattice nodes and their velocities for the state y, whose kinematics are then up to date; x: `CouplingData`."""
    kinematics(y, tree, work)
    for i in range(x.elastic.shape[0]):
        for k in range(x.elastic.shape[1]):
            x.elastic[i, k] = y[x.elastic_q[i, k]]
            x.elastic_rate[i, k] = y[x.elastic_u[i, k]]
    shape = (x.nodes.shape[0], x.nodes.shape[1] * x.nodes.shape[2], 3)
    rotor_motion(work.rot, work.r, work.v, work.omega, x.elastic, x.elastic_rate, x.points, x.lattice_bodies,
                 x.sub_bodies, x.nodes.reshape(shape), x.velocities.reshape(shape))  # fmt: skip
