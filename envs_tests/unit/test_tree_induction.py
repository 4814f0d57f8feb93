"""Induction by the tree code and by the register-blocked kernel, against sums in double precision."""

import os

import numpy as np
import pytest

from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.tree_induction import TreeInduction, split_direct, split_range
from wt_gym.aerodynamics.options import AerodynamicsError


def exact_velocity(sheet, points):
    """Velocity (3, n) of all segments of a sheet in float64, segment by segment."""
    sheet = sheet.astype(float)
    nodes = sheet[..., :3]
    pairs = [
        (nodes[:-1], nodes[1:], sheet[1:, ..., 3], sheet[1:, ..., 4]),
        (nodes[:, :, :-1], nodes[:, :, 1:], sheet[:, :, 1:, 5], sheet[:, :, 1:, 6]),
    ]
    start, end, strength, core = (
        np.concatenate([np.reshape(pair[i], (-1, 3) if i < 2 else -1) for pair in pairs]) for i in range(4)
    )
    velocity = np.empty(points.shape)
    for i, point in enumerate(points.T.astype(float)):
        r1, r2 = point - start, point - end
        d1, d2 = np.linalg.norm(r1, axis=1), np.linalg.norm(r2, axis=1)
        below = d1 * d2 * (d1 * d2 + (r1 * r2).sum(axis=1)) + core
        velocity[:, i] = (strength * (d1 + d2) / below) @ np.cross(r1, r2)
    return velocity


def add_cores(sheet, radius):
    """Write core radius times length, squared, of each segment; the radius in meters, scalar or one for each node."""
    nodes = sheet[..., :3]
    radius2 = np.broadcast_to(np.square(radius), sheet.shape[:-1])
    sheet[1:, ..., 4] = radius2[1:] * ((nodes[1:] - nodes[:-1]) ** 2).sum(axis=-1)
    sheet[:, :, 1:, 6] = radius2[:, :, 1:] * ((nodes[:, :, 1:] - nodes[:, :, :-1]) ** 2).sum(axis=-1)


def helical_wake(n_row, n_node):
    """Sheet of a three-bladed rotor's wake, slightly disturbed, axis along x; every segment is shared by its rings."""
    rng = np.random.default_rng(1)
    radius = 63.0
    angle = np.radians(7.5) * np.arange(n_row)[:, None, None] + np.zeros((1, 3, n_node))
    blade = (2.0 * np.pi / 3.0 * np.arange(3))[None, :, None]
    share = (np.arange(n_node) / (n_node - 1))[None, None, :]
    r = 1.5 + (radius - 1.5) * share
    nodes = np.stack([7.0 * angle * (1.0 - 0.2 * share), r * np.sin(blade - angle), r * np.cos(blade - angle)], axis=-1)
    nodes += 0.2 * rng.standard_normal(nodes.shape)
    middle = 0.5 * (share[..., 1:] + share[..., :-1])
    ring = 60.0 * np.sqrt(1.0 - middle**6) * (1.0 + 0.1 * np.sin(angle[:-1, :, 1:] + blade))
    trail, span = np.zeros((n_row, 3, n_node)), np.zeros((n_row, 3, n_node))
    trail[1:, :, 1:] += ring
    trail[1:, :, :-1] -= ring
    span[:-1, :, 1:] += ring
    span[1:, :, 1:] -= ring
    sheet = np.ones((n_row, 3, n_node, 7))
    sheet[..., :3] = nodes
    sheet[..., 3] = trail / (4.0 * np.pi)
    sheet[..., 5] = span / (4.0 * np.pi)
    add_cores(sheet, 0.3 + 0.2 * angle)
    return sheet.astype(np.float32)


def random_cloud(n_row=60, n_sheet=2, n_node=14):
    """Sheet of random walks: segments of all directions and strengths, not closed into rings."""
    rng = np.random.default_rng(2)
    nodes = np.cumsum(rng.standard_normal((n_row, n_sheet, n_node, 3)), axis=0)
    nodes = nodes + np.cumsum(2.0 * rng.standard_normal((1, n_sheet, n_node, 3)), axis=2)
    sheet = np.ones((n_row, n_sheet, n_node, 7))
    sheet[..., :3] = 3.0 * nodes
    sheet[..., 3] = rng.standard_normal(sheet.shape[:-1])
    sheet[..., 5] = rng.standard_normal(sheet.shape[:-1])
    add_cores(sheet, 1.0)
    return sheet.astype(np.float32)


def some_targets(sheet, n=400):
    """Nodes of the sheet, points among them and points up to five times as far out."""
    rng = np.random.default_rng(3)
    nodes = sheet[..., :3].reshape(-1, 3)
    center, size = nodes.mean(axis=0), np.abs(nodes - nodes.mean(axis=0)).max(axis=0)
    on = nodes[rng.choice(len(nodes), n // 2, replace=False)]
    inside = center + size * rng.uniform(-1.0, 1.0, (n // 4, 3))
    outside = center + size * rng.uniform(-5.0, 5.0, (n - n // 2 - n // 4, 3))
    return np.ascontiguousarray(np.concatenate([on, inside, outside]).T.astype(np.float32))


def tree_velocity(sheet, targets, limit, n_threads=1):
    """Velocity (3, n) by the tree code."""
    velocity = np.zeros_like(targets)
    tree = TreeInduction(*sheet.shape[:3], targets.shape[1], n_threads)
    tree.add_velocity(sheet, targets, velocity, limit)
    return velocity


def rms(vectors):
    """Root mean square length of vectors (3, n)."""
    return np.sqrt((vectors**2).sum(axis=0).mean())


def mean_speed(velocity):
    """Mean length of vectors (3, n)."""
    return np.linalg.norm(velocity, axis=0).mean()


SHEETS = {"helix": helical_wake(80, 20), "cloud": random_cloud()}


@pytest.mark.parametrize("name", SHEETS)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_the_error_of_the_tree_is_as_ordered(name, tolerance):
    sheet = SHEETS[name]
    targets = some_targets(sheet)
    exact = exact_velocity(sheet, targets)
    mean = mean_speed(exact)
    velocity = tree_velocity(sheet, targets, tolerance * mean)
    assert rms(velocity - exact) < tolerance * mean


@pytest.mark.parametrize("name", SHEETS)
def test_direct_sums_in_single_precision_are_good_to_one_part_in_a_hundred_thousand(name):
    sheet = SHEETS[name]
    targets = some_targets(sheet)
    exact = exact_velocity(sheet, targets)
    velocity = np.zeros_like(targets)
    direct_induction(sheet, targets, velocity, 0, targets.shape[1], np.zeros(128 * 20, dtype=np.float32))
    assert rms(velocity - exact) < 1e-5 * rms(exact)


def test_clusters_do_act_and_spare_most_segments():
    sheet = helical_wake(600, 10)
    targets = np.ascontiguousarray(sheet[..., :3].reshape(-1, 3).T)
    some = slice(None, None, 37)
    exact = exact_velocity(sheet, targets[:, some])
    tree = TreeInduction(*sheet.shape[:3], targets.shape[1])
    velocity = np.zeros_like(targets)
    tree.add_velocity(sheet, targets, velocity, 1e-3 * mean_speed(exact))
    assert rms(velocity[:, some] - exact) < 1e-3 * mean_speed(exact)
    # A cluster costs about as much as one node with its two segments.
    clusters, tiles = tree.blocks[0].acted / (targets.shape[1] / 16)
    assert 0 < clusters + 9 * tiles < 0.1 * targets.shape[1]


@pytest.mark.parametrize("shape", [(1, 1, 2), (2, 1, 1), (4, 3, 7), (3, 1, 3)])
@pytest.mark.parametrize("n", [1, 15, 65])
def test_sheets_and_target_lists_of_any_size(shape, n):
    sheet = np.ascontiguousarray(random_cloud()[: shape[0], : shape[1], : shape[2]])
    targets = np.ascontiguousarray(np.random.default_rng(4).uniform(-20.0, 20.0, (3, n)).astype(np.float32))
    exact = exact_velocity(sheet, targets)
    assert tree_velocity(sheet, targets, 1e-6) == pytest.approx(exact, abs=1e-4 * np.abs(exact).max())


def test_velocity_is_added():
    sheet = SHEETS["cloud"]
    targets = some_targets(sheet, 64)
    velocity = np.ones_like(targets)
    TreeInduction(*sheet.shape[:3], 64).add_velocity(sheet, targets, velocity, 1e-3)
    assert velocity == pytest.approx(1.0 + tree_velocity(sheet, targets, 1e-3), abs=1e-5)


def test_a_broken_position_shows():
    sheet = SHEETS["cloud"].copy()
    targets = some_targets(sheet, 64)
    targets[1, 7] = np.nan
    broken = np.isnan(tree_velocity(sheet, targets, 1e-3)).any(axis=0)
    assert np.flatnonzero(broken).tolist() == [7]
    sheet[20, 1, 3, 0] = np.nan
    assert np.isnan(tree_velocity(sheet, some_targets(sheet, 64), 1e-3)).all()


def test_threads_give_the_same_numbers():
    sheet = SHEETS["helix"]
    targets = some_targets(sheet)
    assert np.array_equal(tree_velocity(sheet, targets, 1e-3), tree_velocity(sheet, targets, 1e-3, n_threads=3))
    one, two = np.zeros_like(targets), np.zeros_like(targets)
    split_direct(sheet, targets, one, np.zeros((1, 128 * 20), dtype=np.float32))
    split_direct(sheet, targets, two, np.zeros((2, 128 * 20), dtype=np.float32))
    assert np.array_equal(one, two)


def test_threads_work_after_a_fork():
    seen = np.zeros(10)

    def part(first, last, thread):
        seen[first:last] += 1.0

    split_range(part, 10, 3, 2)
    child = os.fork()
    if child == 0:
        split_range(part, 10, 3, 2)
        os._exit(0 if (seen == 2.0).all() else 1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0


def test_calls_beyond_the_work_arrays_are_refused():
    tree = TreeInduction(4, 1, 4, 10)
    sheet = np.zeros((8, 1, 4, 7), dtype=np.float32)
    with pytest.raises(AerodynamicsError, match="6 tiles and 5 targets"):
        tree.add_velocity(sheet, np.zeros((3, 5), np.float32), np.zeros((3, 5), np.float32), 1e-3)
    with pytest.raises(AerodynamicsError, match="11 targets"):
        tree.add_velocity(sheet[:4], np.zeros((3, 11), np.float32), np.zeros((3, 11), np.float32), 1e-3)
    with pytest.raises(AerodynamicsError, match="must be positive"):
        tree.add_velocity(sheet[:4], np.zeros((3, 5), np.float32), np.zeros((3, 5), np.float32), 0.0)
    with pytest.raises(AerodynamicsError, match="n_row is 0"):
        TreeInduction(0, 1, 4, 10)
