"""Input files of OpenFAST as text: lines ``value  KEY``, written in order, and changed by their keyword."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.base.errors import SimulationError
from wt_gym.turbines.openfast_text import TextFile

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

__all__ = ["InputFile"]

_QUOTED = re.compile(r'"([^"]+)"')


def shown_value(value: object) -> str:
    """A value as OpenFAST reads it: flags as words, numbers with all their digits, texts in quotes."""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, int):
        return f"{value:d}"
    if isinstance(value, float):
        return f"{value:.15g}"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return ", ".join(map(shown_value, value))
    raise SimulationError(f"a value of an input file must be a flag, number, text or sequence, got {value!r:.100}")


def lines_of(rows: Iterable[str | tuple[str, object]]) -> list[str]:
    """Lines of rows: texts as they are, pairs (key, value) as ``value  key``."""
    return [row if isinstance(row, str) else f"{shown_value(row[1]):<26s}  {row[0]:<22s} -" for row in rows]


def plain_line(key: str, word: str) -> str:
    """Line of a word without quotes."""
    return f"{word:<26s}  {key:<22s} -"


def write_lines(path: Path, title: str, rows: Iterable[str | tuple[str, object]]) -> None:
    """Write a file with two lines of heading."""
    heading = [f"------- {title} ".ljust(100, "-"), "Written by wt_gym"]
    path.write_text("\n".join([*heading, *lines_of(rows)]) + "\n", encoding="utf-8")


class InputFile:
    """An input file that exists, to be changed and written elsewhere."""

    def __init__(self, path: Path):
        self._read = TextFile(path)
        self.path, self.lines = path, list(self._read.lines)

    def __contains__(self, key: str) -> bool:
        return key in self._read

    def text(self, key: str) -> str:
        """Value of a keyword without quotes."""
        return self._read.text(key)

    def number(self, key: str, default: float | None = None) -> float:
        """Number of a keyword."""
        return self._read.number(key, default)

    def set(self, key: str, value: object) -> None:
        """Replace the value of a keyword.

        Raises
        ------
        TurbineDefinitionError
            If no line has the keyword.
        """
        self.lines[self._read.line_of(key)] = lines_of([(key, value)])[0]

    def set_default(self, key: str) -> None:
        """Leave the value of a keyword to OpenFAST."""
        self.lines[self._read.line_of(key)] = plain_line(key, "default")

    def is_default(self, key: str) -> bool:
        """Whether the value of a keyword is left to OpenFAST."""
        return self._read.is_default(key)

    def set_outputs(self, names: Sequence[str]) -> None:
        """Replace the list of outputs at the end of the file.

        Raises
        ------
        SimulationError
            If the file has none.
        """
        starts = [i for i, line in enumerate(self.lines) if re.match(r"\s*OutList\b", line)]
        if not starts:
            raise SimulationError(f"{self.path}: no line OutList, so that it gives no outputs")
        first = starts[0] + 1
        last = next((i for i in range(first, len(self.lines)) if self.lines[i].startswith("END")), None)
        if last is None:
            raise SimulationError(f"{self.path}: no line END after OutList")
        # a list of nodes may follow: nothing reads it
        self.lines[first:] = [f'"{name}"' for name in names] + ["END of OutList", "-" * 80]

    def resolve_paths(self) -> None:
        """Make the names of files that exist beside this one whole paths, so that it can be written elsewhere."""
        folder = self.path.parent

        def whole(match: re.Match[str]) -> str:
            name = match.group(1).replace("\\", "/")
            found = folder / name
            return f'"{found.resolve()}"' if found.is_file() else match.group(0)

        self.lines = [_QUOTED.sub(whole, line) for line in self.lines]

    def rename(self, name: str, other: str) -> None:
        """Replace a name in quotes wherever it stands."""
        self.lines = [line.replace(f'"{name}"', f'"{other}"') for line in self.lines]

    def write(self, path: Path) -> None:
        """Write the file."""
        path.write_text("\n".join(self.lines) + "\n", encoding="utf-8")
