"""Time of one call of exported controllers, in a C program that hands over changing readings.

    python scripts/bench/export.py                                   # discon, all parts, and a shipped agent
    python scripts/bench/export.py tuned agents/trained/load_reduction_on_linear_optimal

Every call is a step of the controller; of an agent every second one is a step of its policy too.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = (
    "discon",
    "tsr_tracking+constrained_ipc+tower_dampers+yaw",
    "linear_optimal",
    str(ROOT / "agents/trained/load_reduction_on_linear_optimal"),
)
PROGRAM = r"""
#include <time.h>
int main(void) {
    static float swap[3500];
    static double spent[CALLS];
    char message[1025];
    int fail;
    double total = 0.0, longest = 0.0;
    for (int k = 0; k < CALLS; k++) {
        double turn = 0.127 * k;
        clock_t begin;
        swap[0] = k == 0 ? 0.0f : 1.0f; swap[1] = 0.1f * (float)k; swap[2] = 0.1f; swap[27] = swap[48] = 1.0f;
        swap[3] = swap[32] = swap[33] = (float)(0.2 + 0.05 * sin(0.01 * k));
        for (int b = 0; b < 3; b++) swap[29 + b] = (float)(6e6 + 2e6 * cos(turn + 2.0944 * b) + 1e6 * sin(0.3 * k));
        swap[20] = (float)(1.267 + 0.03 * sin(0.02 * k)); swap[19] = 97.0f * swap[20];
        swap[14] = 5e6f; swap[22] = 4.3e4f; swap[26] = 16.0f;
        swap[52] = (float)sin(0.2 * k); swap[53] = (float)(0.1 * cos(0.2 * k)); swap[59] = (float)turn;
        begin = clock();
        for (int r = 0; r < REPEATS; r++) {
            swap[1] = 0.1f * (float)(k * REPEATS + r);
            DISCON(swap, &fail, "", "", message);
        }
        spent[k] = 1e6 * (double)(clock() - begin) / CLOCKS_PER_SEC / REPEATS;
        total += spent[k];
        if (k > 0 && spent[k] > longest) longest = spent[k];
    }
    printf("%.2f %.2f\n", total / CALLS, longest);
    return fail;
}
"""


def time_of(choice: str) -> tuple[float, float]:
    """Mean time of a call, and of the slowest twenty in a row [µs]."""
    from wt_gym.bridges.compiler import find_compiler
    from wt_gym.deployment.export.discon import export_discon

    with tempfile.TemporaryDirectory() as folder:
        source = export_discon(choice, folder, hold_missing=True)["files"][0]
        program = Path(folder) / "program.c"
        constants = "#define CALLS 1000\n#define REPEATS 20\n"
        program.write_text(f'{constants}#include "{source}"\n{PROGRAM}', encoding="utf-8")
        binary = program.with_suffix("")
        command = [
            *find_compiler(),
            "-std=c99",
            "-O2",
            "-D_POSIX_C_SOURCE=199309L",
            "-o",
            str(binary),
            str(program),
            "-lm",
        ]
        subprocess.run(command, check=True)
        mean, longest = subprocess.run([str(binary)], check=True, capture_output=True, text=True).stdout.split()
    return float(mean), float(longest)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("choices", nargs="*", default=DEFAULT, help="controllers and trained agents")
    for choice in parser.parse_args().choices:
        mean, longest = time_of(choice)
        print(f"{Path(choice).name}: {mean:.2f} µs a call, {longest:.2f} µs in the slowest twenty")


if __name__ == "__main__":
    main()
