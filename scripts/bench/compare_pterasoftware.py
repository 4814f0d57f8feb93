"""Compare the vortex lattice with PteraSoftware, side by side in one run: wall time and lift of a wing set in motion.

    python scripts/bench/compare_pterasoftware.py --set-up              # makes the environment, then measures
    python scripts/bench/compare_pterasoftware.py --cases 4x16x40 --repeats 5 --json
    python scripts/bench/compare_pterasoftware.py --environment ~/venvs/ptera   # any environment that has pterasoftware

The case is a flat rectangular wing of aspect ratio 8 at 5 degrees, set in motion at once. A case 4x16x40 has 4 x 16
panels of equal size on the whole wing (no symmetry) and 40 steps, in each of which the wing advances by the chord of
one panel. Both solvers, single-threaded and after compilation, solve at 40 instants: boundary condition, forces on all
panels, free wake with every row kept and moved by the velocity that all bound and wake rings induce; cores of the wake
are alike (3 % of the chord, Squire's coefficient 1e-4). What differs: PteraSoftware computes in float64, convects the
wake with first order and smooths its bound rings, too, with 3 % of the chord, which on fine lattices raises the lift
and is no option; wt_gym computes the velocity of the wake in float32 and all else in float64, convects with second
order and smooths bound rings with 1 % of a panel's chord. Time is that of the solver alone; building geometry and
movement is listed as set-up. On a busy machine look at the processor times.

Lift is compared with linear lifting-surface theory at the same instant (straight wake; lattices of 8 and 16 panels a
chord, extrapolated) and with the steady value of the exact theory, CL = 0.4002, which short runs do not reach.
A third row is wt_gym with the outer edges of the lattice a quarter panel inside the tips, as it builds blades.

PteraSoftware is no dependency of wt_gym and is never installed but by --set-up: with --no-deps and only what its
solver needs (numpy, scipy, numba in the versions of the running Python, threadpoolctl, tqdm). Its plotting packages and
MuJoCo (pyvista, webp, matplotlib, mujoco) are imported but not used by the solver; empty modules stand in for those
that are missing.
"""

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
import venv
from functools import cache
from importlib import metadata, util
from pathlib import Path
from types import ModuleType

PACKAGE = "pterasoftware==5.1.0"
NEEDED = ("numpy", "scipy", "numba", "llvmlite")  # in the versions of the running Python, so that compilers are equal
SMALL = ("threadpoolctl>=3.5,<4", "tqdm>=4.66,<5")
UNUSED = ("matplotlib", "matplotlib.pyplot", "pyvista", "webp", "mujoco")
CASES = ("2x16x80", "4x16x40", "4x16x80", "6x24x60", "8x32x40", "8x32x80")

ASPECT, ANGLE_DEG = 8.0, 5.0  # chord 1 m, speed 1 m/s, density 1 kg/m^3
VISCOSITY, SQUIRE, CORE = 15.06e-6, 1e-4, 0.03  # the values built into PteraSoftware; core in chords
STEADY_LIFT = 0.4002  # converged lifting-surface theory for this wing
FIRST_CHORDS = 1.0  # errors over the history count from here; before, added mass and first steps dominate


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cases", nargs="+", type=parse_case, default=[parse_case(c) for c in CASES], metavar="CHORDxSPANxSTEPS",
        help=f"panels along chord and span, and steps (default: {' '.join(CASES)})",
    )  # fmt: skip
    parser.add_argument("--repeats", type=int, default=3, help="alternating runs of a case (default: %(default)s)")
    parser.add_argument("--environment", type=Path, help="virtual environment (default: in the user's cache directory)")
    parser.add_argument("--set-up", action="store_true", help=f"make the environment and install {PACKAGE} first")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    parser.add_argument("--worker", choices=tuple(WORKERS), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error(f"--repeats is {arguments.repeats}; at least one run is needed")
    return arguments


def parse_case(text: str) -> tuple[int, int, int]:
    """Panels along chord and span, and steps, from a text like 4x16x40."""
    try:
        n_chord, n_span, n_steps = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form CHORDxSPANxSTEPS, such as 4x16x40") from None
    if n_chord < 1 or n_span < 1 or n_steps - 1 <= FIRST_CHORDS * n_chord:
        raise argparse.ArgumentTypeError(f"{text!r}: the wing must advance by more than {FIRST_CHORDS:g} chord")
    return n_chord, n_span, n_steps


# ---- PteraSoftware, in its own environment ----


@cache
def load_pterasoftware():
    """Import PteraSoftware, with empty modules for missing packages that its solver does not use."""
    missing = [name for name in UNUSED if util.find_spec(name.partition(".")[0]) is None]
    for name in missing:
        sys.modules[name] = ModuleType(name)
    import pterasoftware

    return pterasoftware


def run_pterasoftware(n_chord: int, n_span: int, n_steps: int, inset: bool) -> dict:
    """Times and lift coefficients of PteraSoftware's unsteady ring vortex-lattice solver with a free wake."""
    ps = load_pterasoftware()
    start = time.perf_counter()
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
    stopwatch = Stopwatch()
    solver = ps.unsteady_ring_vortex_lattice_method.UnsteadyRingVortexLatticeMethodSolver(problem)
    solver.run(prescribed_wake=False, calculate_streamlines=False, show_progress=False)
    times = stopwatch.times()
    lift = [-float(step.airplanes[0].forceCoefficients_W[2]) for step in problem.steady_problems]
    return {"set_up_s": stopwatch.wall - start, **times, "lift": lift}


# ---- wt_gym ----


class UniformWind:
    """The same velocity everywhere."""

    def __init__(self, velocity):
        self.vector = velocity

    def velocity(self, points, time):
        """Velocity at points (..., 3) [m/s]."""
        import numpy as np

        return np.broadcast_to(self.vector, points.shape)


def run_wt_gym(n_chord: int, n_span: int, n_steps: int, inset: bool) -> dict:
    """Times and lift coefficients of wt_gym's vortex lattice without viscous correction, everything fresh each step."""
    import numpy as np

    from wt_gym.aerodynamics import AeroOptions, VortexLattice, build_planform, span_distribution

    start = time.perf_counter()
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
    stopwatch = Stopwatch()
    lattice = VortexLattice(planform, 1, options, 1.0)
    state = lattice.new_state()
    lattice.reset(state, nodes, still, wind)
    lift = [state.nodal_forces.sum(axis=(0, 1, 2)) @ upwards / (0.5 * ASPECT)]
    for k in range(n_steps - 1):
        lattice.convect_wake(state, inflow, k * dt, dt)
        forces = lattice.solve(state, nodes, still, wind, dt)
        lattice.accept(state)
        lift.append(forces.sum(axis=(0, 1, 2)) @ upwards / (0.5 * ASPECT))
    times = stopwatch.times()
    return {"set_up_s": stopwatch.wall - start, **times, "lift": [float(value) for value in lift]}


# ---- the workers: each solver in a process of its own, one run a line of JSON ----

WORKERS = {"pterasoftware": run_pterasoftware, "wt_gym": run_wt_gym}


class Stopwatch:
    """Wall and processor time since it was made."""

    def __init__(self):
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def times(self) -> dict:
        """Elapsed times [s]."""
        return {"wall_s": time.perf_counter() - self.wall, "cpu_s": time.process_time() - self.cpu}


def serve(name: str) -> None:
    """Answer each line of standard input, the arguments of a run, with a line of JSON."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a package prints goes to standard error
    WORKERS[name](1, 4, 6, False)  # compiles
    versions = {p: metadata.version(p) for p in (name, "numpy", "numba")} | {"python": platform.python_version()}
    print(json.dumps(versions), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(WORKERS[name](*json.loads(line))), file=answers, flush=True)


class Worker:
    """A process that runs one of the solvers."""

    def __init__(self, name: str, python: str | Path):
        from speed import SINGLE_THREAD  # the other environment has no wt_gym

        self.name = name
        self.process = subprocess.Popen(
            [python, __file__, "--worker", name], env=os.environ | SINGLE_THREAD, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.versions = self._answer()

    def run(self, *arguments) -> dict:
        """One run, see `run_wt_gym`."""
        self.process.stdin.write(json.dumps(arguments) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the process."""
        self.process.stdin.close()
        self.process.wait()

    def _answer(self) -> dict:
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"error: the process of {self.name} ended with status {self.process.wait()}, see above")
        return json.loads(line)


# ---- the environment ----


def default_environment() -> Path:
    """Folder of the environment in the user's cache directory."""
    if os.environ.get("WT_GYM_CACHE"):
        return Path(os.environ["WT_GYM_CACHE"]).expanduser() / "pterasoftware"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wt_gym" / "pterasoftware"


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
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise SystemExit(f"error: installing {' '.join(packages)} failed:\n{done.stdout}")


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
    import numpy as np

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
    import numpy as np

    coarse_way, coarse = linear_lift_slope(8, chords)
    way, fine = linear_lift_slope(16, chords)
    return coarse_way, math.radians(ANGLE_DEG) * (2.0 * np.interp(coarse_way, way, fine) - coarse)


# ---- the comparison ----


def measure(workers: dict, case: tuple[int, int, int], repeats: int, tell) -> dict:
    """Alternate the solvers and return the median times and the lift of each."""
    import numpy as np

    runs = {"pterasoftware": [], "wt_gym": [], "wt_gym_inset": []}
    for k in range(repeats):
        for name, results in runs.items():
            tell(f"{'x'.join(map(str, case))}, run {k + 1} of {repeats}: {name}")
            results.append(workers[name.removesuffix("_inset")].run(*case, name.endswith("_inset")))
    return {
        name: {key: float(np.median([r[key] for r in results])) for key in ("set_up_s", "wall_s", "cpu_s")}
        | {"wall_range_s": [min(r["wall_s"] for r in results), max(r["wall_s"] for r in results)]}
        | {"lift": results[-1]["lift"]}
        for name, results in runs.items()
    }


def compare(case: tuple[int, int, int], measured: dict, way, reference) -> dict:
    """Ratios of the times and errors of the lift."""
    import numpy as np

    n_chord, _, n_steps = case
    instants = np.arange(n_steps) / n_chord
    exact = np.interp(instants, way, reference)
    later = instants >= FIRST_CHORDS
    solvers = {}
    for name, figures in measured.items():
        error = np.array(figures["lift"]) / exact - 1.0
        solvers[name] = figures | {
            "final_lift": figures["lift"][-1],
            "final_error": float(error[-1]),
            "largest_error": float(np.abs(error[later]).max()),
            "error_to_steady": figures["lift"][-1] / STEADY_LIFT - 1.0,
            "times_faster": measured["pterasoftware"]["wall_s"] / figures["wall_s"],
            "times_faster_cpu": measured["pterasoftware"]["cpu_s"] / figures["cpu_s"],
        }
    return {
        "case": "x".join(map(str, case)),
        "chords": float(instants[-1]),
        "reference_lift": float(exact[-1]),
        "solvers": solvers,
    }


HEADER = (
    f"{'case':10s} {'solver':15s} {'wall s':>9s} {'cpu s':>9s} {'set-up s':>9s} {'x faster':>9s} {'(cpu)':>7s}"
    f" {'CL end':>8s} {'theory':>8s} {'error':>7s} {'largest':>8s} {'to steady':>10s}"
)


def print_comparison(result: dict) -> None:
    """One line a solver."""
    label = result["case"]
    for name, s in result["solvers"].items():
        print(
            f"{label:10s} {name:15s} {s['wall_s']:9.4f} {s['cpu_s']:9.4f} {s['set_up_s']:9.4f} {s['times_faster']:9.1f}"
            f" {s['times_faster_cpu']:7.1f} {s['final_lift']:8.4f} {result['reference_lift']:8.4f}"
            f" {100 * s['final_error']:+6.2f}% {100 * s['largest_error']:7.2f}% {100 * s['error_to_steady']:+9.2f}%",
            flush=True,
        )
        label = f"{result['chords']:.1f} c" if label == result["case"] else ""


def verdict(results: list[dict]) -> dict:
    """Ratios of the times, and whether the lift is at least as accurate everywhere, on the same lattice."""
    pairs = [(r["solvers"]["pterasoftware"], r["solvers"]["wt_gym"]) for r in results]
    return {
        "least_times_faster": min(ours["times_faster"] for _, ours in pairs),
        "greatest_times_faster": max(ours["times_faster"] for _, ours in pairs),
        "least_times_faster_cpu": min(ours["times_faster_cpu"] for _, ours in pairs),
        "greatest_times_faster_cpu": max(ours["times_faster_cpu"] for _, ours in pairs),
        "as_accurate_in_the_end": all(abs(ours["final_error"]) <= abs(ptera["final_error"]) for ptera, ours in pairs),
        "as_accurate_throughout": all(ours["largest_error"] <= ptera["largest_error"] for ptera, ours in pairs),
    }


def main() -> None:
    """Measure and print."""
    arguments = parse_arguments()
    if arguments.worker:
        serve(arguments.worker)
        return
    environment = (arguments.environment or default_environment()).expanduser()
    if arguments.set_up:
        set_up(environment)
    python = environment_python(environment)
    if not python.exists():
        raise SystemExit(
            f"error: no Python environment in {environment}; --set-up makes it, --environment names another"
        )

    from speed import processor

    from wt_gym.runs.progress import ProgressLine

    line = ProgressLine(interval=2.0)
    line.show("reference: linear theory", final=True)
    way, reference = reference_lift(max((steps - 1) / n_chord for n_chord, _, steps in arguments.cases))
    line.show("starting both solvers; the first time they are compiled", final=True)
    workers = {"pterasoftware": Worker("pterasoftware", python), "wt_gym": Worker("wt_gym", sys.executable)}
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    figures = {"processor": processor(), "load_at_start": load, "results": []}
    figures["versions"] = {name: worker.versions for name, worker in workers.items()}
    print(f"{figures['processor']}, {os.cpu_count()} cores, load {load:.2f}, one thread each")
    for name, versions in figures["versions"].items():
        print(f"{name}: " + ", ".join(f"{package} {version}" for package, version in versions.items()))
    print(f"medians of {arguments.repeats} alternating runs; errors against linear theory at the end and, the largest,")
    print(f"from {FIRST_CHORDS:g} chord of travel on; 'to steady' is the end against the steady {STEADY_LIFT}")
    print(HEADER)
    for case in arguments.cases:
        start = time.perf_counter()
        measured = measure(workers, case, arguments.repeats, line.show)
        line.show(f"{'x'.join(map(str, case))}: {time.perf_counter() - start:.0f} s", final=True)
        result = compare(case, measured, way, reference)
        print_comparison(result)
        figures["results"].append(result)
    for worker in workers.values():
        worker.close()
    figures["verdict"] = v = verdict(figures["results"])
    print(
        f"same lattice: wt_gym is {v['least_times_faster']:.1f} to {v['greatest_times_faster']:.1f} times faster "
        f"({v['least_times_faster_cpu']:.1f} to {v['greatest_times_faster_cpu']:.1f} in processor time); at least as "
        f"accurate at the end: {'yes' if v['as_accurate_in_the_end'] else 'no'}, throughout: "
        f"{'yes' if v['as_accurate_throughout'] else 'no'}"
    )
    if arguments.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
