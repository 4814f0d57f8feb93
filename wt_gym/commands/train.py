"""Train a policy on a wt_gym environment: PPO, SAC or TQC.

    wt-gym train --recipe --env wt_gym/LoadReduction-v3
    wt-gym train --wind-speed 15 --max-seconds 600 --out runs/ppo
    wt-gym train --algo sac --hyper learning_rate=1e-3 net_arch=[128,128] --out runs/sac
    wt-gym train --seeds 0 1 2 3 4 --steps 100000 --out runs/five
    wt-gym train --pretrain --out runs/pretrained
    wt-gym train --budget pitch_travel=1200 rotor_speed=1.1 --out runs/budget
    wt-gym train --resume runs/ppo --steps 500000
    wt-gym train --config mine.yml --resume-if-exists

Writes the model, the statistics of its rewards, checkpoints, the best model by evaluations in other winds, figures for
TensorBoard and a record of the training into a folder that wt-gym evaluate takes. Ctrl-C and SIGTERM end the training
after the current step, with everything written; docs/training.md has more.

Exit status: 0 done or out of time, 1 refused, 2 a wrong option, 130 ended by Ctrl-C, 143 by SIGTERM.
"""

from __future__ import annotations

import argparse
import json
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.options import add_options as add_record
from wt_gym.base.options import chosen_options, named_value
from wt_gym.commands.options import add_shared, environment_of
from wt_gym.commands.program import UNSAFE, user_errors
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.learning.options import TrainingConfig

EPILOG = UNSAFE
STOPPED = (
    "a pretraining keeps its recordings: the same command (of several seeds --resume) resumes with them; steps since "
    "the last checkpoint are lost"
)
_NAMES = {"total_steps": "steps", "pretraining": "pretrain", "budgets": "budget"}
"""Options of the command by field of the configuration, where they differ."""
_WITH_RESUME = {"--resume", "--steps", "--max-seconds", "--json"}


def add_training_options(parser: argparse.ArgumentParser) -> None:
    """Add what a configuration is made of. Options that are not given stay out of the result."""
    from wt_gym.learning.options import TrainingConfig

    what = parser.add_argument_group("what to train on", argument_default=argparse.SUPPRESS)
    absent = {"default": argparse.SUPPRESS}
    add_shared(
        what, env=absent | {"help": f"environment id (default: {DEFAULT_ENV})"},
        wind_speed={"help": "mean wind speed, or the range to draw it from [m/s]"},
        env_kwargs=absent, fidelity={}, site={}, wind={},
    )  # fmt: skip
    what.add_argument("--episode-length", type=float, metavar="S", help="length of an episode [s]")
    add_record(what, TrainingConfig, "n_envs")
    how = parser.add_argument_group("how", argument_default=argparse.SUPPRESS)
    how.add_argument(
        "--algo", type=str.upper, dest="training.algorithm", metavar="NAME", help="PPO, SAC or TQC (default: PPO)"
    )
    how.add_argument("--hyperparameters", metavar="FILE", help="YAML file on top of those in agents/hyperparameters")
    how.add_argument(
        "--hyper", nargs="+", action="extend", type=named_value, metavar="NAME=VALUE",
        help="single hyperparameters, on top of all files",
    )  # fmt: skip
    add_record(how, TrainingConfig, "eval_every", "eval_winds", "eval_seconds")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from wt_gym.learning.options import TrainingConfig

    folder_help = "folder for the results (default: runs/ppo, or the algorithm)"
    add_shared(parser, "overwrite", out={"default": argparse.SUPPRESS, "help": folder_help})
    parser.add_argument(
        "--resume", metavar="FOLDER",
        help="resume a training, as it is configured; --steps and --max-seconds can change",
    )  # fmt: skip
    add_training_options(parser)
    parser.add_argument(
        "--config", metavar="FILE", help="YAML file with any of these options, by name; those typed come after them"
    )
    parser.add_argument(
        "--recipe", action="store_true",
        help="the recommended training of the task of --env: a file of agents/recipes, as --config takes it",
    )  # fmt: skip
    parser.add_argument(
        "--resume-if-exists", action=argparse.BooleanOptionalAction, default=False,
        help="resume where the folder holds this training already, else begin: the same words again and again",
    )  # fmt: skip
    options = parser.add_argument_group("how long, and what is written", argument_default=argparse.SUPPRESS)
    add_record(
        options, TrainingConfig, "total_steps", "linear_steps", "pretraining", "budgets", "max_seconds", **_NAMES
    )
    seeds = options.add_mutually_exclusive_group()
    add_record(seeds, TrainingConfig, "seed")
    seeds.add_argument(
        "--seeds", type=int, nargs="+", default=argparse.SUPPRESS, metavar="N",
        help="train one after another, each in a folder seed-N",
    )  # fmt: skip
    add_record(options, TrainingConfig, "checkpoint_steps", "checkpoint_minutes", "tensorboard")
    add_shared(parser, "json")


def parse(parser: argparse.ArgumentParser, words: list[str]) -> argparse.Namespace:
    """Read the words, those of a file or a recipe first."""
    arguments = parser.parse_args(words)
    if arguments.config is not None and arguments.recipe:
        parser.error("--config names a training and --recipe that of the task: give one of them")
    if arguments.config is not None or arguments.recipe:
        from wt_gym.learning.hyperparameters import recipe_file

        with user_errors():
            file = recipe_file(getattr(arguments, "env", DEFAULT_ENV)) if arguments.recipe else arguments.config
            in_file = words_of(file, words)
        arguments = parser.parse_args([*in_file, *words])
    if arguments.resume_if_exists and arguments.overwrite:
        parser.error(
            "--resume-if-exists keeps the training that is in the folder, --overwrite removes it: give one of them"
        )
    if arguments.resume is not None:
        typed = [word.partition("=")[0] for word in words if word.startswith("--")]
        if fixed := [word for word in typed if not any(one.startswith(word) for one in _WITH_RESUME)]:
            parser.error(f"--resume takes the configuration of the folder: leave out {', '.join(fixed)}")
    return arguments


def configuration(arguments: argparse.Namespace, **fields: Any) -> TrainingConfig:
    """Configuration of the options that were given, with some fields in place of those of the options."""
    from wt_gym.learning.hyperparameters import read_hyperparameters, replaced
    from wt_gym.learning.options import TrainingConfig

    given, options = vars(arguments), chosen_options(arguments, TrainingConfig)
    arguments.env = given.get("env", TrainingConfig.env_id)
    kwargs = environment_of(arguments)
    if "wind_speed" in given:
        if len(given["wind_speed"]) > 2:
            raise ValueError(f"--wind-speed must be one number or two, got {given['wind_speed']}")
        low, *high = given["wind_speed"]
        kwargs["wind_speed"] = (low, high[0]) if high else low
    if "episode_length" in given:
        kwargs["episode_length"] = given["episode_length"]
    if "pretraining" in options:
        options.setdefault("total_steps", 0)
    algorithm = options.get("algorithm", TrainingConfig.algorithm)
    file, single = given.get("hyperparameters"), dict(given.get("hyper", ()))
    hyperparameters = replaced({} if file is None else read_hyperparameters(file, algorithm, arguments.env), single)
    return TrainingConfig(
        env_id=arguments.env, env_kwargs=kwargs, hyperparameters=hyperparameters, **(options | fields)
    )


def start(arguments: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Train; give the folder and the record, or the summary of several seeds."""
    from wt_gym.learning.seeds import resume_or_train, train_seeds
    from wt_gym.learning.train import train  # torch takes seconds to import: not for --help

    given, config = vars(arguments), configuration(arguments)
    folder = Path(given.get("out", f"runs/{config.algorithm.lower()}"))
    seeds = given.get("seeds")
    if arguments.resume_if_exists:
        return folder, resume_or_train(config, folder, seeds)
    if seeds is not None:
        return folder, train_seeds(config, folder, seeds, overwrite=arguments.overwrite)
    return folder, train(config, folder, overwrite=arguments.overwrite)


def resume_folder(arguments: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    """Resume; as `start`."""
    from wt_gym.experiment.run_folder import SEEDS_FILE
    from wt_gym.learning.options import TrainingConfig
    from wt_gym.learning.seeds import resume_seeds
    from wt_gym.learning.train import resume

    folder = Path(arguments.resume)
    go = resume_seeds if (folder / SEEDS_FILE).exists() else resume
    return folder, go(folder, **chosen_options(arguments, TrainingConfig))


def report(folder: Path, record: dict[str, Any]) -> None:
    """Say what has come out."""
    from wt_gym.learning.callbacks import FIGURES
    from wt_gym.learning.seeds import seeds_table

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


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Train or resume."""
    folder, record = (start if arguments.resume is None else resume_folder)(arguments)
    report(folder, record)
    if record["status"] == "interrupted":
        print(f"ended by {record['stopped_by']}; resume with: wt-gym train --resume {folder}")
        arguments.status = 128 + signal.Signals[record["stopped_by"]]
    return record


_ONLY_TYPED = ("config", "recipe", "resume")
_WITH_NO = ("resume-if-exists", "tensorboard")
_EITHER = (("--seed", "--seeds"), ("--resume-if-exists", "--overwrite"))


def words_of(path: str | Path, typed: Sequence[str] = ()) -> list[str]:
    """Options of a training file as words of a command line.

    Parameters
    ----------
    path : str or path
        YAML that maps names of options, with ``_`` or ``-``, to values: numbers, words, lists of them, true or false
        for switches, a mapping for ``env_kwargs``, ``site``, ``hyper``, ``pretrain`` and ``budget``.
    typed : sequence of str
        Words that come after them; what they exclude is left out, as ``seed`` by ``--seeds``.

    Returns
    -------
    list of str
        What the parser of the command checks like words that were typed.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not such a mapping.
    """
    import yaml  # in the extra "train"

    try:
        options = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(options, dict) or not all(isinstance(name, str) for name in options):
        raise ValueError(f"{path} must map options of the training to values, as 'algo: sac', got {options!r:.80}")
    words, typed_options = [], {word.partition("=")[0] for word in typed}
    for name, value in options.items():
        option = f"--{name.replace('_', '-')}"
        others = {other for pair in _EITHER if option in pair for other in pair if other != option}
        if not others & typed_options:  # which exclude it
            words += _option(option.removeprefix("--"), value, path)
    return words


def _option(name: str, value: Any, path: str | Path) -> list[str]:
    """Words of one option."""
    if any(only.startswith(name) for only in _ONLY_TYPED):  # the parser takes beginnings of names too
        raise ValueError(f"{path}: {name} belongs on the command line")
    match value:
        case bool():
            return [f"--{name}" if value else f"--no-{name}"] if value or name in _WITH_NO else []
        case dict() if name == "env-kwargs":
            return [f"--{name}={json.dumps(value)}"]
        case dict() if name in ("hyper", "site", "pretrain", "budget"):
            return [f"--{name}", *(f"{key}={_word(entry)}" for key, entry in value.items())]
        case list():
            return [f"--{name}", *map(_word, value)]
        case int() | float() | str():
            return [f"--{name}={_word(value)}"]
    raise ValueError(f"{path}: {name} must be a number, a word, a list or true or false, got {value!r:.80}")


def _word(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
