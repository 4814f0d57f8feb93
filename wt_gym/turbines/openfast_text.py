"""Text files of OpenFAST: scalars by their keyword, tables by their header.

OpenFAST reads its files line by line and checks the keyword of each. The order and number of lines change from release
to release, the keywords hardly ever. What is read here is therefore found by its keyword, in files of any release from
OpenFAST 2 to 5. A reader by line numbers, such as that of ``openfast_io``, belongs to the format of one release: with a
file of another it takes the number of the line beside.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.errors import TurbineDefinitionError
from wt_gym.turbines.checks import fail, short

__all__ = ["TextFile", "existing_file"]

_TOKEN = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s,]+")
_MOST_BYTES = 20_000_000
_DEFAULT = re.compile(r"[\"']?default[\"']?", re.IGNORECASE)


def existing_file(folder: Path, name: str, what: str) -> Path:
    """Return the path of a file that another one in ``folder`` names.

    Raises
    ------
    TurbineDefinitionError
        If there is no such file.
    """
    path = folder / name.replace("\\", "/")
    if not path.is_file():
        raise TurbineDefinitionError(f"{what}: {short(name, 200)}: there is no such file in {folder}")
    return path


class TextFile:
    """Lines of one input file.

    Parameters
    ----------
    path : Path
    comment : str
        ``"!"`` for files whose comment lines begin with it (AirfoilInfo, DISCON.IN); empty for the others.

    Raises
    ------
    TurbineDefinitionError
        If the file cannot be read or is larger than 20 MB.
    """

    def __init__(self, path: Path, comment: str = "") -> None:
        self.path = path
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise fail(str(path), f"{path.stat().st_size} bytes", f"a file of at most {_MOST_BYTES} bytes")
            text = path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise TurbineDefinitionError(f"{path}: cannot be read: {error.strerror}") from error
        lines = text.splitlines()
        self.lines = [line for line in lines if not line.lstrip().startswith("!")] if comment else lines
        self._places: dict[str, tuple[int, list[str]]] = {}
        for i, line in enumerate(self.lines):
            # The first two lines of primary files are titles; rules of dashes or equals signs head sections.
            if (comment or i > 1) and not line.lstrip().startswith(("--", "==")):
                self._index(i, line)

    def _index(self, i: int, line: str) -> None:
        """Note the keyword of a line: the word before the dash, or after the exclamation mark."""
        before, mark, after = line.partition("!")
        tokens = _TOKEN.findall(before)
        if mark and tokens and not any(token == "-" for token in tokens) and _is_value(tokens[-1]):
            # DISCON.IN: values ! KEY - what it is
            key = _TOKEN.findall(after)[:1]
            values = tokens
        else:
            # values KEY - what it is
            stop = next((k for k, token in enumerate(tokens) if k and (token == "-" or token.startswith("- "))), None)
            words = tokens[:stop] if stop is not None else tokens[: _first_key(tokens) + 1]
            if len(words) < 2:
                return
            key, values = words[-1:], words[:-1]
        if key and values:
            self._places.setdefault(_normal(key[0]), (i, values))

    def __contains__(self, key: str) -> bool:
        """Whether a line has this keyword."""
        return _normal(key) in self._places

    def fail(self, key: str, value: Any, allowed: str) -> TurbineDefinitionError:
        """Build (not raise) an error that names file and keyword."""
        return fail(f"{self.path.name}: {key}", value, allowed)

    def line_of(self, key: str) -> int:
        """Return the index of the line with a keyword.

        Raises
        ------
        TurbineDefinitionError
            If no line has it.
        """
        return self._place(key)[0]

    def _place(self, key: str) -> tuple[int, list[str]]:
        place = self._places.get(_normal(key))
        if place is None:
            raise TurbineDefinitionError(f"{self.path.name}: {key}: missing, no line has this keyword")
        return place

    def is_default(self, key: str) -> bool:
        """Whether the value of a keyword is missing or left to OpenFAST (``default``)."""
        return key not in self or _DEFAULT.fullmatch(self._place(key)[1][0]) is not None

    def text(self, key: str) -> str:
        """Return the value of a keyword without quotes."""
        return self._place(key)[1][0].strip("\"'")

    def number(self, key: str, default: float | None = None) -> float:
        """Return the number of a keyword; ``default`` where no line has it.

        Raises
        ------
        TurbineDefinitionError
            If it is missing and has no default, or is not a finite number.
        """
        if default is not None and key not in self:
            return default
        return self._number(key, self._place(key)[1][0])

    def integer(self, key: str, default: int | None = None) -> int:
        """Return the whole number of a keyword; ``default`` where no line has it."""
        value = self.number(key, None if default is None else float(default))
        if value != int(value):
            raise self.fail(key, value, "a whole number")
        return int(value)

    def flag(self, key: str, default: bool = False) -> bool:
        """Return the logical value of a keyword; ``default`` where no line has it."""
        if key not in self:
            return default
        word = self.text(key).lower().strip(".")
        if word in ("true", "t", "1"):
            return True
        if word in ("false", "f", "0"):
            return False
        raise self.fail(key, self.text(key), "True or False")

    def array(self, key: str) -> NDArray[np.float64]:
        """Return all numbers of a keyword's line (n,)."""
        return np.array([self._number(key, value) for value in self._place(key)[1]])

    def _number(self, key: str, token: str) -> float:
        value = _as_number(token)
        if value is None or not np.isfinite(value):
            raise self.fail(key, token, "a finite number")
        return value

    def rows(self, first: int, count: int, what: str, least: int = 1) -> list[list[str]]:
        """Return the words of ``count`` lines from the index ``first``, each with at least ``least`` words."""
        rows = [_TOKEN.findall(line.partition("!")[0]) for line in self.lines[first : first + max(count, 0)]]
        if count < 1 or len(rows) < count or any(len(row) < least for row in rows):
            raise self.fail(what, f"{count} rows announced", f"at least one row, and as many as announced ({what})")
        return rows

    def numbers(self, first: int, count: int, columns: int, what: str) -> NDArray[np.float64]:
        """Return a block of numbers (count, columns) that begins in the line with the index ``first``."""
        rows = self.rows(first, count, what, columns)
        return np.array([[self._number(what, word) for word in row[:columns]] for row in rows])

    def sections(
        self, count_key: str, fraction: str, columns: Sequence[str], what: str
    ) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]:
        """Return the table of a beam and its first column (n,), the fraction of the length from 0 to 1.

        Parameters
        ----------
        count_key : str
            As of `table`.
        fraction : str
            Name of the first column.
        columns : sequence of str
            Required columns, in lower case.
        what : str
            The beam, for messages.

        Raises
        ------
        TurbineDefinitionError
            As of `table`, for a missing column and for fractions that do not run from 0 to 1.
        """
        table = self.table(count_key, fraction)
        for name in columns:
            if name not in table:
                raise TurbineDefinitionError(f"{self.path.name}: no column {name} in the table of the {what}")
        along = table[fraction.lower()].copy()
        if abs(along[0]) > 1e-6 or abs(along[-1] - 1.0) > 1e-6:
            raise self.fail(fraction, [float(along[0]), float(along[-1])], "fractions from 0 to 1")
        along[0], along[-1] = 0.0, 1.0
        return table, along

    def table(self, count_key: str, first_column: str) -> dict[str, NDArray[np.float64]]:
        """Return a table by the names in its header.

        Parameters
        ----------
        count_key : str
            Keyword of the line with the number of rows, above the table.
        first_column : str
            Name of the first column, with which the header begins; a line of units follows it.

        Returns
        -------
        dict of ndarray (n,)
            By the names of the columns in lower case, as far as every row has numbers.
        """
        count = self.integer(count_key)
        start = self.line_of(count_key)
        for i in range(start + 1, len(self.lines)):
            names = _TOKEN.findall(self.lines[i].partition("!")[0])
            if names and _normal(names[0]) == _normal(first_column):
                rows = self.rows(i + 2, count, first_column)
                width = min(len(names), *(len(row) for row in rows))
                values = [[self._number(first_column, word) for word in row[:width]] for row in rows]
                return dict(zip(map(_normal, names[:width]), np.array(values).T, strict=True))
        raise TurbineDefinitionError(f"{self.path.name}: no table that begins with the column {first_column}")


def _first_key(tokens: list[str]) -> int:
    """Return the index of the first word that is not a value; the last one where all are."""
    for k, token in enumerate(tokens):
        if k and not _is_value(token):
            return k
    return len(tokens) - 1


def _is_value(token: str) -> bool:
    quoted = token[0] in "\"'"
    return quoted or _as_number(token) is not None or token.lower() in ("true", "false", "t", "f", "default")


def _as_number(token: str) -> float | None:
    """Return a number as Fortran writes it (1.0D+03), None for another word."""
    word = token.strip("\"'")
    try:
        return float(word)
    except ValueError:
        pass
    try:
        return float(re.sub(r"[dD]", "e", word))
    except ValueError:
        return None


def _normal(key: str) -> str:
    """Return a keyword without brackets, in lower case: BldFile(1) and BldFile1 are the same."""
    return key.lower().replace("(", "").replace(")", "").strip("\"'")
