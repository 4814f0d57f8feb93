"""Train a policy on a wt_gym environment: PPO, SAC or TQC.

    wt-gym train --recipe --env wt_gym/LoadReduction-v2
    wt-gym train --wind-speed 15 --max-seconds 600 --out runs/ppo
    wt-gym train --algo sac --hyper learning_rate=1e-3 net_arch=[128,128] --out runs/sac
    wt-gym train --seeds 0 1 2 3 4 --steps 100000 --out runs/five
    wt-gym train --engine ray --address ray-head:6379 --n-envs 64 --out runs/rllib
    wt-gym train --pretrain --out runs/pretrained
    wt-gym train --budget pitch_travel=1200 rotor_speed=1.1 --out runs/budget
    wt-gym train --resume runs/ppo --steps 500000
    wt-gym train --config mine.yml --resume-if-exists

Writes the model, the statistics of its rewards, checkpoints, the best model by evaluations in other winds, figures for
TensorBoard and a record of the training into a folder that wt-gym evaluate takes. Ctrl-C and SIGTERM end the training
after the present step, with everything written; docs/training.md has more.

Exit status: 0 done or out of time, 1 refused, 2 a wrong option, 130 ended by Ctrl-C, 143 by SIGTERM.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.commands.engine_options import add_address_options
from wt_gym.commands.program import UNSAFE, OneLineParser, folder_path, stoppable, user_errors
from wt_gym.commands.training_file import words_of
from wt_gym.commands.training_options import add_training_options, config_from
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.learning.training.config import TrainingConfig
    from wt_gym.learning.training.learners import Learner


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("train", description=__doc__, epilog=UNSAFE)
    parser.add_argument(
        "--out",
        type=folder_path,
        default=argparse.SUPPRESS,
        help="folder for the results (default: runs/ppo, or the algorithm)",
    )
    parser.add_argument("--overwrite", action="store_true", help="remove the training that is in the folder")
    parser.add_argument("--resume", metavar="FOLDER", help="resume a training, as it is configured; --steps and "
        "--max-seconds can change")  # fmt: skip
    add_training_options(parser)
    parser.add_argument("--config", metavar="FILE", help="YAML file with any of these options, by name; those typed "
        "come after them")  # fmt: skip
    parser.add_argument("--recipe", action="store_true", help="the recommended training of the task of --env: a file "
        "of agents/recipes, as --config takes it")  # fmt: skip
    parser.add_argument(
        "--resume-if-exists", action=argparse.BooleanOptionalAction, default=False, help="resume where the folder "
        "holds this training already, else begin: the same words again and again"
    )  # fmt: skip
    options = parser.add_argument_group("how long, and what is written", argument_default=argparse.SUPPRESS)
    options.add_argument("--steps", type=int, help="environment steps (default: 200000, with --pretrain 0)")
    options.add_argument(
        "--pretrain", nargs="*", action="extend", metavar="NAME=VALUE", help="follow the gradient of the cost on an "
        "identified linear model, on top of linear_optimal, then PPO for --steps (default with it: 0); options such as "
        "rounds=3 episodes=192"
    )  # fmt: skip
    options.add_argument(
        "--budget", nargs="+", action="extend", metavar="NAME=LIMIT", help="costs that PPO is to keep by Lagrangian "
        "multipliers: pitch_travel [rad/d], rotor_speed over rated [-], tip_clearance [m], tower_acceleration [m/s^2]"
    )  # fmt: skip
    options.add_argument("--max-seconds", type=float, metavar="S", help="stop after this wall time")
    seeds = options.add_mutually_exclusive_group()
    seeds.add_argument("--seed", type=int, default=argparse.SUPPRESS, help="of policy and environments (default: 0)")
    seeds.add_argument(
        "--seeds", type=int, nargs="+", default=argparse.SUPPRESS, metavar="N", help="train one after another, each in "
        "a folder seed-N"
    )  # fmt: skip
    options.add_argument("--checkpoint-steps", type=int, metavar="STEPS", help="between checkpoints (default: 50000)")
    options.add_argument(
        "--checkpoint-minutes", type=float, metavar="MIN", help="wall time between checkpoints; 0: none (default: 10)"
    )
    options.add_argument("--tensorboard", action=argparse.BooleanOptionalAction, help="write figures for TensorBoard "
        "(default: if it is installed)")  # fmt: skip
    where = parser.add_argument_group("where")
    add_address_options(where)
    where.add_argument(
        "--runners", type=int, metavar="N", help="with Ray, processes that step the environments, a processor each "
        "(default: the processors of the cluster, at most --n-envs)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the record of the training as JSON at the end")
    words = list(sys.argv[1:] if words is None else words)
    arguments = parser.parse_args(words)
    if arguments.config is not None and arguments.recipe:
        parser.error("--config names a training and --recipe that of the task: give one of them")
    if arguments.config is not None or arguments.recipe:
        with user_errors():
            in_file = words_of(_recipe_of(arguments) if arguments.recipe else arguments.config, words)
        arguments = parser.parse_args([*in_file, *words])
    if arguments.resume_if_exists and arguments.overwrite:
        parser.error(
            "--resume-if-exists keeps the training that is in the folder, --overwrite removes it: give one of them"
        )
    if arguments.resume is not None:
        kept = {"resume", "steps", "max_seconds", "json", "overwrite", "engine", "address", "runners"}
        kept |= {name for name in ("config", "recipe", "resume_if_exists") if not getattr(arguments, name)}
        fixed = [f"--{name.replace('_', '-')}" for name in vars(arguments) if name not in kept]
        fixed += ["--overwrite"] * arguments.overwrite
        if fixed:
            parser.error(f"--resume takes the configuration of the folder: leave out {', '.join(fixed)}")
    return arguments


def _recipe_of(arguments: argparse.Namespace) -> Path:
    """File with the recipe of the environment that was chosen."""
    from wt_gym.learning.training.recipes import recipe_file

    return recipe_file(getattr(arguments, "env", DEFAULT_ENV))


def learner_of(arguments: argparse.Namespace) -> Learner | None:
    """Who learns; None for stable-baselines3 in this process."""
    if arguments.engine == "ray":
        from wt_gym.learning.distributed.rllib_learner import RllibLearner

        return RllibLearner(arguments.address, arguments.runners)
    for name in ("address", "runners"):
        if getattr(arguments, name) is not None:
            raise ValueError(f"--{name} belongs to a Ray cluster: give --engine ray too")
    return None


def budgets_of(words: list[str]) -> dict[str, float]:
    """Limits of costs from ``name=limit``.

    Raises
    ------
    ValueError
        If there is no name or no number.
    """
    limits = {}
    for word in words:
        name, separator, limit = word.partition("=")
        try:
            limits[name] = float(limit)
        except ValueError:
            separator = ""
        if not (name and separator):
            raise ValueError(f"--budget must be NAME=LIMIT with a number, got {word!r}")
    return limits


def configuration(arguments: argparse.Namespace) -> TrainingConfig:
    """Configuration of a training from the options that were given."""
    given = vars(arguments)
    names = {"steps": "total_steps"} | {
        name: name for name in ("max_seconds", "seed", "checkpoint_steps", "checkpoint_minutes", "tensorboard")
    }
    fields: dict[str, Any] = {}
    if "pretrain" in given:
        from wt_gym.learning.training.hyperparameters import parse_override

        fields |= {"pretraining": dict(parse_override(text) for text in given["pretrain"]), "total_steps": 0}
    if "budget" in given:
        fields["budgets"] = budgets_of(given["budget"])
    fields |= {field: given[name] for name, field in names.items() if name in given}
    return config_from(arguments, **fields)


def start(arguments: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Train; give the folder and the record, or the summary of several seeds."""
    from wt_gym.learning.train import train  # torch takes seconds to import: not for --help
    from wt_gym.learning.training.resume import resume_or_train
    from wt_gym.learning.training.seeds import train_seeds

    given, config = vars(arguments), configuration(arguments)
    folder = Path(given.get("out", f"runs/{config.algorithm.lower()}"))
    seeds, learner = given.get("seeds"), learner_of(arguments)
    if arguments.resume_if_exists:
        return folder, resume_or_train(config, folder, seeds, learner=learner)
    if seeds is not None:
        return folder, train_seeds(config, folder, seeds, overwrite=arguments.overwrite, learner=learner)
    return folder, train(config, folder, overwrite=arguments.overwrite, learner=learner)


_STOPPED = (
    "a pretraining keeps its recordings: the same command (of several seeds --resume) resumes with them; steps since "
    "the last checkpoint are lost"
)


def resume_folder(arguments: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Resume; as `start`."""
    from wt_gym.experiment.run_folder import SEEDS_FILE
    from wt_gym.learning.train import resume
    from wt_gym.learning.training.seeds import resume_seeds

    folder = Path(arguments.resume)
    go = resume_seeds if (folder / SEEDS_FILE).exists() else resume
    limits: dict[str, Any] = {
        "total_steps": getattr(arguments, "steps", None), "max_seconds": getattr(arguments, "max_seconds", None),
    }  # fmt: skip
    return folder, go(folder, **limits, learner=learner_of(arguments))


def report(folder: Path, record: dict[str, Any]) -> None:
    """Say what has come out."""
    from wt_gym.learning.training.seeds import seeds_table
    from wt_gym.learning.training.selection import FIGURES

    if "runs" in record:
        print("\n".join(seeds_table(record["runs"])))
        return
    print(f"{record['steps']} steps in {record['wall_seconds']:.0f} s; model and statistics in {folder}")
    best = (record["evaluation"] or {}).get("best")
    if best is not None:
        changes = [f"{FIGURES[name]} {100 * best[name]:+.1f} %" for name in ("mean_power", "blade_flap_del")
                   if best[name] is not None]  # fmt: skip
        figures = ", ".join([f"{FIGURES['episode_return']} {best['episode_return']:+.2f}", *changes])
        print(f"best model, after {best['steps']} steps: {figures} (other winds than those of the training)")


def main(words: list[str] | None = None) -> None:
    """Train."""
    arguments = parse_arguments(words)
    with user_errors(), stoppable(_STOPPED):
        folder, record = (start if arguments.resume is None else resume_folder)(arguments)
    report(folder, record)
    if record["status"] == "interrupted":
        print(f"ended by {record['stopped_by']}; resume with: wt-gym train --resume {folder}")
    if arguments.json:
        print(json.dumps(record, default=str))
    if record["status"] == "interrupted":
        sys.exit(128 + signal.Signals[record["stopped_by"]])
