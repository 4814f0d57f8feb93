"""What a multibody system refuses at the door, and what it says."""

import numpy as np
import pytest

from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.constraints.descriptor import descriptor_form
from wt_gym.multibody.integrators.schemes import INTEGRATORS, HammingIntegrator, make_integrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.structure.flexible_body import FlexibleBody

REFLECTION = np.diag([1.0, 1.0, -1.0])


def box(name="box", mass=1.0, inertia=None):
    return FlexibleBody.rigid(name, mass, np.zeros(3), np.eye(3) if inertia is None else inertia)


def flying():
    """A free box."""
    system = MultibodySystem()
    system.add(box(), Joint("free", name="fly"))
    return system.build()


def tied():
    """Two free boxes welded together, with a consistent state."""
    system = MultibodySystem()
    system.add(box("first"), Joint("free", name="one"))
    system.add(box("second"), Joint("free", name="two"))
    system.add_constraint(Constraint("weld", offset=(1.0, 0.0, 0.0), name="glue"), 0, 1)
    y = system.build().initial_state()
    y[7] = 1.0
    return system, y


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"rotation": np.eye(2)}, r"rotation must be a rotation matrix \(3, 3\), got shape \(2, 2\)"),
        ({"rotation": 2.0 * np.eye(3)}, "not orthogonal"),
        ({"rotation": REFLECTION}, "reflection"),
        ({"rotation": np.full((3, 3), np.nan)}, "not orthogonal"),
        ({"rotation": "upright"}, "rotation must be numbers, got 'upright'"),
        ({"offset": (0.0, 0.0)}, "offset must be three finite numbers, got "),
        ({"offset": (0.0, 0.0, np.inf)}, "offset must be three finite numbers, got "),
        ({"axis": (1.0, 0.0)}, "axis must be three finite numbers, got "),
        ({"kind": "revolute", "axis": (1.0, 1.0, 0.0)}, "not a unit vector"),
        ({"stiffness": 5.0}, "stiffness must be 0, got 5.0: joint type 'fixed' does not support it; allowed: revolute"),
        ({"kind": "spherical", "damping": 5.0}, "damping must be 0, got 5.0: joint type 'spherical'"),
        ({"kind": "revolute", "servo_frequency": 5.0}, "servo_frequency must be 0, got 5.0: joint type 'revolute'"),
        ({"kind": "servo"}, "servo_frequency must be a finite number > 0, got 0.0"),
        ({"kind": "revolute", "stiffness": -1.0}, "stiffness must be a finite number >= 0, got -1.0"),
        ({"kind": "glue"}, "must be one of fixed, revolute"),
    ],
)
def test_malformed_joints(kwargs, message):
    with pytest.raises(MultibodyError, match=message):
        Joint(name="elbow", **kwargs)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"second_rotation": REFLECTION}, "second_rotation is a reflection"),
        ({"second_offset": (1.0,)}, "second_offset must be"),
        ({"servo_frequency": -2.0}, "servo_frequency must be a finite number >= 0, got -2.0"),
    ],
)
def test_malformed_constraints(kwargs, message):
    with pytest.raises(MultibodyError, match=message):
        Constraint(name="tie", **kwargs)


@pytest.mark.parametrize(
    ("mass", "inertia", "message"),
    [
        (-1.0, np.eye(3), "body 'box': mass must be a finite number >= 0, got -1.0"),
        (np.nan, np.eye(3), "body 'box': mass must be a finite number >= 0, got nan"),
        (1.0, np.diag([1.0, 1.0, -1.0]), "body 'box': its inertia is negative for a motion"),
        (1.0, np.array([[1.0, 3.0, 0.0], [3.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "its inertia is negative for a motion"),
        (1.0, np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "its inertia is not symmetric"),
    ],
)
def test_bodies_with_negative_inertia(mass, inertia, message):
    with pytest.raises(MultibodyError, match=message):
        MultibodySystem().add(box(mass=mass, inertia=inertia), Joint("free"))


def test_a_massless_body_is_allowed():
    """It carries a joint; what moves no mass at all shows in the assembled mass matrix."""
    MultibodySystem().add(box(mass=0.0, inertia=np.zeros((3, 3))), Joint("fixed"))


def test_names_that_occur_twice():
    system = MultibodySystem()
    for name in ("first", "second"):
        system.add(box(name), Joint("revolute", name="swing"))
    with pytest.raises(MultibodyError, match="occur twice: swing, swing_rate"):
        system.build()


def test_additions_to_a_built_system():
    system = flying()
    with pytest.raises(MultibodyError, match="'late' comes too late"):
        system.add(box("late"), Joint("free"))
    with pytest.raises(MultibodyError, match="'late' comes too late"):
        system.add_constraint(Constraint(name="late"), None, 0)


def test_use_before_build():
    system = MultibodySystem()
    system.add(box(), Joint("free"))
    for use in (
        lambda: system.rates(np.zeros(13)),
        lambda: system.energy(np.zeros(13)),
        system.initial_state,
        system.new_work,
        system.new_inputs,
        *(lambda name=name: make_integrator(name, system, 0.01) for name in INTEGRATORS),
    ):
        with pytest.raises(MultibodyError, match="not built yet"):
            use()


@pytest.mark.parametrize("factor", [1.1, 0.0, np.nan])
def test_quaternions_that_are_not_of_unit_length(factor):
    system = flying()
    y = system.initial_state()
    y[3:7] *= factor
    uses = [system.rates, system.energy, lambda y: descriptor_form(system, y)]
    uses += [make_integrator(name, system, 0.01).start for name in INTEGRATORS]
    uses += [lambda y: make_integrator("hamming", system, 0.01).start(y, check=False)]
    for use in uses:
        with pytest.raises(MultibodyError, match=f"body 'box': its quaternion .* has norm {factor:.9g}"):
            use(y)


def test_states_of_wrong_length_or_not_finite():
    system = flying()
    with pytest.raises(MultibodyError, match=r"state has shape \(12,\); must be \(13,\)"):
        system.rates(np.zeros(12))
    y = system.initial_state()
    y[7] = np.inf
    with pytest.raises(MultibodyError, match="not finite in fly_0_rate"):
        make_integrator("newmark", system, 0.01).start(y)


@pytest.mark.parametrize("name", list(INTEGRATORS))
def test_starts_off_the_constraints(name):
    system, y = tied()
    integrator = make_integrator(name, system, 0.01)
    y[7] += 0.01
    with pytest.raises(MultibodyError, match=r"constraint 'glue': its position residual is 0.01 m"):
        integrator.start(y)
    integrator.start(y, check=False)
    y[7] -= 0.01
    y[system.n_q + 6] = 0.5
    with pytest.raises(MultibodyError, match=r"constraint 'glue': its velocity residual is 0.5 m/s"):
        integrator.start(y)


def test_a_start_is_put_onto_the_constraints():
    """Residuals within the tolerance vanish at the start and stay so at every step."""
    system, y = tied()
    y[7] += 2e-6
    y[system.n_q + 5] = 2.0
    y[system.n_q + 11] = 2.0
    y[system.n_q + 7] = 2.0
    integrator = HammingIntegrator(system, 0.01)
    integrator.start(y)
    assert np.abs(system.constraint_residuals(integrator.state)[0]).max() < 1e-12
    for _ in range(200):
        integrator.advance()
        assert np.abs(integrator.work.residual).max() < 1e-9
        assert np.abs(integrator.work.residual_rate).max() < 1e-5


def test_stabilization_beyond_its_limit():
    system = MultibodySystem(stabilization=150.0)
    system.add(box("first"), Joint("free", name="one"))
    system.add_constraint(Constraint("ball", name="pin"), None, 0)
    system.build()
    with pytest.raises(MultibodyError, match=r"α = 150 1/s .* α h = 1.5; allowed with 3 corrector pass"):
        HammingIntegrator(system, 0.01).start(system.initial_state())
