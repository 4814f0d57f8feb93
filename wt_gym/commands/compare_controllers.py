"""Compare controllers in the same winds; changes are against the first.

    wt-gym compare-controllers discon ipc constrained_ipc:level=0.1 --winds 12 15 18 --seeds 1001 1002

A controller is a name of wt_gym.control.controllers.make_controller, with parameters behind a colon.
"""

import json
import sys
import time

from wt_gym.commands.program import OneLineParser, user_errors


def main(words: list[str] | None = None) -> None:
    """Run."""
    parser = OneLineParser("compare-controllers", description=__doc__)
    parser.add_argument("controllers", nargs="+")
    parser.add_argument("--turbine", default="nrel_5mw")
    parser.add_argument("--winds", nargs="+", type=float, default=[12.0, 15.0, 18.0], help="m/s")
    parser.add_argument("--seeds", nargs="*", type=int, default=[1001, 1002], help="none: steady wind")
    parser.add_argument("--duration", type=float, default=150.0, help="measured, s")
    parser.add_argument("--skip", type=float, default=30.0, help="before it, s")
    parser.add_argument("--fidelity", default="training")
    parser.add_argument("--control-dt", type=float, help="s")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    arguments = parser.parse_args(words)

    from wt_gym.agents.choices import controller_of
    from wt_gym.agents.comparison import Case, run_cases, table
    from wt_gym.turbines import load_turbine

    begin = time.monotonic()

    def progress(name, case):
        print(f"{time.monotonic() - begin:6.0f} s  {name} in {case}", file=sys.stderr, flush=True)

    with user_errors():
        controllers = {text: controller_of(text) for text in arguments.controllers}
        cases = [Case(wind, seed) for wind in arguments.winds for seed in (arguments.seeds or [None])]
        runs = run_cases(
            load_turbine(arguments.turbine), controllers, cases, arguments.duration, arguments.skip,
            arguments.fidelity, arguments.control_dt, progress,
        )  # fmt: skip
    print(table(runs))
    for run in runs:
        for case, message in run.failures.items():
            print(f"{run.name} in {case}: {message}")
    if arguments.json:
        rows = [
            {"controller": r.name, "wind_speed": c.wind_speed, "seed": c.seed, **m}
            for r in runs
            for c, m in r.metrics.items()
        ]
        print(json.dumps(rows))
