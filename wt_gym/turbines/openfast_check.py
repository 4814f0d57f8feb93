"""A second reading of an OpenFAST model, by the package ``openfast_io``, to compare with.

``openfast_io`` reads lines by their number, in the format of its own release. A file of another release it refuses at
the first word where it expects a number, or reads with the numbers of lines beside.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from wt_gym.turbines.openfast_text import TextFile, existing_file

__all__ = ["compare_with_openfast_io"]

_REFUSALS = (ValueError, IndexError, KeyError, TypeError, AttributeError, OSError)
"""What its reader raises where a line is not what it expects."""
_SHOWN = 3
_ROUNDING = 1e-9


def compare_with_openfast_io(path: str | Path) -> list[str]:
    """Read the primary files of a model with ``openfast_io``, and compare each number with that beside its keyword.

    Parameters
    ----------
    path : str or Path
        Primary file (``.fst``).

    Returns
    -------
    list of str
        One line for each module: how many numbers agree, which do not, or where the package stops.

    Raises
    ------
    ModuleNotFoundError
        If the package is not installed (extra ``openfast``).
    """
    import openfast_io  # noqa: F401 - fails by the name of the package where it is missing
    from openfast_io.FAST_reader import InputReader_OpenFAST

    primary = TextFile(Path(path))
    folder = primary.path.parent
    reader = InputReader_OpenFAST()
    reader.FAST_InputFile, reader.FAST_directory = primary.path.name, str(folder)
    elastodyn = TextFile(existing_file(folder, primary.text("EDFile"), "EDFile"))
    tower = TextFile(existing_file(elastodyn.path.parent, elastodyn.text("TwrFile"), "TwrFile"))
    lines = [
        _line("Fst", reader, reader.read_MainInput, primary),
        _line("ElastoDyn", reader, lambda: reader.read_ElastoDyn(str(elastodyn.path)), elastodyn),
        _line("ElastoDynTower", reader, lambda: reader.read_ElastoDynTower(str(tower.path)), tower),
    ]
    for module, key, read in (
        ("AeroDyn", "AeroFile", reader.read_AeroDyn),
        ("ServoDyn", "ServoFile", reader.read_ServoDyn),
    ):
        file = TextFile(existing_file(folder, primary.text(key), key))
        _name_the_file(reader, key, primary.text(key))
        lines.append(_line(module, reader, read, file))
    return lines


def _name_the_file(reader: Any, key: str, name: str) -> None:
    """Give the reader the path of a file, which it has not where it stopped before in the primary file."""
    reader.fst_vt["Fst"].setdefault(key, name)
    reader.fst_vt["Fst"].setdefault(f"{key}_path", str(Path(name).parent))


def _line(module: str, reader: Any, read: Callable[[], None], file: TextFile) -> str:
    stop = ""
    try:
        read()
    except _REFUSALS as error:
        stop = f"; it stops with {type(error).__name__}: {str(error)[:80]}"
    same, other = 0, []
    for key, value in reader.fst_vt[module].items():
        if not isinstance(value, (bool, int, float)) or key not in file:
            continue
        expected = _value(file, key)
        if expected is None:
            continue
        if abs(float(value) - expected) <= _ROUNDING * max(abs(expected), 1.0):
            same += 1
        else:
            other.append(f"{key} {value:g} instead of {expected:g}")
    shown = [*other[:_SHOWN], *(["..."] if len(other) > _SHOWN else [])]
    differ = f"; {len(other)} differ: {', '.join(shown)}" if other else ""
    return f"openfast_io, {module} ({file.path.name}): {same} numbers agree{differ}{stop}"


def _value(file: TextFile, key: str) -> float | None:
    """Return the number or flag beside a keyword, None for a word."""
    word = file.text(key)
    if word.lower() in ("true", "t", "false", "f"):
        return float(word.lower().startswith("t"))
    try:
        return float(word)
    except ValueError:
        return None
