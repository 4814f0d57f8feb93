"""Try versions of numba and both ways to compile: tests, time to the first step, speed.

Each version gets a virtual environment with numba and what it asks for; everything else is lent by the interpreter that
runs this script. Caches of kernels are fresh. A version may have a suffix: ``0.63.1:plain`` takes the plain way.

Examples
--------
    python scripts/bench/numba_matrix.py 0.63.1 0.68.1 0.68.1:plain --json
"""

import argparse
import json
import os
import subprocess
import sys
import sysconfig
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORE = (
    "envs_tests/unit/test_compiled.py", "envs_tests/unit/test_aerodynamics_kernels.py",
    "envs_tests/unit/test_tree_induction.py", "envs_tests/physics/test_multibody.py",
    "envs_tests/physics/test_simulation_repeatability.py", "envs_tests/env/test_env_contract.py",
)  # fmt: skip
STEP = """
import json, os, sys, time
began = time.perf_counter()
import llvmlite, numba, numpy
from wt_gym.base.compiled import way_to_compile
from wt_gym.simulation import Simulator
from wt_gym.wind import SteadyInflow

simulator = Simulator("nrel_5mw", SteadyInflow(9.0), "training")
simulator.reset(rotor_speed=0.96)
simulator.advance(0.2, pitch=0.02)
first, used = time.perf_counter() - began, os.times()
record = {
    "numba": numba.__version__, "llvmlite": llvmlite.__version__, "numpy": numpy.__version__, "way": way_to_compile(),
    "first step [s]": round(first, 1), "first step [CPU s]": round(used.user + used.system, 1),
}
if "speed" in sys.argv:
    simulator.advance(20.0, pitch=0.02)
    best = float("inf")
    for _ in range(10):
        began = time.process_time()
        signals = simulator.advance(4.0, pitch=0.02)
        best = min(best, time.process_time() - began)
    record |= {"simulated s / CPU s": round(4.0 / best, 1), "rotor speed": float(signals.rotor_speed)}
print(json.dumps(record))
"""


def interpreter(folder: Path, version: str) -> Path:
    """An environment with a version of numba, made where it is not there yet."""
    home = folder / version
    python = home / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = home / "done"
    if not done.exists():
        venv.create(home, with_pip=True, clear=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"numba=={version}"]
        subprocess.run(pip, check=True)
        ask = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
        site = Path(subprocess.run(ask, check=True, capture_output=True, text=True).stdout.strip())
        lent = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
        (site / "zz_lent.pth").write_text("\n".join(lent) + "\n", encoding="utf-8")
        done.touch()
    return python


def measure(python: Path, way: str, caches: Path, tests: bool) -> dict:
    """Figures of one version and one way."""
    variables = os.environ | {
        "PYTHONPATH": str(ROOT), "WT_GYM_COMPILE": way, "WT_GYM_COMPILE_ALONE": "1", "OMP_NUM_THREADS": "1",
        "NUMBA_CACHE_DIR": str(caches),
    }  # fmt: skip

    def step(*words: str) -> dict:
        command = [str(python), "-c", STEP, *words]
        done = subprocess.run(command, env=variables, check=True, stdout=subprocess.PIPE, text=True, cwd=caches)
        return json.loads(done.stdout)

    record = step()
    again = step("speed")
    record |= {f"again: {name}": again[name] for name in ("first step [s]", "first step [CPU s]")}
    record |= {name: again[name] for name in ("simulated s / CPU s", "rotor speed")}
    if tests:
        command = [str(python), "-m", "pytest", "--disable-warnings", "-n", "0", "-p", "no:cacheprovider", *CORE]
        done = subprocess.run(command, env=variables, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        record["tests"] = done.stdout.strip().rsplit("\n", 1)[-1]
        if done.returncode:
            print(done.stdout, file=sys.stderr)
    return record


def main() -> int:
    """Print one line a version."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("versions", nargs="+", metavar="VERSION[:WAY]")
    parser.add_argument("--folder", type=Path, help="of the environments, kept for the next time")
    parser.add_argument("--no-tests", dest="tests", action="store_false", help="figures only")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    arguments = parser.parse_args()
    records = []
    with tempfile.TemporaryDirectory() as temporary:
        for choice in arguments.versions:
            version, _, way = choice.partition(":")
            python = interpreter(arguments.folder or Path(temporary), version)
            caches = Path(temporary) / f"cache-{choice.replace(':', '-')}"
            caches.mkdir()
            records.append(measure(python, way or "linked", caches, arguments.tests))
            print(*(f"{name} {value}" for name, value in records[-1].items()), sep=", ", flush=True)
    if arguments.json:
        print(json.dumps(records))
    return 0


if __name__ == "__main__":
    sys.exit(main())
