"""Measure the induction kernels: segments a second, single-precision error, direct sums against the tree.

    python scripts/bench/induction.py
    python scripts/bench/induction.py --segments 1000 10000 --tolerance 1e-4 --json

Numbers of docs/performance.md. All of it runs in one process on one thread. Calls that are compared run in turns; times
are processor time, and the shortest of several runs counts, because other load on the machine only adds time.
"""

import argparse
import json
import time

import numpy as np

from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
from wt_gym.aerodynamics.induction.tree_induction import TreeInduction

# Rows, nodes of one blade and azimuth step [deg] of the wakes, by number of segments.
WAKES = {
    1_000: (23, 8, 15.0),
    3_000: (44, 12, 12.0),
    10_000: (101, 17, 7.5),
    30_000: (257, 20, 7.5),
    100_000: (576, 29, 7.5),
    300_000: (1440, 35, 5.0),
    1_000_000: (4100, 41, 3.0),
}
ALL_TARGETS = 60_000  # segments up to which direct summation is done for all targets
SAMPLE = 2048  # targets otherwise, and targets at which the error is taken


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segments", nargs="+", type=int, default=list(WAKES), choices=list(WAKES), help="wake sizes")
    parser.add_argument(
        "--tolerance", nargs="+", type=float, default=[1e-3], help="errors by mean velocity (default: 1e-3)"
    )
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    return parser.parse_args()


# ---- wakes and targets ----


def helical_wake(n_row: int, n_node: int, step: float) -> np.ndarray:
    """Sheet (n_row, 3, n_node, 7) of a wake like that of the NREL 5-MW rotor near its rated point."""
    rng = np.random.default_rng(0)
    angle = step * np.arange(n_row)[:, None, None] + np.zeros((1, 3, n_node))
    blade = (2.0 * np.pi / 3.0 * np.arange(3))[None, :, None]
    share = (0.5 - 0.5 * np.cos(np.pi * np.arange(n_node) / (n_node - 1)))[None, None, :]
    far = np.tanh(angle / 6.0)
    r = (1.5 + 61.5 * share) * (1.0 + 0.2 * far)
    x = 8.0 * angle * (1.0 - 0.3 * far) * (1.0 - 0.1 * share)
    nodes = np.stack([x, r * np.sin(blade - angle), r * np.cos(blade - angle)], axis=-1)
    nodes += 0.5 * np.tanh(angle / 10.0)[..., None] * rng.standard_normal(nodes.shape)
    middle = 0.5 * (share[..., 1:] + share[..., :-1])
    ring = 60.0 * np.sqrt(1.0 - middle**8) * (1.0 - np.exp(-8.0 * middle))
    ring = ring * (1.0 + 0.1 * np.sin(0.3 * angle[:-1, :, 1:] + blade))
    trail, span = np.zeros((n_row, 3, n_node)), np.zeros((n_row, 3, n_node))
    trail[1:, :, 1:] += ring
    trail[1:, :, :-1] -= ring
    span[:-1, :, 1:] += ring
    span[1:, :, 1:] -= ring
    radius2 = 0.09 + 5e-3 * np.abs(trail) * angle / 1.2
    sheet = np.ones((n_row, 3, n_node, 7))
    sheet[..., :3] = nodes
    sheet[..., 3] = trail / (4.0 * np.pi)
    sheet[..., 5] = span / (4.0 * np.pi)
    sheet[1:, ..., 4] = radius2[1:] * ((nodes[1:] - nodes[:-1]) ** 2).sum(axis=-1)
    sheet[:, :, 1:, 6] = radius2[:, :, 1:] * ((nodes[:, :, 1:] - nodes[:, :, :-1]) ** 2).sum(axis=-1)
    return sheet.astype(np.float32)


def segment_count(sheet: np.ndarray) -> int:
    """Segments of a sheet."""
    n_row, n_sheet, n_node, _ = sheet.shape
    return (n_row - 1) * n_sheet * n_node + n_row * n_sheet * (n_node - 1)


def nodes_as_targets(sheet: np.ndarray, multiple: int) -> np.ndarray:
    """All nodes of a sheet as targets (3, n), the first ones repeated up to a multiple."""
    nodes = sheet[..., :3].reshape(-1, 3).T
    n = -(-nodes.shape[1] // multiple) * multiple
    return np.ascontiguousarray(nodes[:, np.arange(n) % nodes.shape[1]])


def exact_velocity(sheet: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Velocity (3, n) of all segments of a sheet at points (3, n) in double precision."""
    sheet = sheet.astype(float)
    nodes = sheet[..., :3]
    pairs = (
        (nodes[:-1], nodes[1:], sheet[1:, ..., 3], sheet[1:, ..., 4]),
        (nodes[:, :, :-1], nodes[:, :, 1:], sheet[:, :, 1:, 5], sheet[:, :, 1:, 6]),
    )
    velocity = np.zeros(points.shape)
    for start, end, strength, core in pairs:
        for i, point in enumerate(points.T.astype(float)):
            r1, r2 = point - start, point - end
            d1, d2 = np.linalg.norm(r1, axis=-1), np.linalg.norm(r2, axis=-1)
            factor = strength * (d1 + d2) / (d1 * d2 * (d1 * d2 + (r1 * r2).sum(axis=-1)) + core)
            velocity[:, i] += (factor[..., None] * np.cross(r1, r2)).sum(axis=(0, 1, 2))
    return velocity


# ---- measurements ----


def shortest(calls: dict, repeats: int, clock=time.thread_time) -> dict:
    """Shortest time of each call [s]; the calls take turns."""
    best = dict.fromkeys(calls, np.inf)
    for call in calls.values():
        call()  # compiles, and fills the caches
    for _ in range(repeats):
        for name, call in calls.items():
            start = clock()
            call()
            best[name] = min(best[name], clock() - start)
    return best


def measure_kernels() -> dict:
    """Speed of the direct kernels and their error against double precision."""
    sheet = helical_wake(100, 13, np.radians(7.5))
    targets = nodes_as_targets(sheet, WIDTH)[:, : 60 * WIDTH].copy()
    velocity = np.zeros_like(targets)
    scratch = np.zeros(8 * 13 * WIDTH, dtype=np.float32)
    calls = {
        "direct": lambda: direct_induction(sheet, targets, velocity, 0, targets.shape[1], scratch),
    }
    best = shortest(calls, 200)
    interactions = segment_count(sheet) * targets.shape[1]
    figures = {"direct_segments_per_s": interactions / best["direct"]}
    picked = np.ascontiguousarray(targets[:, ::3])
    exact = exact_velocity(sheet, picked)
    velocity[:] = 0.0
    calls["direct"]()
    error = velocity[:, ::3] - exact
    figures["direct_relative_rms_error"] = float(np.sqrt((error**2).sum() / (exact**2).sum()))
    return figures


def measure_tree(n_segments: int, tolerance: float) -> dict:
    """Time and error of the tree against direct sums, for a wake with all its nodes as targets."""
    n_row, n_node, step = WAKES[n_segments]
    sheet = helical_wake(n_row, n_node, np.radians(step))
    targets = nodes_as_targets(sheet, WIDTH)
    n = targets.shape[1]
    segments = segment_count(sheet)
    rng = np.random.default_rng(1)
    picked = rng.choice(n, min(n, SAMPLE), replace=False)
    few = np.ascontiguousarray(targets[:, picked if segments > ALL_TARGETS else slice(None)])
    direct = np.zeros_like(few)
    scratch = np.zeros(8 * WIDTH * n_node, dtype=np.float32)
    direct_induction(sheet, few, direct, 0, few.shape[1], scratch)
    mean = float(np.linalg.norm(direct, axis=0).mean())
    exact = direct.copy() if segments > ALL_TARGETS else direct[:, picked]
    tree = TreeInduction(n_row, 3, n_node, n)
    velocity = np.zeros_like(targets)
    calls = {
        "direct": lambda: direct_induction(sheet, few, direct, 0, few.shape[1], scratch),
        "tree": lambda: tree.add_velocity(sheet, targets, velocity, tolerance * mean),
    }
    best = shortest(calls, max(2, min(50, 1_000_000 // segments)))
    velocity[:] = 0.0
    tree.blocks[0].acted[:] = 0
    calls["tree"]()
    error = np.linalg.norm(velocity[:, picked] - exact, axis=0)
    return {
        "segments": segments,
        "targets": n,
        "tolerance": tolerance,
        "direct_s": best["direct"] * n / few.shape[1],
        "tree_s": best["tree"],
        "speedup": best["direct"] * n / few.shape[1] / best["tree"],
        "rms_error_by_mean_velocity": float(np.sqrt((error**2).mean())) / mean,
        "largest_error_by_mean_velocity": float(error.max()) / mean,
        "clusters_per_target": float(tree.blocks[0].acted[0] * WIDTH / n),
        "near_tiles_per_target": float(tree.blocks[0].acted[1] * WIDTH / n),
    }


def main() -> None:
    """Measure and print."""
    arguments = parse_arguments()
    kernels = measure_kernels()
    print(
        f"direct kernel: {kernels['direct_segments_per_s'] / 1e9:.2f}e9 segments/s,"
        f" error {kernels['direct_relative_rms_error']:.1e} relative rms against float64"
    )
    rows = []
    print("segments  targets   direct s     tree s  speedup  tolerance  rms error  max error  clusters  near tiles")
    for tolerance in arguments.tolerance:
        for n_segments in arguments.segments:
            row = measure_tree(n_segments, tolerance)
            rows.append(row)
            print(
                f"{row['segments']:8d} {row['targets']:8d} {row['direct_s']:10.3g} {row['tree_s']:10.3g}"
                f" {row['speedup']:8.1f} {tolerance:10.0e} {row['rms_error_by_mean_velocity']:10.1e}"
                f" {row['largest_error_by_mean_velocity']:10.1e} {row['clusters_per_target']:9.0f}"
                f" {row['near_tiles_per_target']:11.0f}",
                flush=True,
            )
    print(
        "(time of one evaluation at all nodes of the wake; direct sums above"
        f" {ALL_TARGETS} segments are timed on {SAMPLE} targets; errors by the mean induced velocity)"
    )
    if arguments.json:
        print(json.dumps({"kernels": kernels, "tree": rows}))


if __name__ == "__main__":
    main()
