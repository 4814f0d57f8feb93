#!/usr/bin/env python3
"""Rename what this package has renamed, in any source tree: identifiers, modules, options, and the spelling of words.

    scripts/rename.py PATH             # rename in the tree at PATH, print what changes
    scripts/rename.py PATH --dry-run   # print only
    scripts/rename.py PATH --no-spelling   # names only, no US spelling: for code of other projects

It can be run again: what has its new name is left alone. A line that has to keep an old name says ``rename: keep``.
`ruff format` afterwards breaks lines that became too long. Needs Python alone. Public names and modules are those of
``wt_gym/deprecated.py``.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import re
import subprocess
import sys
import tokenize
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

_spec = importlib.util.spec_from_file_location(
    "renamed", Path(__file__).resolve().parents[1] / "wt_gym" / "deprecated.py"
)
deprecated = importlib.util.module_from_spec(_spec)  # without the package, which needs others
_spec.loader.exec_module(deprecated)

SUFFIXES = (".py", ".md", ".toml", ".yml", ".yaml", ".cfg", ".txt", ".sh", ".cff", ".js", ".css")
"""Text that is written by hand. Records (JSON, CSV) keep the names that they were written with."""
EXCLUDED = (
    "scripts/rename.py", "wt_gym/deprecated.py", "envs_tests/unit/test_rename_script.py", "*.venv/*",
    "*/site-packages/*", "wt_gym/turbines/data/*",
)  # fmt: skip
KEEP = "rename: keep"


@dataclass(frozen=True)
class Name:
    """An identifier with a new name.

    Parameters
    ----------
    old, new : str
        Whole words.
    where : {"text", "code", "attribute", "keyword"}
        In all text; in code and in what a text marks as code (backticks, names of parameters in docstrings); only
        behind a dot; only as the name of an argument.
    paths : tuple of str
        Patterns of the files, relative to the tree; by default all.
    """

    old: str
    new: str
    where: str = "text"
    paths: tuple[str, ...] = ("*",)


_COMMANDS = (
    "wt_gym/commands/*", "*.yml", "docs/training.md", "docs/ray.md", "CHANGELOG.md",
    "envs_tests/env/test_env_training.py",
)  # fmt: skip
_ENVS = ("wt_gym/envs/*", "wt_gym/control/actions.py", "agents/controller_agent.py", "envs_tests/*")
_READERS = ("wt_gym/envs/readers.py", "wt_gym/envs/observations.py", "envs_tests/unit/test_envs_observable.py")
_RUNNING = ("wt_gym/envs/running_start.py", "envs_tests/*")
_BODIES = (
    "wt_gym/simulation/*", "wt_gym/structure/*", "validation/large_deflection.py", "validation/long_blade.py",
    "validation/observer_frame.py", "validation/observer_substructures.py", "validation/tree_tools.py",
    "envs_tests/physics/*", "envs_tests/unit/test_simulation_*",
)  # fmt: skip
_HISTORY = ("wt_gym/multibody/*", "wt_gym/simulation/step/*", "validation/integrators.py", "envs_tests/*")
_FUZZING = ("*fuzz*", "wt_gym/simulation/step/*", "envs_tests/physics/test_energy_balance.py")

NAMES = (
    # actions and observations
    Name("aim", "setpoint", "attribute"),
    Name("aim", "setpoint", "code", _ENVS),
    Name('"aim"', '"setpoint"', "text", ("wt_gym/envs/*",)),
    Name("Situation", "ObservationContext", "code"),
    Name("situation", "context", "code", _READERS),
    Name("seen", "lidar", "code", ("wt_gym/envs/readers.py",)),
    # base controllers
    Name("beneath", "environment_of", "attribute", ("agents/*", "envs_tests/*", "wt_gym/agents/*")),
    Name("def beneath", "def environment_of", "text", ("agents/environments.py",)),
    Name("_beneath", "_environment_of_agent", "code"),
    Name("advance_under", "advance_controlled"),
    # runs and training
    Name(
        "contenders",
        "pool",
        "code",
        ("agents/evaluation.py", "agents/loadcases/*", "envs_tests/env/test_env_own_agents.py"),
    ),
    Name("_made_with", "_software_versions", "code"),
    Name("told", "on_progress", "code", ("agents/task_scores.py", "scripts/task_scores.py")),
    Name("_told", "_warned", "code", ("wt_gym/envs/running_start.py",)),
    Name("again", "may_retry", "attribute", ("agents/*",)),
    Name("def again", "def may_retry", "text", ("agents/workers.py",)),
    # options of the command line
    Name("--go-on", "--resume-if-exists"),
    Name("--no-go-on", "--no-resume-if-exists"),
    Name('"go-on"', '"resume-if-exists"', "text", ("wt_gym/commands/*",)),
    Name("go_on", "resume_if_exists", "code", _COMMANDS),
    Name("go_on", "resume_if_exists", "text", _COMMANDS),
    Name("go_on", "resume_seed", "code", ("agents/training/seeds.py",)),
    Name("go_on", "accumulate", "keyword"),
    Name("go_on", "accumulate", "code", ("wt_gym/simulation/*", "wt_gym/control/*", "envs_tests/*")),
    # starts of episodes
    Name("Before", "ControllerHistory", "code", _RUNNING),
    Name("Maker", "StartRecorder", "code", _RUNNING),
    Name("maker", "recorder", "code", ("wt_gym/envs/running_start.py",)),
    Name("_maker", "_recorder", "code", _RUNNING),
    Name("Lengths", "RecordingPlan", "code", _RUNNING),
    Name("LENGTHS", "RECORDING_PLAN", "code", _RUNNING),
    Name("Columns", "RowLayout", "code", _RUNNING),
    Name("pace", "time_scale", "code", ("wt_gym/envs/running_start.py",)),
    Name("_pace", "_time_scale", "code", ("wt_gym/envs/running_start.py",)),
    Name("thrust_before", "wake_thrust"),
    # the coupled step
    Name("carriers", "lattice_bodies", "code", _BODIES),
    Name("n_carriers", "n_lattice_bodies", "text", _BODIES),
    Name("_carriers", "_lattice_bodies", "code", _BODIES),
    Name("FORGET", "FORGETTING_FACTOR", "code"),
    Name("Instant", "MeasuredState", "code", ("wt_gym/simulation/*", "envs_tests/*")),
    Name("Places", "StateIndices", "code", ("wt_gym/simulation/*",)),
    Name("places", "indices", "code", ("wt_gym/simulation/step/measurement*.py",)),
    Name("Numbers", "StateArrays", "code", ("wt_gym/simulation/*",)),
    Name("loan", "excess_limit", "attribute", _FUZZING),
    Name("def loan", "def excess_limit", "text", _FUZZING),
    Name("_loan", "_excess_limit", "code", _FUZZING),
    Name("_LOANS", "_EXCESS_FACTOR", "code", _FUZZING),
    Name("owed", "excess", "code", ("*fuzz*",)),
    Name("overdrawn", "exceeded", "code", ("*fuzz*",)),
    Name("_debts", "_excesses", "code", ("*fuzz*",)),
    # structure
    Name("Piece", "SubBody", "code", _BODIES),
    Name("PieceNodes", "SubBodyNodes"),
    Name("pieces", "sub_bodies", "code", _BODIES),
    Name("piece", "sub_body", "code", _BODIES),
    Name("_pieces", "_sub_bodies", "code", _BODIES),
    Name("n_pieces", "n_sub_bodies", "text", _BODIES),
    Name("add_pieces", "add_sub_bodies"),
    Name("piece_at", "sub_body_at"),
    Name("piece_nodes", "sub_body_nodes"),
    Name("piece_points", "sub_body_points"),
    Name("points_of_piece", "points_of_sub_body"),
    Name("tip_of_last_piece", "tip_of_last_sub_body"),
    Name("pieces", "windows", "attribute", ("agents/*", "wt_gym/envs/*", "envs_tests/env/*")),
    Name("def pieces", "def windows", "text", ("wt_gym/envs/wind_sampler.py",)),
    Name("lent", "lumped_masses", "code", ("wt_gym/multibody/observer_frame/*", "validation/*")),
    Name("marks", "counters", "attribute", _HISTORY),
    Name("memory marks matrix", "memory counters matrix", "text", _HISTORY),
    Name("trail", "trailing", "code", ("wt_gym/aerodynamics/*",)),
    Name("trail_core", "trailing_core", "code", ("wt_gym/aerodynamics/*",)),
    *(Name(old, new, "code") for names in deprecated.NAMES.values() for old, new in names.items()),
)
"""Names, those of certain files before the general ones where both are of one word."""

MODULES = {
    **deprecated.MODULES,
    "wt_gym.simulation.model.blade_pieces": "wt_gym.simulation.turbine_structure",
    "validation.unsteady_aerofoil": "validation.unsteady_airfoil",
}
"""Modules with a new name; ``wt_gym.agents`` is the folder ``agents`` of a clone."""

SPELLING = (
    ("aerofoil", "airfoil"), ("artefact", "artifact"), ("behaviour", "behavior"), ("centred", "centered"),
    ("centring", "centering"), ("centre", "center"), ("colour", "color"), ("equalis", "equaliz"),
    ("factoris", "factoriz"), ("favour", "favor"), ("generalis", "generaliz"), ("initialis", "initializ"),
    ("labelled", "labeled"), ("labelling", "labeling"), ("learnt", "learned"), ("licence", "license"),
    ("linearis", "lineariz"), ("manoeuvre", "maneuver"), ("metre", "meter"), ("minimis", "minimiz"),
    ("modelled", "modeled"), ("modelling", "modeling"), ("neighbour", "neighbor"), ("normalis", "normaliz"),
    ("offence", "offense"), ("optimise", "optimize"), ("optimisation", "optimization"), ("organis", "organiz"),
    ("parametris", "parametriz"), ("penalis", "penaliz"), ("realis", "realiz"), ("recognis", "recogniz"),
    ("regularis", "regulariz"), ("spoilt", "spoiled"), ("stabilis", "stabiliz"), ("summaris", "summariz"),
    ("synthesise", "synthesize"), ("travelled", "traveled"), ("travelling", "traveling"), ("visualis", "visualiz"),
    ("discretis", "discretiz"), ("vectoris", "vectoriz"),
)  # fmt: skip
"""Beginnings and parts of words, in the spelling of the US."""
WORDS = {"analyse": "analyze", "analysed": "analyzed", "analyser": "analyzer", "analysing": "analyzing"}
"""Whole words: others look alike (the plural analyses)."""
NOT_RESPELLED = re.compile(r"generalised[-_]alpha|realistic\w*|realism", re.IGNORECASE)
"""A name of an integrator, and words that are no others' spelling."""


def word(old: str) -> re.Pattern[str]:
    """Pattern of a whole word, which may begin and end with other characters than letters."""
    return re.compile(rf"(?<![\w-]){re.escape(old)}(?![\w])" if old[0] in "-" else rf"(?<!\w){re.escape(old)}(?!\w)")


class Renamer:
    """The table, ready to be used on the files of one tree."""

    def __init__(self, spelling: bool = True):
        self.spelling = spelling
        self._stems = [(re.compile(old, re.IGNORECASE), new) for old, new in SPELLING]
        self._words = [(re.compile(rf"\b{old}\b", re.IGNORECASE), new) for old, new in WORDS.items()]

    def path(self, relative: str) -> str:
        """Path of a file under its new name."""
        for old, new in MODULES.items():
            was, now = (name.replace(".", "/") + ".py" for name in (old, new))
            for prefix in ("", "wt_gym/"):
                if was.startswith(prefix) and relative == was.removeprefix(prefix):
                    return now.removeprefix(prefix)
        return relative

    def text(self, relative: str, text: str) -> str:
        """Text of a file with the new names."""
        kept = [line for line in text.splitlines() if KEEP in line]
        for module, moved in deprecated.MOVED.items():
            text = _moved(text, module, moved)
        for old, new in MODULES.items():
            text = _module(text, old, new)
        names = [
            n for n in NAMES if any(fnmatch(relative, pattern) for pattern in n.paths) and n.old.strip('"') in text
        ]
        anywhere = [n for n in names if n.where == "text"]
        in_code = [n for n in names if n.where != "text"]
        if in_code:
            text = _in_python(text, in_code) if relative.endswith(".py") else _in_prose(text, in_code)
        for name in anywhere:
            text = word(name.old).sub(name.new, text)
        if self.spelling:
            text = self._respelled(text)
        return _with_kept(text, kept)

    def _respelled(self, text: str) -> str:
        left = []

        def put_aside(match: re.Match[str]) -> str:
            left.append(match.group())
            return f"\0{len(left) - 1}\0"

        text = NOT_RESPELLED.sub(put_aside, text)
        for pattern, new in (*self._words, *self._stems):
            text = pattern.sub(lambda match, new=new: _in_case_of(match.group(), new), text)
        return re.sub("\0(\\d+)\0", lambda match: left[int(match.group(1))], text)


def _in_case_of(old: str, new: str) -> str:
    """New word in the case of the old one."""
    if old.isupper():
        return new.upper()
    return new.capitalize() if old[0].isupper() else new


def _with_kept(text: str, kept: list[str]) -> str:
    """Text in which the lines that keep old names are as they were."""
    if not kept:
        return text
    before = iter(kept)
    return "".join(
        next(before) + line[len(line.rstrip("\r\n")) :] if KEEP in line else line
        for line in text.splitlines(keepends=True)
    )


def _module(text: str, old: str, new: str) -> str:
    """Text with a module under its new name: dotted, in ``from package import module``, and as a path of a file."""
    package, _, last = old.rpartition(".")
    new_last = new.rpartition(".")[2]
    text = word(old).sub(new, text)
    text, imported = re.subn(rf"(from {re.escape(package)} import [^\n]*?)\b{last}\b", rf"\1{new_last}", text)
    if imported:
        text = re.sub(rf"(?<![\w./]){last}(?=\.\w|, \")", new_last, text)
    path, new_path = (name.removeprefix("wt_gym.").replace(".", "/") + ".py" for name in (old, new))
    text = text.replace(path, new_path)
    return re.sub(rf"(?<![\w/]){last}\.py\b", f"{new_last}.py", text)


def _moved(text: str, module: str, moved: dict[str, str]) -> str:
    """Text in which names that left a module are imported from where they are, under the names that the text uses."""

    def split(match: re.Match[str]) -> str:
        indent, body = match.groups()
        names = [name.strip() for name in re.sub(r"#[^\n]*", "", body).strip("()").split(",") if name.strip()]
        lines = []
        if others := [name for name in names if name.split()[0] not in moved]:
            lines.append(f"from {module} import {', '.join(others)}")
        for name in names:
            old, *alias = name.split()
            if old in moved:
                place, _, new = moved[old].rpartition(".")
                used = alias[-1] if alias else old
                lines.append(f"from {place} import {new}" + ("" if new == used else f" as {used}"))
        return "\n".join(indent + line for line in lines)

    text = re.sub(rf"^([ \t]*)from {re.escape(module)} import (\([^)]*\)|[^\n(]+)$", split, text, flags=re.MULTILINE)
    for old, new in moved.items():
        text = word(f"{module}.{old}").sub(new, text)
    return text


def _in_prose(text: str, names: list[Name]) -> str:
    """Text with new names in what is marked as code: fenced blocks and backticks."""

    def in_span(match: re.Match[str]) -> str:
        return _spans(match.group(), names)

    return re.sub(r"```.*?```|`[^`\n]+`", in_span, text, flags=re.DOTALL)


def _spans(code: str, names: list[Name]) -> str:
    """A stretch of code that cannot be read token by token, with the new names."""
    for name in names:
        old = re.escape(name.old)
        pattern = {
            "code": rf"(?<![\w]){old}(?!\w)",
            "attribute": rf"(?<=\.){old}(?!\w)",
            "keyword": rf"(?<![\w.]){old}(?==[^=])",
        }[name.where]
        code = re.sub(pattern, name.new, code)
    return code


def _in_python(text: str, names: list[Name]) -> str:
    """Source with new names for identifiers, in f-strings and in what docstrings mark as code."""
    by_old: dict[str, list[Name]] = {}
    for name in names:
        by_old.setdefault(name.old, []).append(name)
    tokens = list(tokenize.generate_tokens(io.StringIO(text).readline))
    lines = text.splitlines(keepends=True)
    changes: list[tuple[tuple[int, int], tuple[int, int], str]] = []
    depth = 0
    for k, token in enumerate(tokens):
        if token.type == tokenize.OP:
            depth += (token.string in "([{") - (token.string in ")]}")
        new = token.string
        if token.type == tokenize.NAME and token.string in by_old:
            behind_dot = k > 0 and tokens[k - 1].string == "."
            argument = depth > 0 and k + 1 < len(tokens) and tokens[k + 1].string == "=" and not behind_dot
            for name in by_old[token.string]:
                if (
                    name.where == "code"
                    or (name.where == "attribute" and behind_dot)
                    or (name.where == "keyword" and argument)
                ):
                    new = name.new
                    break
        elif token.type in (tokenize.STRING, tokenize.COMMENT) or token.type == getattr(tokenize, "FSTRING_MIDDLE", -1):
            new = _in_string(token.string, names)
        if new != token.string:
            changes.append((token.start, token.end, new))
    for (row, column), (end_row, end_column), new in reversed(changes):
        before, after = lines[row - 1][:column], lines[end_row - 1][end_column:]
        lines[row - 1 : end_row] = [before + new + after]
    return "".join(lines)


def _in_string(text: str, names: list[Name]) -> str:
    """A string or comment with the new names: code in backticks, fields of f-strings, parameters, lists of names."""
    text = re.sub(r"``[^`]+``|`[^`\n]+`", lambda match: _spans(match.group(), names), text)
    if re.match(r"[rRbB]?[fF]", text):
        text = re.sub(r"\{[^{}]*\}", lambda match: _spans(match.group(), names), text)
    for name in names:
        old = re.escape(name.old)
        if name.where == "code":
            text = re.sub(rf"(?m)^(\s+){old}(?= : )", rf"\1{name.new}", text)  # a parameter in a docstring
            text = re.sub(rf"(?m)^(\s+[^\n]* : [^\n]*?)(?<!\w){old}(?!\w)$", rf"\1{name.new}", text)  # its type
            if name.old[0].isupper() or "_" in name.old:
                text = re.sub(rf"""^(["']){old}(["'])$""", rf"\1{name.new}\2", text)  # in __all__
    return text


def files_of(tree: Path) -> list[str]:
    """Text files of a tree: those that git tracks or would, else all."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=tree, check=True,
            capture_output=True, text=True, encoding="utf-8",
        ).stdout.splitlines()  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        listed = [path.relative_to(tree).as_posix() for path in sorted(tree.rglob("*"))]
    return [
        name
        for name in listed
        if (name.endswith(SUFFIXES) or (name.startswith("scripts/") and "." not in name))
        and not any(fnmatch(name, pattern) for pattern in EXCLUDED)
        and (tree / name).is_file()
        and not (tree / name).is_symlink()
    ]


def rename(tree: Path, dry_run: bool = False, spelling: bool = True) -> int:
    """Rename in a tree; print what changes.

    Parameters
    ----------
    tree : path
    dry_run : bool
        Print only.
    spelling : bool
        Write words in the spelling of the US, too.

    Returns
    -------
    int
        Files that change.
    """
    renamer, changed = Renamer(spelling), 0
    for name in files_of(tree):
        path, moved = tree / name, renamer.path(name)
        try:
            old = path.read_bytes().decode()
        except UnicodeDecodeError:
            continue
        try:
            new = renamer.text(name, old)
        except (tokenize.TokenError, SyntaxError) as error:
            print(f"{name}: not read, {error}", file=sys.stderr)
            continue
        if new == old and moved == name:
            continue
        changed += 1
        if moved != name:
            print(f"{name} -> {moved}")
        for number, (was, now) in enumerate(zip(old.splitlines(), new.splitlines(), strict=False), start=1):
            if was != now:
                print(f"{name}:{number}: {now.strip()}")
        if not dry_run:
            path.write_bytes(new.encode())
            if moved != name:
                path.rename(tree / moved)
    return changed


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("path", type=Path, help="folder of the sources")
    parser.add_argument("--dry-run", action="store_true", help="print what would change")
    parser.add_argument("--no-spelling", action="store_true", help="names only, no spelling of other words")
    arguments = parser.parse_args()
    if not arguments.path.is_dir():
        parser.error(f"PATH must be a folder, got {arguments.path}")
    count = rename(arguments.path, arguments.dry_run, not arguments.no_spelling)
    print(f"{count} files {'would change' if arguments.dry_run else 'changed'}")


if __name__ == "__main__":
    main()
