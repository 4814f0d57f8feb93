"""What the words for agents on a command line mean."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.control.controllers import CONTROLLERS, name_and_parameters
from wt_gym.control.controllers.parameters import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Collection

__all__ = [
    "BASELINE",
    "PREFIX",
    "controller_of",
    "expand_seeds",
    "fingerprint",
    "is_controller_name",
    "kind_of",
    "named_choices",
    "split_name",
]

BASELINE = "Baseline PI"
_WORDS = {"baseline": BASELINE, "constant": "Constant action"}
PREFIX = "controller:"


def is_controller_name(choice: str) -> bool:
    """Whether a choice names a controller of the library: ``controller:`` in front, or a name of `CONTROLLERS`."""
    names = choice.partition(":")[0].split("+")
    return choice.startswith(PREFIX) or all(name in CONTROLLERS for name in names)


def split_name(text: str) -> tuple[str, str]:
    """Name and choice of ``NAME=CHOICE``; the name is empty where there is none.

    A name has no colon, so that ``constrained_ipc:level=0.1`` is a controller with a parameter.
    """
    name, separator, choice = text.partition("=")
    return (name, choice) if separator and ":" not in name else ("", text)


def kind_of(choice: str, words: Collection[str], more: Collection[str] = ()) -> str:
    """What a choice is: a word, else a controller, else a path.

    Parameters
    ----------
    choice : str
    words : collection of str
        That mean something here.
    more : collection of str
        Other words, which the message names too.

    Returns
    -------
    {"word", "controller", "trained"}

    Raises
    ------
    ValueError
        If it is none of them.
    """
    if choice in words:
        return "word"
    if is_controller_name(choice):
        return "controller"
    if Path(choice).exists():
        return "trained"
    raise ValueError(
        f"{choice!r} is no agent: give {', '.join([*words, *more])}, a controller ({', '.join(CONTROLLERS)}, joined "
        "with '+', parameters behind ':'), or the path of a trained model"
        + did_you_mean(choice.partition(":")[0].rpartition("+")[2], (*words, *more, *CONTROLLERS))
    )


def controller_of(choice: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a controller from ``name:key=value,key=value``, with or without ``controller:`` in front.

    Parameters
    ----------
    choice : str
        For example ``"ipc+tower_dampers"`` or ``"constrained_ipc:level=0.1"``; values are Python literals.

    Returns
    -------
    name : str
    parameters : dict
        Both as `wt_gym.control.controllers.make_controller` takes them.

    Raises
    ------
    ValueError
        If a parameter is not of the form ``key=value`` with a number, or True, False or None as its value.
    """
    return name_and_parameters(choice.removeprefix(PREFIX))


def named_choices(choices: list[str]) -> dict[str, str]:
    """Names for the agents of a command line: ``NAME=CHOICE``, or a name that follows from the choice.

    Parameters
    ----------
    choices : list of str
        Words, controllers or paths for `wt_gym.agents.environments.load_agent`, with or without a name in front. The
        folder of a training with several seeds stands for one agent a seed.

    Returns
    -------
    dict
        Name to choice, in the given order.

    Raises
    ------
    ValueError
        If two agents get the same name, or a choice is neither a word, nor a controller, nor a path that exists.
    """
    named: dict[str, str] = {}
    for given in choices:
        name, choice = split_name(given)
        for suffix, single in expand_seeds(choice, kind_of(choice, _WORDS)):
            label = (name or _default_name(choice)) + suffix
            if label in named:
                raise ValueError(f"two agents are called {label!r}; give them names as NAME={single}")
            named[label] = single
    return named


def expand_seeds(choice: str, kind: str) -> list[tuple[str, str]]:
    """Suffix of the name and path of each seed where a choice is the folder of a training with several seeds.

    Parameters
    ----------
    choice : str
    kind : str
        What it is; only what is "trained" can have seeds.

    Returns
    -------
    list of (str, str)
        One pair with an empty suffix for anything else.

    Raises
    ------
    FileNotFoundError
        If no seed has been trained.
    ValueError
        If the plan of the training is damaged.
    """
    if kind != "trained":
        return [("", choice)]
    from wt_gym.agents.trained_agent import MODEL_FILE  # torch takes seconds to import

    folders = _folders_of_seeds(Path(choice))
    if not folders:
        return [("", choice)]
    trained = {seed: folder for seed, folder in folders.items() if (folder / MODEL_FILE).is_file()}
    if not trained:
        raise FileNotFoundError(f"no trained model in {choice} yet: none of its seeds has one")
    return [(f" seed {seed}", str(folder)) for seed, folder in trained.items()]


def _folders_of_seeds(folder: Path) -> dict[int, Path]:
    """Folders of the seeds by number, as the plan of the training names them; none for anything else."""
    from wt_gym.agents.training.run_folder import SEEDS_FILE, read_plan, seed_folder

    if not (folder / SEEDS_FILE).is_file():
        return {}
    return {seed: seed_folder(folder, seed) for seed in sorted(read_plan(folder)["seeds"])}


def fingerprint(choice: str) -> dict[str, Any]:
    """What an agent is, to tell whether a stopped evaluation can go on with it.

    Parameters
    ----------
    choice : str

    Returns
    -------
    dict
        The choice, and for a trained model the SHA-256 sums of its files.

    Raises
    ------
    FileNotFoundError
        If there is no such model.
    """
    if kind_of(choice, _WORDS) != "trained":
        return {"choice": choice}
    from wt_gym.agents.trained_agent import model_digests  # torch takes seconds to import

    return {"choice": choice, "sha256": model_digests(choice)}


def _default_name(choice: str) -> str:
    """Name that says what the choice is: algorithm of a trained model, else the name of its file or folder."""
    kind = kind_of(choice, _WORDS)
    if kind == "word":
        return _WORDS[choice]
    if kind == "controller":
        return choice.removeprefix(PREFIX)
    from wt_gym.agents.trained_agent import RECORD_FILE, read_record

    path = Path(choice)
    for folder in (path, path.parent, *_folders_of_seeds(path).values()):
        record = folder / RECORD_FILE
        if record.is_file():
            return read_record(record)["algorithm"]
    return path.stem
