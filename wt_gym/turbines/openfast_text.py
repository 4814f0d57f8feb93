"""Text files of OpenFAST: scalars by their keyword, tables by their header, read, changed and written.

OpenFAST reads its files line by line and checks the keyword of each. The order and number of lines change from release
to release, the keywords hardly ever. What is read here is therefore found by its keyword, in files of any release from
OpenFAST 2 to 5. A reader by line numbers, such as that of ``openfast_io``, belongs to the format of one release: with a
file of another it takes the number of the line beside.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.base.files import decoded_text
from wt_gym.base.options import shown
from wt_gym.base.quantities import Array
from wt_gym.turbines.checks import fail

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
_MOST_LEVELS = 10  # Files that include each other
_MOST_REPEATS = 1000
_DEFAULT = re.compile(r"[\"']?default[\"']?", re.IGNORECASE)
_KEYWORD = re.compile(r".{26}  (\S+) +-")  # Line of a template: value and keyword
_QUOTED = re.compile(r'"([^"]+)"')
_BLADED = 5  # Value of PCMode and VSContrl: a library as Bladed takes it


def existing_file(folder: Path, name: str, what: str) -> Path:
    """Return the path of a file that another one in ``folder`` names; ``what`` names the keyword in messages."""
    path = folder / name.replace("\\", "/").strip()
    if not path.is_file():
        raise TurbineDefinitionError(f"{what}: {shown(name)}: there is no such file in {folder}")
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
        If the file cannot be read or is larger than 20 MB; later, naming file and keyword, for a value that is missing
        or not what is asked for.
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

    def missing(self, key: str) -> TurbineDefinitionError:
        """Build (not raise) the error for a keyword that no line has."""
        return TurbineDefinitionError(f"{self.path.name}: {key}: missing, no line has this keyword")

    def line_of(self, key: str) -> int:
        """Return the index of the line with a keyword."""
        return self._place(key)[0]

    def _place(self, key: str) -> tuple[int, list[str]]:
        places = self._lines(key)
        if not places:
            raise self.missing(key)
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

    def file(self, key: str, free: bool = False) -> Self:
        """Open the file that a keyword names."""
        return type(self)(existing_file(self.path.parent, self.text(key), key), free)

    def number(self, key: str, default: float | None = None) -> float:
        """Return the finite number of a keyword; ``default`` where no line has it."""
        if default is not None and key not in self:
            return default
        words = self._place(key)[1]
        if len(words) > 1 and as_number(words[1]) is not None:
            raise self.fail(key, " ".join(words), "one number, with a decimal point")  # a comma separates two
        return self.value(key, words[0])

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

    def array(self, key: str) -> Array:
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

        Lines that are empty or hold a comment only do not count; with ``skip_text`` nor do those that do not begin with
        a number, such as names and units of columns. ``what`` names the lines in messages.
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

    def numbers(self, first: int, count: int, columns: int, what: str, skip_text: bool = False) -> Array:
        """Return a block of numbers (count, columns) that begins in the line with the index ``first``, see `rows`."""
        rows = self.rows(first, count, what, columns, skip_text)
        return np.array([[self.value(what, word) for word in row[:columns]] for row in rows])

    def table(self, count_key: str, first_column: str, *needed: str, part: str = "") -> dict[str, Array]:
        """Return a table by the names in its header, in lower case, as far as every row has numbers (n,).

        Parameters
        ----------
        count_key : str
            Keyword of the line with the number of rows, above the table.
        first_column : str
            Name of a column that the header has; a line of units may follow it.
        *needed : str
            Required columns, in lower case.
        part : str
            Part of the turbine that the table describes, for messages.
        """
        names, rows = self._named_rows(count_key, first_column)
        width = min(len(names), *(len(row) for row in rows))
        values = [[self.value(first_column, word) for word in row[:width]] for row in rows]
        table = dict(zip(names[:width], np.array(values).T, strict=True))
        for name in needed:
            if name not in table:
                raise TurbineDefinitionError(f"{self.path.name}: no column {name} in the table of the {part}")
        return table

    def records(self, count_key: str, first_column: str) -> list[dict[str, str]]:
        """Return the rows of a table as words by the names in its header, in lower case; none where it has no rows.

        Parameters
        ----------
        count_key, first_column : str
            As of `table`.
        """
        if self.integer(count_key, 0) == 0:
            return []
        names, rows = self._named_rows(count_key, first_column)
        names = names[: next((k for k, name in enumerate(names) if name.startswith("[")), None)]  # a remark
        for row in rows:
            if len(row) < len(names):
                raise self.fail(f"row of {first_column}", " ".join(row), f"{len(names)} values")
        return [dict(zip(names, row, strict=False)) for row in rows]

    def _named_rows(self, count_key: str, first_column: str) -> tuple[list[str], list[list[str]]]:
        """Return names of columns and words of the rows of a table."""
        count = self.integer(count_key)
        start = self.line_of(count_key)
        for i in range(start + 1, len(self.lines)):
            names = [_normal(name) for name in _TOKEN.findall(_content(self.lines[i]))]
            if _normal(first_column) in names:
                break
        else:
            raise TurbineDefinitionError(f"{self.path.name}: no table with the column {first_column}")
        return names, self.rows(i + 1, count, first_column, skip_text=True)

    def unit_grid(self, name: str, fraction: Array) -> Array:
        """Return fractions of a length (n,), which must run from 0 to 1, without rounding at their ends."""
        if abs(fraction[0]) > 1e-6 or abs(fraction[-1] - 1.0) > 1e-6:
            raise self.fail(name, [float(fraction[0]), float(fraction[-1])], "fractions from 0 to 1")
        fraction = fraction.copy()
        fraction[0], fraction[-1] = 0.0, 1.0
        return fraction


class Model:
    """Files of an OpenFAST model, and sentences on what its readers assume and leave aside.

    Attributes
    ----------
    primary, elastodyn, aerodyn : TextFile
    servodyn : TextFile or None
        None where CompServo is 0.
    torque, pitch : TextFile or None
        ROSCO's parameter file (DISCON.IN) where it controls torque (VSContrl 5) and pitch (PCMode 5).
    n_blades : int
    notes : list of str
    """

    def __init__(self, path: Path) -> None:
        self.notes: list[str] = []
        self.primary = primary = TextFile(path)
        _require_wind_turbine(primary)
        self.elastodyn = primary.file("EDFile")
        _require_plain(self.elastodyn)
        self.aerodyn = primary.file("AeroFile", free=True)
        self.servodyn = primary.file("ServoFile", free=True) if primary.integer("CompServo", 0) == 1 else None
        self.torque, self.pitch = self._controllers()
        self.n_blades = self.elastodyn.integer("NumBl")

    def note(self, text: str, file: TextFile | None = None) -> None:
        """Add a sentence, about a file."""
        self.notes.append(text if file is None else f"{file.path.name}: {text}")

    def number(self, file: TextFile | None, key: str, default: float, words: str) -> float:
        """Return the number of a keyword, a default with a note where the model has none."""
        if file is not None and key in file:
            return file.number(key)
        self.note(f"{key}: not in the model, {words} assumed")
        return default

    def first_mode(self, file: TextFile, name: str) -> float:
        """Return the factor of a bending stiffness that its modal tuners stand for: that of the first mode."""
        first, second = f"{name}(1)", f"{name}(2)"
        one, two = file.number(first, 1.0), file.number(second, 1.0)
        if one != two:
            self.note(f"{first} = {one:g} is taken for all modes, {second} = {two:g} is left aside", file)
        return one

    def damping(self, file: TextFile, *keys: str) -> float:
        """Return the damping ratio of the first keyword [%], with a note where the others differ."""
        values = [file.number(key) for key in keys if key in file]
        if not values:
            raise file.missing(keys[0])
        if max(values) != min(values):
            given = ", ".join(f"{value:g}" for value in values)
            self.note(f"damping {given} % of the modes, {values[0]:g} % is taken for all", file)
        return 0.01 * values[0]

    def _controllers(self) -> tuple[TextFile | None, TextFile | None]:
        """Return ROSCO's parameter file for torque and pitch if ServoDyn names one."""
        servodyn = self.servodyn
        if servodyn is None:
            self.note("CompServo: 0, the model has no controller")
            return None, None
        modes = [servodyn.integer(key, 0) for key in ("VSContrl", "PCMode")]
        if _BLADED not in modes:
            return None, None
        name = servodyn.text("DLL_InFile").replace("\\", "/")
        path = servodyn.path.parent / name
        if not path.is_file():
            self.note(f"DLL_InFile {name}: there is no such file, gains are not known", servodyn)
            return None, None
        file = TextFile(path, titles=0)
        if "VS_RtPwr" not in file or "PC_GS_angles" not in file:
            self.note("not a DISCON.IN of ROSCO, gains are not known", file)
            return None, None
        for mode, what in zip(modes, ("torque", "pitch"), strict=True):
            if mode != _BLADED:
                self.note(f"left aside: control of the {what}, which ServoDyn does not leave to it", file)
        torque, pitch = (file if mode == _BLADED else None for mode in modes)
        return torque, pitch


def _require_wind_turbine(file: TextFile) -> None:
    """Refuse models of other machines, and of parts of one."""
    if "EDFile" not in file:
        raise TurbineDefinitionError(f"{file.path.name}: EDFile: missing; is this the primary file of OpenFAST (.fst)?")
    if "MHK" in file and file.text("MHK").lower() not in ("0", "false", "f"):
        raise file.fail("MHK", file.text("MHK"), "0 (turbines in water are not modeled)")
    for key, allowed, words, default in (
        ("NRotors", (1,), "1", 1),
        ("CompElast", (1, 2), "1 or 2 (Simplified-ElastoDyn has no flexible blades and tower)", None),
        ("CompAero", (2,), "2 (blade and polars are read from AeroDyn 15)", None),
    ):
        if file.integer(key, default) not in allowed:
            raise file.fail(key, file.integer(key), words)


def _require_plain(file: TextFile) -> None:
    """Refuse what ElastoDyn's primary file has and would make another turbine here."""
    n = file.integer("NumBl")
    for i in range(n):
        key = f"TipMass({i + 1})"
        if file.number(key, 0.0) != 0.0:
            raise file.fail(key, file.number(key), "0 (masses at the blade tips are not modeled)")
    if n == 2 and file.flag("TeetDOF"):
        raise file.fail("TeetDOF", True, "False (hubs that teeter are not modeled)")
    if n == 2 and abs(file.number("UndSling", 0.0)) > 0.0:
        raise file.fail("UndSling", file.number("UndSling"), "0")
    if file.flag("Furling"):
        raise file.fail("Furling", True, "False (rotors and tails that furl are not modeled)")


class InputFile(TextFile):
    """An input file that exists, to be changed by keyword and written elsewhere."""

    def set(self, key: str, value: object) -> None:
        """Replace the value of a keyword, which a line must have; None leaves it to OpenFAST."""
        self.lines[self.line_of(key)] = _lines([(key, value)])[0]

    def set_all(self, values: Mapping[str, object]) -> None:
        """Replace the values of keywords."""
        for key, value in values.items():
            self.set(key, value)

    def set_outputs(self, names: Sequence[str]) -> None:
        """Replace the list of outputs at the end of the file."""
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
            path = folder / match.group(1).replace("\\", "/")
            return f'"{path.resolve()}"' if path.is_file() else match.group(0)

        self.lines = [_QUOTED.sub(whole, line) for line in self.lines]

    def rename(self, name: str, other: str) -> None:
        """Replace a name in quotes wherever it stands."""
        self.lines = [line.replace(f'"{name}"', f'"{other}"') for line in self.lines]

    def write(self, path: Path) -> None:
        """Write the file."""
        path.write_text("\n".join(self.lines) + "\n", encoding="utf-8")


def write_lines(path: Path, title: str, rows: Iterable[str | tuple[str, object]]) -> None:
    """Write a file with two lines of heading, texts as they are and pairs (key, value) as ``value  key``."""
    heading = [f"------- {title} ".ljust(100, "-"), "Written by wt_gym"]
    path.write_text("\n".join([*heading, *_lines(rows)]) + "\n", encoding="utf-8")


def write_from_template(
    path: Path,
    title: str,
    values: Mapping[str, object],
    tables: Mapping[str, Iterable[str | tuple[str, object]]] | None = None,
) -> None:
    """Write an input file from the template of its name, in ``data/openfast``: all that any turbine has alike.

    A keyword of the template with the value ``?`` needs one, a line ``<name>`` stands for rows of a table.

    Parameters
    ----------
    values : mapping
        Values of keywords in place of the template's.
    tables : mapping, optional
        Rows by the name of their line.

    Raises
    ------
    KeyError
        For keywords that the template has not, and for values and tables that are missing.
    """
    template = resources.files("wt_gym.turbines").joinpath("data", "openfast", path.name)
    values, tables = dict(values), dict(tables or {})
    rows: list[str | tuple[str, object]] = []
    for line in template.read_text(encoding="utf-8").splitlines():
        match = _KEYWORD.fullmatch(line)
        keyword = "" if match is None else match[1]
        if line.startswith("<"):
            rows += tables.pop(line[1:-1])
        elif keyword in values or line.startswith("?"):
            rows.append((keyword, values.pop(keyword)))
        else:
            rows.append(line)
    if unknown := [*values, *tables]:
        raise KeyError(f"{path.name} has no keywords {sorted(unknown)}")
    write_lines(path, title, rows)


def _lines(rows: Iterable[str | tuple[str, object]]) -> list[str]:
    return [row if isinstance(row, str) else f"{_shown(row[1]):<26s}  {row[0]:<22s} -" for row in rows]


def _shown(value: object) -> str:
    """A value as OpenFAST reads it: flags as words, numbers with all their digits, texts in quotes, None its own."""
    if value is None:
        return "default"
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, int):
        return f"{value:d}"
    if isinstance(value, float):
        return f"{value:.15g}"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return ", ".join(map(_shown, value))
    raise SimulationError(f"a value of an input file must be a flag, number, text or sequence, got {value!r:.100}")


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
