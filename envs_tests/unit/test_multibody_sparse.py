"""Factorizations: along the branches of a tree, and with row exchanges, against dense solutions."""

import numpy as np
import pytest

from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree.linear_algebra_kernels import factorize, solve_factorized
from wt_gym.multibody.tree.sparse_kernels import factorize_tree, multiply_tree, solve_tree
from wt_gym.structure.flexible_body import FlexibleBody

PARENT = np.array([-1, 0, 1, 1, 3, 0, 5, -1, 7])


def tree_matrix(parent, rng):
    """A positive definite matrix that is zero where no velocity lies on the way of the other."""
    n = len(parent)
    factor = np.zeros((n, n))
    for i in range(n):
        factor[i, i] = rng.uniform(0.5, 2.0)
        j = parent[i]
        while j >= 0:
            factor[i, j] = rng.normal()
            j = parent[j]
    return factor.T @ factor


def test_solution_and_product_are_those_of_the_dense_matrix():
    rng = np.random.default_rng(3)
    matrix, x = tree_matrix(PARENT, rng), rng.normal(size=len(PARENT))
    product = np.zeros(len(PARENT))
    multiply_tree(np.tril(matrix), PARENT, x, product)
    np.testing.assert_allclose(product, matrix @ x, rtol=1e-13)
    factor, b = np.tril(matrix), matrix @ x
    assert factorize_tree(factor, PARENT)
    solve_tree(factor, PARENT, b)
    np.testing.assert_allclose(b, x, rtol=1e-10)


def test_an_indefinite_matrix_is_refused():
    matrix = tree_matrix(PARENT, np.random.default_rng(4))
    matrix[3, 3] = -1.0
    assert not factorize_tree(np.tril(matrix), PARENT)


@pytest.fixture
def branched():
    """Two arms of two links each on a turning post."""
    system = MultibodySystem()
    link = FlexibleBody.rigid("link", 2.0, (0.0, 0.0, 0.5), np.diag([0.2, 0.2, 0.01]))
    hinge = {"axis": (0.0, 1.0, 0.0)}
    post = system.add(link, Joint("revolute", axis=(0.0, 0.0, 1.0), name="post"))
    for arm in ("left", "right"):
        inner = system.add(link, Joint("revolute", name=f"{arm}_1", offset=(0.1, 0.0, 1.0), **hinge), post)
        system.add(link, Joint("revolute", name=f"{arm}_2", offset=(0.0, 0.0, 1.0), **hinge), inner)
    return system.build()


def test_the_velocities_of_a_system_know_those_before_them(branched):
    np.testing.assert_array_equal(branched.tree.dof_parent, [-1, 0, 1, 0, 3])
    y = branched.initial_state()
    y[: branched.n_q] = 0.3, 0.5, -0.4, 1.0, 0.7
    work = branched.new_work()
    branched.rates(y, work=work)  # leaves the Cholesky factor of the mass matrix
    lower = np.tril(work.mass)
    mass = lower @ lower.T
    assert np.abs(mass[1:3, 3:5]).max() < 1e-12 * np.abs(mass).max()  # the arms do not know of each other


def test_row_exchanges_solve_where_pivots_vanish():
    rng = np.random.default_rng(5)
    matrix, x, order = rng.normal(size=(6, 6)), rng.normal(size=6), np.zeros(6, dtype=np.int64)
    matrix[0, 0] = matrix[1, 1] = 0.0
    factors, b = matrix.copy(), matrix @ x
    assert factorize(factors, order)
    solve_factorized(factors, order, b)
    np.testing.assert_allclose(b, x, rtol=1e-12)


def test_a_singular_matrix_is_refused_whatever_its_unit():
    matrix = np.random.default_rng(6).normal(size=(5, 5))
    matrix[4] = matrix[0] + matrix[1]
    for unit in (1e-12, 1.0, 1e12):
        assert not factorize(unit * matrix, np.zeros(5, dtype=np.int64))
