"""Text files of OpenFAST: scalars by their keyword, tables by their header.

OpenFAST reads its files line by line and checks the keyword of each. The order and number of lines change from release
to release, the keywords hardly ever. What is read here is therefore found by its keyword, in files of any release from
OpenFAST 2 to 5. A reader by line numbers, such as that of ``openfast_io``, belongs to the format of one release: with a
file of another it takes the number of the line beside.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import decoded_text
from wt_gym.turbines.checks import fail, short

__all__ = ["TextFile", "as_number", "existing_file"]

_TOKEN = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s,;!]+")
"""Words: quoted, or up to a separator. ROSCO's exclamation mark between values and keyword is one."""
_CONTENT = re.compile(r"(?:[\s,;]*(?:\"[^\"]*\"|'[^']*'|[^\s,;!#%]+))*")
"""Part of a line before the first comment character, ``!``, ``#`` or ``%``."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[edq][+-]?\d+|[+-]\d+)?", re.IGNORECASE)
"""A real number as Fortran reads it: 1, .5, 1.0D+03, 1.0+3."""
_REPEAT = re.compile(r"(\d+)\*(.+)")
_LOGICAL = re.compile(r"\.?(t|f|true|false)\.?", re.IGNORECASE)
_NO_VALUE = re.compile(r"\s*,|.*,\s*,")
_INCLUDED = re.compile(r"@\s*(?:(\d+)(?:-(\d+))?\s+in\s+)?(?:\"([^\"]*)\"|'([^']*)'|(\S+))", re.IGNORECASE)
_MOST_BYTES = 20_000_000
_MOST_LEVELS = 10
"""Files that include each other."""
_MOST_REPEATS = 1000
_DEFAULT = re.compile(r"[\"']?default[\"']?", re.IGNORECASE)


def existing_file(folder: Path, name: str, what: str) -> Path:
    """Return the path of a file that another one in ``folder`` names.

    Raises
    ------
    TurbineDefinitionError
        If there is no such file.
    """
    path = folder / name.replace("\\", "/").strip()
    if not path.is_file():
        raise TurbineDefinitionError(f"{what}: {short(name, 200)}: there is no such file in {folder}")
    return path


class TextFile:
    """Lines of one input file.

    OpenFAST has two ways of reading. Primary files, ElastoDyn, ServoDyn and BeamDyn are read line by line, with values
    first. AeroDyn, AirfoilInfo and ElastoDyn blades (``ProcessComFile`` of its library) lose comments, empty lines and
    what follows ``!``, ``#`` or ``%`` first, may include other files by ``@``, and may have a value behind its keyword.

    Parameters
    ----------
    free : bool
        Whether the file is read in the second way.
    titles : int
        Lines at the beginning that hold no keywords.

    Attributes
    ----------
    lines : list of str
        As they are in the file, or without comments.
    comments : str
        Comments that were taken out.

    Raises
    ------
    TurbineDefinitionError
        If the file cannot be read or is larger than 20 MB.
    """

    def __init__(self, path: Path, free: bool = False, titles: int = 2) -> None:
        self.path = path
        self.comments = ""
        self.lines = self._without_comments(path) if free else _lines_of(path)
        self._places: dict[str, list[tuple[int, list[str]]]] = {}
        self._reversed: dict[str, list[tuple[int, list[str]]]] = {}
        for i, line in enumerate(self.lines):
            tokens = _TOKEN.findall(line)
            if "outlist" in (token.lower() for token in tokens[:2]):
                break  # names of outputs follow, which may be those of keywords
            # rules of dashes or equals signs head sections
            if i >= titles and tokens and not line.lstrip().startswith(("--", "==", "!", "#", "%")):
                self._index(i, tokens)

    def _without_comments(self, path: Path, first: int = 1, last: int | None = None, level: int = 0) -> list[str]:
        """Return the lines of a file, and of those that it includes, that have more than a comment."""
        if level > _MOST_LEVELS:
            raise fail(f"{self.path}: @", path.name, f"files that include others up to {_MOST_LEVELS} levels deep")
        out: list[str] = []
        for line in _lines_of(path)[first - 1 : last]:
            content = _content(line)
            self.comments += line[len(content) :] + "\n"
            include = _INCLUDED.match(content.strip())
            if include is not None:
                begin, end, *names = include.groups()
                other = existing_file(path.parent, next(filter(None, names), ""), f"{path.name}: @")
                out += self._without_comments(other, int(begin or 1), int(end or 0) or None, level + 1)
            elif content.strip():
                out.append(content)
        return out

    def _index(self, i: int, tokens: list[str]) -> None:
        """Note the keyword of a line, the first word that is not a value; also the other way round."""
        if tokens[1:2] not in ([], ["-"]):
            self._reversed.setdefault(_normal(tokens[0]), []).append((i, tokens[1:2]))
        for k, token in enumerate(tokens):
            if token == "-":
                return
            if k and not _is_value(token):
                self._places.setdefault(_normal(token), []).append((i, _expanded(tokens[:k])))
                return

    def __contains__(self, key: str) -> bool:
        """Whether a line has this keyword."""
        return bool(self._lines(key))

    def _lines(self, key: str) -> list[tuple[int, list[str]]]:
        """Return index and values of the lines with a keyword; with the keyword in front if there are no others."""
        return self._places.get(_normal(key)) or self._reversed.get(_normal(key), [])

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
        places = self._lines(key)
        if not places:
            raise TurbineDefinitionError(f"{self.path.name}: {key}: missing, no line has this keyword")
        values = [words for _, words in places]
        if any(words != values[0] for words in values):
            raise self.fail(key, [" ".join(words) for words in values], "one value: several lines have this keyword")
        return places[0]

    def entries(self, *keys: str) -> list[tuple[int, str, str]]:
        """Return index, keyword (as in ``keys``) and value of every line with one of some keywords, in their order."""
        places = [
            (i, key, words[0])
            for key in keys
            for order in (self._places, self._reversed)
            for i, words in order.get(_normal(key), [])
        ]
        return sorted(places)

    def words(self, except_key: str = "") -> list[list[str]]:
        """Return the words of all lines below the titles, without comments and the line of one keyword."""
        hidden = {i for i, _ in self._lines(except_key)} if except_key else set()
        lines = (_TOKEN.findall(_content(line)) for i, line in enumerate(self.lines) if i > 1 and i not in hidden)
        return [words for words in lines if words]

    def is_default(self, key: str) -> bool:
        """Whether the value of a keyword is missing or left to OpenFAST (``default``)."""
        return key not in self or _DEFAULT.fullmatch(self._place(key)[1][0]) is not None

    def text(self, key: str) -> str:
        """Return the value of a keyword without quotes."""
        return self._place(key)[1][0].strip("\"'").strip()

    def number(self, key: str, default: float | None = None) -> float:
        """Return the number of a keyword; ``default`` where no line has it.

        Raises
        ------
        TurbineDefinitionError
            If it is missing and has no default, or is not a finite number.
        """
        if default is not None and key not in self:
            return default
        return self.value(key, self._place(key)[1][0])

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
        word = self.text(key).lower().lstrip(".")[:1]  # Fortran looks no further
        if word in ("t", "1"):
            return True
        if word in ("f", "0"):
            return False
        raise self.fail(key, self.text(key), "True or False")

    def array(self, key: str) -> NDArray[np.float64]:
        """Return all numbers of a keyword's line (n,)."""
        return np.array([self.value(key, value) for value in self._place(key)[1]])

    def value(self, key: str, token: str) -> float:
        """Return a word as a number; ``key`` says what it is in the message for any other word."""
        value = as_number(token)
        if value is None or not np.isfinite(value):
            raise self.fail(key, token, "a finite number")
        return value

    def rows(self, first: int, count: int, what: str, least: int = 1, skip_text: bool = False) -> list[list[str]]:
        """Return the words of ``count`` lines from the index ``first``, each with at least ``least`` words.

        Parameters
        ----------
        first, count : int
            Index of the first line, number of lines without those that are empty or hold a comment only.
        what : str
            The lines, for messages.
        skip_text : bool
            Whether lines that do not begin with a number are passed over, such as names and units of columns.
        """
        rows: list[list[str]] = []
        for line in self.lines[first:]:
            if len(rows) >= count:
                break
            content = _content(line)
            words = _expanded(_TOKEN.findall(content))
            if not words or (skip_text and as_number(words[0]) is None):
                continue
            if _NO_VALUE.match(content):
                raise self.fail(what, content.strip(), "rows with a value between any two commas")
            rows.append(words)
        if count < 1 or len(rows) < count or any(len(row) < least for row in rows):
            raise self.fail(what, f"{count} rows announced", f"at least one row, and as many as announced ({what})")
        return rows

    def numbers(self, first: int, count: int, columns: int, what: str, skip_text: bool = False) -> NDArray[np.float64]:
        """Return a block of numbers (count, columns) that begins in the line with the index ``first``, see `rows`."""
        rows = self.rows(first, count, what, columns, skip_text)
        return np.array([[self.value(what, word) for word in row[:columns]] for row in rows])

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
            Name of a column that the header has; a line of units may follow it.

        Returns
        -------
        dict of ndarray (n,)
            By the names of the columns in lower case, as far as every row has numbers.
        """
        count = self.integer(count_key)
        start = self.line_of(count_key)
        for i in range(start + 1, len(self.lines)):
            names = [_normal(name) for name in _TOKEN.findall(_content(self.lines[i]))]
            if _normal(first_column) in names:
                rows = self.rows(i + 1, count, first_column, skip_text=True)
                width = min(len(names), *(len(row) for row in rows))
                values = [[self.value(first_column, word) for word in row[:width]] for row in rows]
                return dict(zip(names[:width], np.array(values).T, strict=True))
        raise TurbineDefinitionError(f"{self.path.name}: no table with the column {first_column}")


def _lines_of(path: Path) -> list[str]:
    """Return the lines of a file in UTF-8 or, where it has other bytes, Latin-1."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise fail(str(path), f"{path.stat().st_size} bytes", f"a file of at most {_MOST_BYTES} bytes")
        data = path.read_bytes()
    except OSError as error:
        raise TurbineDefinitionError(f"{path}: cannot be read: {error.strerror}") from error
    return decoded_text(data).split("\n")


def _content(line: str) -> str:
    """Return a line without its comment."""
    match = _CONTENT.match(line)
    assert match is not None  # it matches an empty text
    return match[0]


def _expanded(words: list[str]) -> list[str]:
    """Return words with Fortran's repetitions written out: 3*0.0 is 0.0 0.0 0.0."""
    out: list[str] = []
    for word in words:
        repeat = _REPEAT.fullmatch(word)
        count = int(repeat[1]) if repeat is not None else 1
        out += [word] if repeat is None or count > _MOST_REPEATS else count * [repeat[2]]
    return out


def _is_value(token: str) -> bool:
    if token[0] in "\"'" or _LOGICAL.fullmatch(token) or token.lower() == "default":
        return True
    return as_number(_expanded([token])[0]) is not None


def as_number(token: str) -> float | None:
    """Return a number as Fortran reads it, None for another word."""
    word = token.strip("\"'").strip().lower()
    if _NUMBER.fullmatch(word) is None:
        return float(word) if word in ("nan", "inf", "+inf", "-inf", "infinity") else None
    try:
        return float(word)
    except ValueError:  # an exponent of Fortran
        return float(re.sub(r"(?<=[\d.])(?:[dq]|(?=[+-]))", "e", word, count=1))


def _normal(key: str) -> str:
    """Return a keyword without brackets, in lower case: BldFile(1) and BldFile1 are the same."""
    return key.lower().replace("(", "").replace(")", "").strip("\"'")
