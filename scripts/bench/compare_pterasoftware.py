"""Compare the vortex lattice with PteraSoftware, side by side: wall time and lift of a wing set in motion at once.

    python scripts/bench/compare_pterasoftware.py --set-up      # makes an environment for PteraSoftware, then measures
    python scripts/bench/compare_pterasoftware.py --cases 4x16x40 --repeats 5 --json

Numbers of docs/performance.md. The wing is flat and rectangular, of aspect ratio 8 at 5 degrees. A case 4x16x40 has
4 x 16 panels of equal size on the whole wing (no symmetry) and 40 steps, in each of which the wing advances by the
chord of one panel. Both solvers, single-threaded and after compilation, solve at 40 instants: boundary condition,
forces on all panels, free wake with every row kept and moved by the velocity that all bound and wake rings induce;
cores of the wake are alike (3 % of the chord, Squire's coefficient 1e-4). Differences: PteraSoftware computes in
float64, convects the wake with first order and smooths its bound rings, too, with 3 % of the chord, which on fine
lattices raises the lift and is no option; wt_gym computes the velocity of the wake in float32 and all else in float64,
convects with second order and smooths bound rings with 1 % of a panel's chord. Time is that of the solver alone.

Lift is compared with linear lifting-surface theory at the same instant (straight wake; lattices of 8 and 16 panels a
chord, extrapolated). The steady value of the exact theory, CL = 0.4002, is not reached by short runs.

PteraSoftware is no dependency of wt_gym and is installed by --set-up alone, with --no-deps and only what its solver
needs (numpy, scipy, numba in the versions of the running Python, threadpoolctl, tqdm). Its plotting packages and MuJoCo
are imported but not used by the solver; empty modules stand in for those that are missing.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import time
import venv
from importlib import metadata, util
from pathlib import Path
from types import ModuleType

import numpy as np

PACKAGE = "pterasoftware==5.1.0"
NEEDED = ("numpy", "scipy", "numba", "llvmlite")  # in the versions of the running Python, so that compilers are equal
SMALL = ("threadpoolctl>=3.5,<4", "tqdm>=4.66,<5")
UNUSED = ("matplotlib", "matplotlib.pyplot", "pyvista", "webp", "mujoco")
CASES = ("2x16x80", "4x16x40", "4x16x80", "6x24x60", "8x32x40", "8x32x80")
ENVIRONMENT = Path.home() / ".cache" / "wt_gym" / "pterasoftware"

ASPECT, ANGLE_DEG = 8.0, 5.0  # chord 1 m, speed 1 m/s, density 1 kg/m^3
VISCOSITY, SQUIRE, CORE = 15.06e-6, 1e-4, 0.03  # the values built into PteraSoftware; core in chords
STEADY_LIFT = 0.4002  # converged lifting-surface theory for this wing
FIRST_CHORDS = 1.0  # errors over the history count from here; before, added mass and first steps dominate


def parse_case(text: str) -> tuple[int, int, int]:
    """Panels along chord and span, and steps, from a text like 4x16x40."""
    try:
        n_chord, n_span, n_steps = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form CHORDxSPANxSTEPS, such as 4x16x40") from None
    if n_chord < 1 or n_span < 1 or n_steps - 1 <= FIRST_CHORDS * n_chord:
        raise argparse.ArgumentTypeError(f"{text!r}: the wing must advance by more than {FIRST_CHORDS:g} chord")
    return n_chord, n_span, n_steps


def elapsed(wall: float, cpu: float) -> dict:
    """Wall and processor time since an instant [s]."""
    return {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}


# ---- PteraSoftware, in its own environment ----


def run_pterasoftware(n_chord: int, n_span: int, n_steps: int) -> dict:
    """Times and lift coefficients of PteraSoftware's unsteady ring vortex-lattice solver with a free wake."""
    for name in UNUSED:
        if util.find_spec(name.partition(".")[0]) is None:
            sys.modules[name] = ModuleType(name)
    import pterasoftware as ps

    section = ps.geometry.wing_cross_section.WingCrossSection
    flat = ps.geometry.airfoil.Airfoil(name="naca0012")  # its camber line, the lattice, is straight
    wing = ps.geometry.wing.Wing(
        wing_cross_sections=[
            section(airfoil=flat, num_spanwise_panels=n_span, chord=1.0, spanwise_spacing="uniform"),
            section(airfoil=flat, num_spanwise_panels=None, chord=1.0, Lp_Wcsp_Lpp=(0.0, ASPECT, 0.0)),
        ],
        num_chordwise_panels=n_chord,
        chordwise_spacing="uniform",
    )
    airplane = ps.geometry.airplane.Airplane(wings=[wing])
    point = ps.operating_point.OperatingPoint(rho=1.0, vCg__E=1.0, alpha=ANGLE_DEG, nu=VISCOSITY)
    moves = ps.movements
    still = [
        moves.wing_cross_section_movement.WingCrossSectionMovement(base_wing_cross_section=s)
        for s in wing.wing_cross_sections
    ]
    movement = moves.movement.Movement(
        airplane_movements=[
            moves.airplane_movement.AirplaneMovement(
                base_airplane=airplane,
                wing_movements=[moves.wing_movement.WingMovement(base_wing=wing, wing_cross_section_movements=still)],
            )
        ],
        operating_point_movement=moves.operating_point_movement.OperatingPointMovement(base_operating_point=point),
        delta_time=1.0 / n_chord,
        num_steps=n_steps,
    )
    problem = ps.problems.UnsteadyProblem(movement=movement)
    solver = ps.unsteady_ring_vortex_lattice_method.UnsteadyRingVortexLatticeMethodSolver(problem)
    start = time.perf_counter(), time.process_time()
    solver.run(prescribed_wake=False, calculate_streamlines=False, show_progress=False)
    times = elapsed(*start)
    lift = [-float(step.airplanes[0].forceCoefficients_W[2]) for step in problem.steady_problems]
    return {**times, "lift": lift}


# ---- wt_gym ----


class UniformWind:
    """The same velocity everywhere."""

    def __init__(self, velocity):
        self.vector = velocity

    def velocity(self, points, time):
        """Velocity at points (..., 3) [m/s]."""
        return np.broadcast_to(self.vector, points.shape)


def run_wt_gym(n_chord: int, n_span: int, n_steps: int, inset: bool = False) -> dict:
    """Times and lift coefficients of wt_gym's vortex lattice without viscous correction, everything fresh each step."""
    from wt_gym.aerodynamics import AeroOptions, VortexLattice, build_planform, span_distribution

    edges = span_distribution(0.0, ASPECT, n_span, 0.0, (0.25, 0.25) if inset else (0.0, 0.0))
    zero, one = np.zeros_like(edges), np.ones_like(edges)
    polars = np.zeros((n_span, 8, 3))  # of no consequence without viscous correction
    planform = build_planform(edges, np.stack([zero, zero, edges], -1), one, zero, zero, polars, n_chord)
    angle, dt = math.radians(ANGLE_DEG), 1.0 / n_chord
    stream = np.array([math.sin(angle), math.cos(angle), 0.0])
    upwards = np.array([stream[1], -stream[0], 0.0])
    nodes = planform.nodes[None].copy()
    still, wind, inflow = np.zeros_like(nodes), np.zeros_like(nodes) + stream, UniformWind(stream)
    options = AeroOptions(
        n_chord=n_chord, n_span=n_span, wake_rows=n_steps - 1, full_rows=n_steps - 1, fresh_rows=n_steps,
        far_wake=False, viscous=False, wake_core=CORE, squire=SQUIRE, viscosity=VISCOSITY,
    )  # fmt: skip
    start = time.perf_counter(), time.process_time()
    lattice = VortexLattice(planform, 1, options, 1.0)
    state = lattice.new_state()
    lattice.reset(state, nodes, still, wind)
    lift = [state.nodal_forces.sum(axis=(0, 1, 2)) @ upwards / (0.5 * ASPECT)]
    for k in range(n_steps - 1):
        lattice.convect_wake(state, inflow, k * dt, dt)
        forces = lattice.solve(state, nodes, still, wind, dt)
        lattice.accept(state)
        lift.append(forces.sum(axis=(0, 1, 2)) @ upwards / (0.5 * ASPECT))
    times = elapsed(*start)
    return {**times, "lift": [float(value) for value in lift]}


# ---- reference: linear theory ----


def half_span_panels(n: int) -> int:
    """Panels along half of the span for n panels along the chord: square ones."""
    return round(0.5 * ASPECT * n)


def linear_lift_slope(n: int, chords: float):
    """Lift slope of the wing after a sudden start by linear theory, from one lattice.

    The vortex rings of wing and straight wake lie in a plane, on one grid that the wake moves through by a panel a
    step, so the influence of a ring depends on the distance in panels only. In the plane a rectangular ring induces
    the normal velocity 1 / (4 pi) sum(+- hypot(x, y) / (x y)) over its corners.

    Parameters
    ----------
    n : int
        Panels along the chord.
    chords : float
        Way traveled in chords.

    Returns
    -------
    way, slope : ndarray, shape (n_steps + 1,)
        Way traveled in chords and dCL / dalpha [1/rad].
    """
    m, n_steps = half_span_panels(n), math.ceil(chords * n)
    size, width = 1.0 / n, 0.5 * ASPECT / half_span_panels(n)
    middle, edge = width * (np.arange(m) + 0.5), width * np.arange(m + 1)
    # Row d: a ring d - (n - 1) panels behind the collocation points; each half wing with its mirror image.
    ahead = size * (n - 1 - np.arange(n_steps + 2 * n) + 0.5)[:, None, None]
    rings = np.zeros((n_steps + 2 * n, m, m))
    for side in (1.0, -1.0):
        across = middle[:, None] - side * edge
        corner = np.hypot(ahead, across) / (ahead * across)
        behind = ahead - size
        corner -= np.hypot(behind, across) / (behind * across)
        rings += side * np.diff(corner, axis=2) / (4.0 * np.pi)
    row = np.arange(n)
    bound = rings[n - 1 - (row[:, None] - row)].transpose(0, 2, 1, 3).reshape(n * m, n * m)
    inverse = np.linalg.inv(bound)
    wake = np.zeros((n_steps + 1, m))
    gamma, before, earlier = np.zeros((3, n, m))
    slope = np.empty(n_steps + 1)
    for k in range(n_steps + 1):
        through = np.ones((n, m))
        for i in range(n):
            first = 2 * n - 1 - i
            through[i] += np.einsum("kij,kj->i", rings[first : first + k], wake[:k])
        gamma = -(inverse @ through.ravel()).reshape(n, m)
        rate = (1.5 * gamma - 2.0 * before + 0.5 * earlier if k > 1 else (gamma - before) * min(k, 1)) / size
        slope[k] = 4.0 * width * (gamma[-1].sum() + size * rate.sum()) / ASPECT
        before, earlier = gamma, before
        wake[1 : k + 1] = wake[:k].copy()
        wake[0] = gamma[-1]
    return size * np.arange(n_steps + 1), slope


def reference_lift(chords: float):
    """Lift coefficients of linear theory after a sudden start, extrapolated to panels of no size: way and CL."""
    coarse_way, coarse = linear_lift_slope(8, chords)
    way, fine = linear_lift_slope(16, chords)
    return coarse_way, math.radians(ANGLE_DEG) * (2.0 * np.interp(coarse_way, way, fine) - coarse)


# ---- processes ----


def environment_python(environment: Path) -> Path:
    """The interpreter of a virtual environment."""
    return environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def set_up(environment: Path) -> None:
    """Make the virtual environment and install PteraSoftware with what its solver needs."""
    print(f"installing {PACKAGE} into {environment}", file=sys.stderr, flush=True)
    venv.create(environment, with_pip=True)
    pinned = [f"{package}=={metadata.version(package)}" for package in NEEDED]
    for packages in (["--no-deps", PACKAGE], [*pinned, *SMALL]):
        command = [environment_python(environment), "-m", "pip", "install", "--quiet", *packages]
        subprocess.run(command, check=True)


WORKERS = {"pterasoftware": run_pterasoftware, "wt_gym": run_wt_gym}


def run_in_process(name: str, python: Path | str, case: tuple[int, int, int]) -> dict:
    """One run of a solver after compilation, in a process of one thread."""
    from speed import SINGLE_THREAD  # the other environment has no wt_gym

    command = [python, __file__, "--worker", name, "--cases", "x".join(map(str, case))]
    done = subprocess.run(command, env=os.environ | SINGLE_THREAD, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


# ---- the comparison ----


def compare(case: tuple[int, int, int], pythons: dict, repeats: int, way, reference) -> dict:
    """Median times of alternating runs, and errors of the lift."""
    n_chord, _, n_steps = case
    runs = {name: [] for name in pythons}
    for _ in range(repeats):
        for name, python in pythons.items():
            runs[name].append(run_in_process(name, python, case))
    instants = np.arange(n_steps) / n_chord
    exact, later = np.interp(instants, way, reference), instants >= FIRST_CHORDS
    solvers = {}
    for name, results in runs.items():
        error = np.array(results[-1]["lift"]) / exact - 1.0
        solvers[name] = {key: float(np.median([run[key] for run in results])) for key in ("wall_s", "cpu_s")} | {
            "final_lift": results[-1]["lift"][-1], "final_error": float(error[-1]),
            "largest_error": float(np.abs(error[later]).max()),
        }  # fmt: skip
    ratio = solvers["pterasoftware"]["wall_s"] / solvers["wt_gym"]["wall_s"]
    return {"case": "x".join(map(str, case)), "reference_lift": float(exact[-1]), "ratio": ratio, "solvers": solvers}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cases", nargs="+", type=parse_case, default=[parse_case(c) for c in CASES], metavar="CHORDxSPANxSTEPS",
        help=f"panels along chord and span, and steps (default: {' '.join(CASES)})",
    )  # fmt: skip
    parser.add_argument("--repeats", type=int, default=3, help="alternating runs of a case (default: %(default)s)")
    parser.add_argument("--environment", type=Path, default=ENVIRONMENT, help="of PteraSoftware (default: %(default)s)")
    parser.add_argument("--set-up", action="store_true", help=f"make the environment and install {PACKAGE} first")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    parser.add_argument("--worker", choices=tuple(WORKERS), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        solver = WORKERS[arguments.worker]
        solver(1, 4, 6)  # compiles
        print(json.dumps(solver(*arguments.cases[0])))
        return
    if arguments.set_up:
        set_up(arguments.environment)
    pythons = {"pterasoftware": environment_python(arguments.environment), "wt_gym": sys.executable}
    if not pythons["pterasoftware"].exists():
        raise SystemExit(f"error: {arguments.environment} must hold a Python environment, --set-up makes it")
    way, reference = reference_lift(max((steps - 1) / n_chord for n_chord, _, steps in arguments.cases))
    results = []
    print("errors of the lift against linear theory: at the end, and the largest from one chord of travel on")
    for case in arguments.cases:
        results.append(compare(case, pythons, arguments.repeats, way, reference))
        print(f"{results[-1]['case']}: wt_gym is {results[-1]['ratio']:.1f} times faster")
        for name, s in results[-1]["solvers"].items():
            print(
                f"  {name:14s} {s['wall_s']:8.4f} s, processor {s['cpu_s']:8.4f} s, CL {s['final_lift']:.4f}, errors "
                f"{100 * s['final_error']:+.2f} %, {100 * s['largest_error']:.2f} %",
                flush=True,
            )
    if arguments.json:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
