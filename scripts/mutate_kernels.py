#!/usr/bin/env python3
"""Named mutants of the physics, most of them in compiled kernels, against the tests that should notice them.

    scripts/mutate_kernels.py               # all, in some minutes
    scripts/mutate_kernels.py kutta wake    # those whose names hold one of the words
    scripts/mutate_kernels.py --list

A mutant is one edit of one file: a sign, a factor, an index that somebody might get wrong. It is made in a temporary
copy of the repository, where the tests that are named beside it run in a process of their own; they must fail. Kernels
run uncompiled there, which spares the minutes that a compilation takes: the tests are those on small arrays. Exit
status 1 if a mutant survives, 2 if an edit no longer fits the sources or tests fail without one.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
import types
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from mutate import ROOT, clone, noticed

UNIT, PHYSICS = "envs_tests/unit", "envs_tests/physics"
KERNELS, AERO = f"{UNIT}/test_kernels.py", f"{UNIT}/test_aerodynamics_kernels.py"
LAGRANGE = f"{PHYSICS}/test_multibody.py::test_equations_of_motion_are_those_of_lagrange[True]"
RING = f"{PHYSICS}/test_local_induction.py"
DRIVES, STEADY = f"{UNIT}/test_simulation_drives.py", f"{UNIT}/test_wind_inflows.py"
TREE, RATES = "wt_gym/multibody/tree/tree_kernels.py", "wt_gym/multibody/tree/rate_kernels.py"
ROTATION = "wt_gym/multibody/tree/rotation_kernels.py"
LATTICE, WAKE = "wt_gym/aerodynamics/lattice", "wt_gym/aerodynamics/wake"
STEP, WIND = "wt_gym/simulation/step", "wt_gym/wind/inflow_kernels.py"


class Mutant(NamedTuple):
    """One edit: ``old``, which stands in the file once, becomes ``new``; the tests must notice."""

    name: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = tuple(Mutant(*row) for row in (
    ("geared rotor without inertia", TREE, "mass[i, i] = tree.dof_inertia[i]", "mass[i, i] = 0.0", KERNELS),
    ("elastic Coriolis force halved", TREE, "work.one[i] = 2.0 * work.elastic_lin[i]",
     "work.one[i] = work.elastic_lin[i]", LAGRANGE),
    ("joint Coriolis acceleration halved", TREE, "work.one[i] + 2.0 * work.place_rate[i]",
     "work.one[i] + work.place_rate[i]", LAGRANGE),
    ("gyroscopic sign of an elastic pair", TREE, "w[2] * (work.coupling_slope[k, j, 2] - work.coupling_slope[j, k, 2])",
     "w[2] * (work.coupling_slope[j, k, 2] - work.coupling_slope[k, j, 2])", LAGRANGE),
    ("centrifugal force on modes doubled", TREE, "gyro - 0.5 * centrifugal", "gyro - centrifugal", LAGRANGE),
    ("second-order inertia counted whole", TREE, "half += 0.5 * j2", "half += j2", LAGRANGE),
    ("gravity upside down", TREE, "- rot[2, i] * tree.gravity[2]", "+ rot[2, i] * tree.gravity[2]", LAGRANGE),
    ("static moment turned round", TREE, "cross_add(a, mc, t)", "cross_add(mc, a, t)", LAGRANGE),
    ("column of a lever with the wrong index", TREE,
     "work.joint_vl[1, n_in] = work.marker_shape[1, e] + va2 * lever[0] - va0 * lever[2]",
     "work.joint_vl[1, n_in] = work.marker_shape[1, e] + va2 * lever[0] - va0 * lever[1]", LAGRANGE),
    ("damper pushes", RATES, "c * (ref_rate - yd[i])", "c * (ref_rate + yd[i])", KERNELS),
    ("quaternion rate turned round", RATES, "0.5 * (a * w0 + yy * w2 - z * w1)", "0.5 * (a * w0 - yy * w2 + z * w1)",
     KERNELS),
    ("servo misses its command", RATES, "(0.5 - turned) * change", "(1.0 - turned) * change", KERNELS),
    ("tangent of a rotation turned round", ROTATION, "tangent[i, j] -= c * t[k]", "tangent[i, j] += c * t[k]", KERNELS),
    ("bias of a rotation vector", ROTATION, "+ e1 * c2 - e2 * c1", "- e1 * c2 + e2 * c1", KERNELS),
    ("Kutta condition: newest row at half the way", f"{WAKE}/wake_kernels.py", "wake[0, b, j, c] + shed_fraction * way",
     "wake[0, b, j, c] + 2.0 * shed_fraction * way", KERNELS),
    ("wake leaves at the last ring", f"{WAKE}/wake_kernels.py",
     "0.25 * nodes[b, row - 1, column, c] + 0.75 * nodes[b, row, column, c]", "nodes[b, row, column, c]", KERNELS),
    ("wake convected by the wind alone", f"{WAKE}/wake_kernels.py",
     "velocity = a.wind[k, b, j, c] + a.induced[k, b, j, c]", "velocity = a.wind[k, b, j, c]", KERNELS),
    ("wake convected by Euler", f"{WAKE}/wake_kernels.py", "weight = 0.5 * ratio if k > 0 else 0.0",
     "weight = 0.0 * ratio", KERNELS),
    ("thinned rings by plain means", f"{WAKE}/wake_kernels.py", "share = behind / (behind + ahead)", "share = 0.5",
     KERNELS),
    ("tip vortex whose core does not grow", f"{WAKE}/sheet_kernels.py",
     "core = (core2 + spread * age[k]) * length2\n                    if o.strain:\n                        # rows",
     "core = core2 * length2\n                    if o.strain:\n                        # rows",
     f"{PHYSICS}/test_aerodynamics_options.py::test_cores_by_age_alone_do_not_feel_the_strain"),
    ("acceleration of a constraint turned round", "wt_gym/multibody/constraints/constraint_kernels.py",
     "lam[i] = -work.gamma[i]", "lam[i] = work.gamma[i]", KERNELS),
    ("lever of a constraint turned round", "wt_gym/multibody/constraints/constraint_kernels.py",
     "jl[1, 1, u] - jl[0, 1, u] - a2 * delta[0] + a0 * delta[2]",
     "jl[1, 1, u] - jl[0, 1, u] + a2 * delta[0] - a0 * delta[2]", KERNELS),
    ("Hamming's modifier left out", "wt_gym/multibody/integrators/integrator_kernels.py",
     "c[i] = p[i] + 112.0 / 9.0 * e[i]", "c[i] = p[i]",
     f"{PHYSICS}/test_multibody_integrators.py::test_hamming_matches_its_formulas"),
    ("circulation taken from the wrong ring", f"{LATTICE}/load_kernels.py", "strength -= gamma[b, i - 1, j]",
     "strength += gamma[b, i - 1, j]", KERNELS),
    ("lift against the suction side", f"{LATTICE}/load_kernels.py",
     "h = 0.5 * density * spanwise_strength", "h = -0.5 * density * spanwise_strength", KERNELS),
    ("unsteady circulation without the last half", f"{LATTICE}/load_kernels.py",
     "h = density * rate[r] * area[r] * part", "h = density * rate[r] * area[r]", KERNELS),
    ("unsteady pressure left out of Bernoulli", f"{LATTICE}/load_kernels.py", "(jump + part * area[r] * rate[r])",
     "(jump)", KERNELS),
    ("normals to the pressure side", f"{LATTICE}/bound_kernels.py", "nx, ny, nz = cy * sz - cz * sy,",
     "nx, ny, nz = cz * sy - cy * sz,", KERNELS),
    ("bound vortex turned round", f"{LATTICE}/bound_kernels.py", "u = k * (ly * z - lz * y)",
     "u = k * (lz * y - ly * z)", AERO + "::test_influence_of_the_bound_rings_is_that_of_their_segments"),
    ("core of a bound vortex without its length", f"{LATTICE}/bound_kernels.py",
     "soft = core2 * (lx * lx + ly * ly + lz * lz)", "soft = core2 * (lx * lx + ly * ly)",
     AERO + "::test_influence_of_the_bound_rings_is_that_of_their_segments"),
    ("free vortex with the wrong distance", "wt_gym/aerodynamics/induction/induction_kernels.py", "(pr + rr) *",
     "(pr + pr) *", AERO + "::test_straight_infinite_and_semi_infinite_vortex"),
    ("mean behind the disc over the radius", f"{WAKE}/wake_kernels.py", "weight = duration * (outer - inner)",
     "weight = duration", AERO + "::test_velocity_behind_the_disc_is_a_mean_over_area_and_one_passing"),
    ("core of a vortex ring", f"{WAKE}/local_induction_kernels.py", "CORE_CUT = 0.874", "CORE_CUT = 0.5", RING),
    ("self-induction backwards", f"{WAKE}/local_induction_kernels.py", "out[2] = factor * (ax * by - ay * bx)",
     "out[2] = factor * (ay * bx - ax * by)", RING),
    ("flow past the tower turned round", "wt_gym/aerodynamics/bodies/tower_kernels.py",
     "strength * (u - radial * x)", "strength * (u + radial * x)",
     AERO + "::test_tower_flow_vanishes_into_stagnation_and_doubles_beside"),
    ("tower of the base's diameter", "wt_gym/aerodynamics/bodies/tower_kernels.py",
     "radii[k - 1] + share * (radii[k] - radii[k - 1])", "radii[k - 1]",
     f"{PHYSICS}/test_bodies.py::test_tower_flow_is_the_doublet_of_the_local_diameter"),
    ("blades ahead by Euler", f"{STEP}/wind_kernels.py", "(1.5 * velocities[i, c] - 0.5 * earlier[i, c])",
     "velocities[i, c]", KERNELS),
    ("torque of the rotor from the wrong arm", f"{STEP}/coupling_kernels.py", "axis[1] * (rz * fx - rx * fz)",
     "axis[1] * (rx * fz - rz * fx)", KERNELS),
    ("clearance to the tower's axis", f"{STEP}/coupling_kernels.py", "math.hypot(ahead, beside) - radius",
     "math.hypot(ahead, beside)", KERNELS),
    ("tower's lean not seen by the tip", f"{STEP}/coupling_kernels.py", "(base[0] + s * (top[0] - base[0]))",
     "base[0]", KERNELS),
    ("deflection that sees the pitch", f"{STEP}/coupling_kernels.py", "-(cos * rest[0] + sin * rest[1])",
     "-(cos * rest[0] - sin * rest[1])", KERNELS),
    ("tower moment in the wrong heading", f"{STEP}/measurement_kernels.py", "cos * moment_y - sin * moment_x",
     "cos * moment_y + sin * moment_x", KERNELS),
    ("gear ratio left out", f"{STEP}/measurement_kernels.py", "generator_speed * indices.gear_ratio", "generator_speed",
     KERNELS),
    ("cube of one component", f"{STEP}/energy_kernels.py", "share[j] * v2 * v2**0.5",
     "share[j] * wind[b, 0, j, 0] ** 3", KERNELS),
    ("generator drives", "wt_gym/simulation/drivetrain/drive_kernels.py", "azimuth_u] = -moment", "azimuth_u] = moment",
     DRIVES),
    ("ideal pitch a whole step behind", "wt_gym/simulation/drivetrain/drive_kernels.py", "0.5 * step * rate",
     "step * rate", DRIVES),
    ("shear the other way", WIND, "math.exp(shear_exponent * math.log(z / hub_height))",
     "math.exp(-shear_exponent * math.log(z / hub_height))", STEADY),
    ("neighbor in the box forgotten", WIND,
     "u += near * fluctuation[t, j, iy, 0] + far * fluctuation[t, j, iy + 1, 0]",
     "u += (near + far) * fluctuation[t, j, iy, 0]",
     f"{UNIT}/test_wind_turbulence_box.py::test_interpolation_between_the_samples"),
    ("Coleman angle turns back", "wt_gym/control/sensors.py", "psi = [azimuth + 2.0 * math.pi / n_blades * b",
     "psi = [azimuth - 2.0 * math.pi / n_blades * b",
     f"{UNIT}/test_control_controllers.py::test_coordinates_of_the_fixed_frame_and_back"),
    ("rainflow by means", "wt_gym/analysis/metrics.py", "for span, _, count, _, _ in rainflow",
     "for _, span, count, _, _ in rainflow", f"{UNIT}/test_analysis_metrics.py::test_del_of_two_known_cycle_sizes"),
))  # fmt: skip


def misfits() -> list[str]:
    """What is wrong with the edits, as sentences: text that stands not once in its file, tests that are not there."""
    found = []
    for mutant in MUTANTS:
        count = (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.old)
        if count != 1:
            found.append(f"{mutant.name}: the text to be changed must stand in {mutant.file} once, found {count} times")
        file, _, test = mutant.tests.partition("::")
        if f"def {test.split('[')[0]}" not in (ROOT / file).read_text(encoding="utf-8"):
            found.append(f"{mutant.name}: there is no {mutant.tests}")
    return found


def interpret() -> None:
    """Have kernels run as the Python that they are, in this process and its forks."""
    compiled = importlib.import_module("wt_gym.base.compiled")
    compiled.kernel = lambda function=None, *_, **__: function or (lambda inner: inner)
    compiled.compiled_for = lambda function, _: function
    compiled.is_compiled = lambda *_: True
    compiled.was_compiled = lambda *_: True
    vectors = types.ModuleType("wt_gym.aerodynamics.induction.simd_kernels")
    vectors.WIDTH = width = 16
    vectors.load = lambda array, at: array.reshape(-1)[at : at + width].copy()
    vectors.store = lambda array, at, vector: array.reshape(-1).__setitem__(slice(at, at + width), vector)
    vectors.spread = lambda number: np.full(width, number, np.float32)
    vectors.reciprocal = lambda vector: np.float32(1.0) / vector
    vectors.reciprocal_root = lambda vector: np.float32(1.0) / np.sqrt(vector)
    sys.modules[vectors.__name__] = vectors


def main() -> int:
    """Run the mutants."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("words", nargs="*", help="parts of names; by default all mutants")
    parser.add_argument("--list", action="store_true", help="show the mutants and run nothing")
    chosen = parser.parse_args()
    mutants = [m for m in MUTANTS if not chosen.words or any(word in m.name for word in chosen.words)]
    if faults := misfits():
        print("\n".join(faults))
        return 2
    if chosen.list:
        print("\n".join(f"{mutant.name}: {mutant.file}, {mutant.tests}" for mutant in mutants))
        return 0
    survivors, begun = 0, time.monotonic()
    with clone("scipy.signal", "scipy.spatial.transform") as copy:
        interpret()
        quiet = ("-n", "0", "-W", "ignore", "-m", "slow or not slow")
        for tests in dict.fromkeys(mutant.tests for mutant in mutants):
            if noticed([*quiet, tests], 600.0):
                print(f"{tests} fails without a mutant")
                return 2
        for mutant in mutants:
            path = copy / mutant.file
            source = path.read_text(encoding="utf-8")
            path.write_text(source.replace(mutant.old, mutant.new), encoding="utf-8")
            killed = noticed([*quiet, mutant.tests], 600.0)
            path.write_text(source, encoding="utf-8")
            survivors += not killed
            print(f"{'killed  ' if killed else 'SURVIVED'} {mutant.name}", flush=True)
    print(f"{len(mutants)} mutants, {survivors} survived, {time.monotonic() - begun:.0f} s")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
