"""Reading of windIO files: safe loading, check of keys and values, access by key path with clear errors."""

import codecs
import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines import file_cache
from wt_gym.turbines.checks import check_array, check_ascending, check_number, fail, short
from wt_gym.turbines.windio_keys import check_values, take_out_foreign_keys
from wt_gym.turbines.windio_layouts import adopt_layout
from wt_gym.turbines.windio_versions import to_version_2

__all__ = ["Node", "WindioFile", "read_windio", "within"]

_MOST_LEVELS, _MOST_ENTRIES = 50, 3_000_000  # the turbines of windIO have 12 levels and some ten thousand entries
_MOST_FILES, _MOST_BYTES = 300, 30_000_000  # read for one turbine; included ones count each time

_LONG = 1_000_000  # bytes from which a file is looked through before it is parsed, which takes 3 s per million


class Node:
    """A mapping of the file together with its key path, so that every error can say where it happened.

    Parameters
    ----------
    data : dict
    path : str
        Dotted key path of ``data`` in the file, empty for the top level.
    """

    def __init__(self, data: dict[str, Any], path: str = "") -> None:
        self.data = data
        self.path = path

    def where(self, key: str) -> str:
        """Return the full key path of an entry of this node."""
        return f"{self.path}.{key}" if self.path else key

    def __contains__(self, key: str) -> bool:
        """Whether the dotted ``key`` is present and not empty."""
        node: Any = self.data
        for part in key.split("."):
            if not isinstance(node, dict) or node.get(part) is None:
                return False
            node = node[part]
        return True

    def at(self, key: str, hint: str = "a mapping") -> "Node":
        """Return the mapping under the dotted ``key``.

        Raises
        ------
        TurbineDefinitionError
            Naming the first key of the path that is missing and ``hint``, what is expected there.
        """
        node = self
        for part in key.split("."):
            value = node.data.get(part)
            if value is None:
                raise TurbineDefinitionError(f"{node.where(part)}: missing, expected is {hint}")
            if not isinstance(value, dict):
                raise fail(node.where(part), value, hint)
            node = Node(value, node.where(part))
        return node

    def items(self, key: str) -> list["Node"]:
        """Return the mappings of the list under ``key``."""
        entries = self._get(key, "a list of mappings")
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise fail(self.where(key), entries, "a list of mappings")
        return [Node(entry, f"{self.where(key)}[{i}]") for i, entry in enumerate(entries)]

    def number(self, key: str, low: float, high: float, scale: float = 1.0, *, hint: str = "") -> float:
        """Return a number of the file (range in file units) times ``scale``."""
        allowed = f"a number in [{low:g}, {high:g}]"
        return scale * check_number(self.where(key), self._get(key, f"{allowed}{hint}"), low, high)

    def text(self, key: str) -> str:
        """Return a string of the file."""
        value = self._get(key, "a text")
        if not isinstance(value, str):
            raise fail(self.where(key), value, "a text")
        return value

    def array(self, key: str, size: int | None = None) -> NDArray[np.float64]:
        """Return a list of finite numbers, of a given length unless ``size`` is None."""
        return check_array(self.where(key), self._get(key, "a list of numbers"), (size,))

    def grid(self, key: str = "grid") -> NDArray[np.float64]:
        """Return a nondimensional grid that ascends from 0 (root, base) to 1 (tip, top)."""
        grid = check_array(self.where(key), self._get(key, "a list of numbers from 0 to 1"), (None,), low=0.0, high=1.0)
        check_ascending(self.where(key), grid)
        if grid[0] > 1e-6 or grid[-1] < 1.0 - 1e-6:
            raise fail(self.where(key), [float(grid[0]), float(grid[-1])], "a grid from 0 (root, base) to 1 (tip, top)")
        grid = grid.copy()
        grid[0], grid[-1] = 0.0, 1.0
        return grid

    def distribution(self, key: str, scale: float = 1.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return grid (n,) and values (n,) times ``scale`` of a quantity distributed along the component."""
        node = self.at(key, "a mapping with grid and values")
        grid = node.grid()
        return grid, scale * node.array("values", grid.size)

    def _get(self, key: str, hint: str) -> Any:
        value = self.data.get(key)
        if value is None:
            raise TurbineDefinitionError(f"{self.where(key)}: missing, expected is {hint}")
        return value


@contextmanager
def within(path: str) -> Iterator[None]:
    """Put the key path of the file in front of an error that does not name it yet (a dataclass about its own field)."""
    try:
        yield
    except TurbineDefinitionError as error:
        if str(error).startswith(path):
            raise
        raise TurbineDefinitionError(f"{path}: {error}") from error


@dataclass(frozen=True)
class WindioFile:
    """A windIO file as it is read.

    Attributes
    ----------
    root : Node
        Its top level, in the layout of windIO 2.1 and without keys that windIO does not know.
    alone : bool
        Whether the content is all there is: the file includes no others, which may change without it.
    notes : tuple of str
        What was converted, moved and left aside, in plain words.
    resembling : dict
        Key path that the file lacks, and the unknown key of the file that resembles it.
    """

    root: Node
    alone: bool
    notes: tuple[str, ...]
    resembling: dict[str, str]


def read_windio(path: Path, content: bytes) -> WindioFile:
    """Load a windIO turbine file of version 2 or 1, safely, and hold what it says against windIO's schema.

    Parameters
    ----------
    path : Path
    content : bytes
        Of the file.

    Returns
    -------
    WindioFile

    Raises
    ------
    TurbineDefinitionError
        If the file cannot be read, is not a YAML or JSON file, is not for windIO 1 or 2, or a value that is used does
        not fit the schema. One error, naming the key path; further violations are counted.
    """
    known = file_cache.load(content)
    if known is not None:
        return WindioFile(Node(known["data"]), True, tuple(known["notes"]), known["resembling"])
    data, alone = _load(path, content)
    notes: list[str] = []
    data = to_version_2(data, notes)
    for key in ("name", "assembly", "components"):
        if data.get(key) is None:
            raise TurbineDefinitionError(f"{key}: missing, the windIO schema requires it")
    adopt_layout(data, notes)
    foreign = take_out_foreign_keys(data)
    check_values(data)
    notes += foreign.notes()
    if alone:
        file_cache.store(content, {"data": data, "notes": notes, "resembling": foreign.resembling})
    return WindioFile(Node(data), alone, tuple(notes), foreign.resembling)


def _load(path: Path, content: bytes) -> tuple[dict[str, Any], bool]:
    """What a file holds, and whether it includes no others."""
    from ruamel.yaml.error import YAMLError

    if len(content) > _LONG and b"components" not in content and b"!include" not in content:
        raise TurbineDefinitionError("components: missing, this is not a turbine file")
    loader = _Loader()
    try:
        data = loader.load(path, content)
    except UnicodeDecodeError as error:
        raise TurbineDefinitionError(f"cannot be read: not UTF-8 text ({error})") from error
    except (YAMLError, IndexError) as error:  # the latter where a number is said to stand and nothing does
        raise TurbineDefinitionError(f"not a valid YAML file: {error}{_advice(content)}") from error
    except RecursionError as error:
        raise TurbineDefinitionError("nested too deep, or includes itself") from error
    except (OSError, ValueError) as error:
        raise TurbineDefinitionError(f"cannot be read: {error}") from error
    _check_extent(data)
    if not isinstance(data, dict):
        raise fail("top level", data, "a mapping with name, windIO_version, assembly and components")
    return _unshared(data), loader.files == 1


def _unshared(value: Any) -> Any:
    """Return a copy in which what an alias repeats is written out, so that one place can be changed alone."""
    if isinstance(value, dict):
        return {key: _unshared(entry) for key, entry in value.items()}
    return [_unshared(entry) for entry in value] if isinstance(value, list) else value


def _advice(content: bytes) -> str:
    """Return what is likely wrong with a text that is not YAML, beginning with ``;``, or nothing."""
    for number, line in enumerate(content.splitlines(), 1):
        if b"\t" in line[: len(line) - len(line.lstrip())]:
            return f"; line {number} is indented by a tab, YAML takes spaces only"
    if content[:20].lstrip().lower().startswith((b"<!doctype", b"<html")):
        return "; this is a web page, not the file itself"
    if content.startswith(b"version https://git-lfs"):
        return "; this is a pointer of Git LFS, not the file itself: git lfs pull"
    return ""


class _Loader:
    """YAML files with what they include (``!include file.yaml``, as windIO has it), within limits.

    windIO's own loader follows every include: ten files, each of which includes the next ten times, are read ten
    thousand million times.
    """

    def __init__(self) -> None:
        self._open: list[Path] = []
        self.files = self._bytes = 0

    def load(self, path: Path, content: bytes | None = None) -> Any:
        """What a file holds, or would hold with this content."""
        from ruamel.yaml import YAML
        from ruamel.yaml.constructor import SafeConstructor
        from ruamel.yaml.error import ReusedAnchorWarning

        if path.resolve() in self._open:
            raise TurbineDefinitionError(f"{path.name} includes itself")
        content = (path.read_bytes() if content is None else content).removeprefix(codecs.BOM_UTF8)
        self.files, self._bytes = self.files + 1, self._bytes + len(content)
        if self.files > _MOST_FILES or self._bytes > _MOST_BYTES:
            raise TurbineDefinitionError(f"includes more than {_MOST_FILES} files, or {_MOST_BYTES:.0e} bytes")
        _check_brackets(content)

        class Including(SafeConstructor):
            """A class of its own, because ruamel keeps constructors in classes."""

        Including.add_constructor("!include", lambda _, node: self._include(path.parent, node))
        yaml = YAML(typ="safe", pure=True)
        yaml.Constructor = Including
        self._open.append(path.resolve())
        try:
            if content.lstrip()[:1] == b"{" and (data := _as_json(content)) is not None:
                return data
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ReusedAnchorWarning)  # the later one holds, as YAML has it
                return yaml.load(content)
        finally:
            self._open.pop()

    def _include(self, folder: Path, node: Any) -> Any:
        """Content of an included file, which stands beside the one that includes it."""
        name = node.value.replace("\\", "/") if isinstance(node.value, str) else node.value  # as Windows writes it
        if not isinstance(name, str) or Path(name).suffix.lower() not in (".yaml", ".yml"):
            raise TurbineDefinitionError(f"!include {short(name, 100)}: one YAML file is needed, *.yaml or *.yml")
        if not (folder / name).is_file():  # nor a device or a pipe, which have no end
            raise TurbineDefinitionError(f"!include {name}: there is no such file in {folder}")
        return self.load(folder / name)


def _as_json(content: bytes) -> Any:
    """What a JSON text holds, None for what is not JSON; JSON may be indented by tabs, which YAML forbids."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        data = dict(pairs)
        if len(data) < len(pairs):
            raise ValueError("a key occurs twice")  # the YAML parser says which and where
        return data

    try:
        return json.loads(content, object_pairs_hook=unique)
    except (ValueError, RecursionError):
        return None


def _check_brackets(content: bytes) -> None:
    """Refuse brackets that are nested so deep that the parser would take seconds to give up."""
    characters = np.frombuffer(content, np.uint8)
    depth = np.cumsum(np.isin(characters, list(b"[{")).astype(int) - np.isin(characters, list(b"]}")))
    if depth.size and depth.max() > 10 * _MOST_LEVELS:
        raise TurbineDefinitionError(f"nested too deep: {depth.max()} open brackets")


def _check_extent(data: Any) -> None:
    """Refuse what a few lines of anchors and aliases can blow up to; validation would walk through all of it."""
    entries: dict[int, int] = {}

    def count(value: Any, depth: int) -> int:
        if not isinstance(value, (dict, list)):
            return 1
        if depth > _MOST_LEVELS:
            raise TurbineDefinitionError(f"nested deeper than {_MOST_LEVELS} levels, or within itself")
        if id(value) not in entries:
            inner = value.values() if isinstance(value, dict) else value
            entries[id(value)] = 1 + sum(count(part, depth + 1) for part in inner)
        return entries[id(value)]

    if count(data, 0) > _MOST_ENTRIES:
        raise TurbineDefinitionError(f"more than {_MOST_ENTRIES} entries once its aliases are written out")
