"""Reading of windIO files: safe loading, check of keys and values, access by key path with clear errors.

Contents of files that were read and found valid before are kept as JSON in ``$WT_GYM_CACHE/turbines`` or the user's
cache directory, because reading and checking one again takes seconds.

Keys and values are held against windIO's schema: foreign keys are left aside, wrong values are refused. The schema is a
list of what windIO knows. What it does not know belongs to another tool, or is a typing error: it is taken out and
named in a note, with the known key that it resembles. Values are held against the schema only in the parts that a
turbine is built from, so that a flaw in the composite layers does not cost the turbine. Which keys a turbine cannot do
without is for its readers to say.
"""

import codecs
import difflib
import hashlib
import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import write_text_whole
from wt_gym.base.options import shown
from wt_gym.base.quantities import Array
from wt_gym.base.user_cache import cached_file, prune, read_cached, write_cached
from wt_gym.turbines.checks import check_array, check_number, fail
from wt_gym.turbines.windio_layouts import adopt_layout, to_version_2

_MOST_LEVELS, _MOST_ENTRIES = 50, 3_000_000  # the turbines of windIO have 12 levels and some ten thousand entries
_MOST_FILES, _MOST_BYTES = 300, 30_000_000  # read for one turbine; included ones count each time

_LONG = 1_000_000  # bytes from which a file is looked through before it is parsed, which takes 3 s per million


class Node:
    """A mapping of the file together with its key path, so that every error can say where it happened.

    Parameters
    ----------
    path : str
        Dotted key path of ``data`` in the file, empty for the top level.
    notes : list of str, optional
        Sentences on what was converted, assumed and left aside, the same for all nodes of a file.
    """

    def __init__(self, data: dict[str, Any], path: str = "", notes: list[str] | None = None) -> None:
        self.data = data
        self.path = path
        self.notes: list[str] = [] if notes is None else notes

    def note(self, key: str, text: str) -> None:
        """Add a sentence on an entry of this node."""
        self.notes.append(f"{self.where(key)}: {text}")

    def missing(self, key: str, words: str) -> None:
        """Note what stands in for an entry that the file does not have."""
        self.note(key, f"not in the file, {words}")

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
        """Return the mapping under the dotted ``key``; ``hint`` says what is expected where it is missing."""
        node = self
        for part in key.split("."):
            value = node.data.get(part)
            if value is None:
                raise TurbineDefinitionError(f"{node.where(part)}: missing, expected is {hint}")
            if not isinstance(value, dict):
                raise fail(node.where(part), value, hint)
            node = Node(value, node.where(part), self.notes)
        return node

    def part(self, key: str) -> "Node":
        """Return the mapping under the dotted ``key``, an empty one where the file has none."""
        return self.at(key) if key in self else Node({}, self.where(key), self.notes)

    def gives(self, key: str) -> bool:
        """Whether an entry is a number or list of numbers, and not only zeros, which stand for "to be computed"."""
        value = self.data.get(key)
        return value is not None and value != 0 and not (isinstance(value, list) and all(entry == 0 for entry in value))

    def items(self, key: str) -> "list[Node]":
        """Return the mappings of the list under ``key``."""
        entries = self._get(key, "a list of mappings")
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise fail(self.where(key), entries, "a list of mappings")
        return [Node(entry, f"{self.where(key)}[{i}]", self.notes) for i, entry in enumerate(entries)]

    def number(self, key: str, low: float, high: float, scale: float = 1.0) -> float:
        """Return a number of the file (range in file units) times ``scale``."""
        return scale * check_number(self.where(key), self._get(key, f"a number in [{low:g}, {high:g}]"), low, high)

    def number_or(self, key: str, low: float, high: float, default: float, words: str, scale: float = 1.0) -> float:
        """Return a number of the file as `number` does, else a default with a note."""
        if key in self:
            return self.number(key, low, high, scale)
        self.missing(key, words)
        return default

    def text(self, key: str) -> str:
        """Return a string of the file."""
        value = self._get(key, "a text")
        if not isinstance(value, str):
            raise fail(self.where(key), value, "a text")
        return value

    def array(self, key: str, size: int | None = None) -> Array:
        """Return a list of finite numbers, of a given length unless ``size`` is None."""
        return check_array(self.where(key), self._get(key, "a list of numbers"), size or "n")

    def grid(self, key: str = "grid") -> Array:
        """Return a nondimensional grid that ascends from 0 (root, base) to 1 (tip, top)."""
        values = self._get(key, "a list of numbers from 0 to 1")
        grid = check_array(self.where(key), values, "n", low=0.0, high=1.0, ascending=2)
        if grid[0] > 1e-6 or grid[-1] < 1.0 - 1e-6:
            raise fail(self.where(key), [float(grid[0]), float(grid[-1])], "a grid from 0 (root, base) to 1 (tip, top)")
        grid = grid.copy()
        grid[0], grid[-1] = 0.0, 1.0
        return grid

    def distribution(self, key: str, scale: float = 1.0) -> tuple[Array, Array]:
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
    """A windIO file as it is read."""

    root: Node
    """Its top level, in the layout of windIO 2.1 and without keys that windIO does not know."""
    alone: bool
    """Whether the content is all there is: the file includes no others, which may change without it."""
    resembling: dict[str, str]
    """Key path that the file lacks, and the unknown key of the file that resembles it."""


def read_windio(path: Path, content: bytes) -> WindioFile:
    """Load a windIO turbine file of version 2 or 1, safely, and hold what it says against windIO's schema.

    Parameters
    ----------
    content : bytes
        Of the file.
    """
    known = _cached(content)
    if known is not None:
        return WindioFile(Node(known["data"], "", known["notes"]), True, known["resembling"])
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
        _store(content, {"data": data, "notes": notes, "resembling": foreign.resembling})
    return WindioFile(Node(data, "", notes), alone, foreign.resembling)


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
            raise TurbineDefinitionError(f"!include {shown(name)}: one YAML file is needed, *.yaml or *.yml")
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


# ---- files that were read before -------------------------------------------------------------------------------------

_FORMAT = 5  # raise when what is checked before a file counts as valid changes
_KEPT = 100  # files, of some 0.5 MB each


def _cached(content: bytes) -> dict[str, Any] | None:
    """Return what a file of this content holds, or None if it has not been read before."""

    def read(path: Path) -> dict[str, Any]:
        digest, _, text = path.read_text(encoding="utf-8").partition("\n")
        if digest != _digest(text):
            raise ValueError("it is damaged")
        data = json.loads(text)
        if not isinstance(data, dict):
            raise ValueError("it holds no turbine")
        return data

    return read_cached("turbine", _path(content), read, (OSError, ValueError, RecursionError))


def _store(content: bytes, data: dict[str, Any]) -> None:
    """Keep what a file holds, unless JSON does not give back just this; a warning if it cannot be written."""
    path = _path(content)
    try:
        text = json.dumps(data, allow_nan=False)
    except (TypeError, ValueError):  # dates, integers of thousands of digits
        return
    if path is None or json.loads(text) != data:
        return
    if write_cached("turbine", path, lambda file: write_text_whole(file, f"{_digest(text)}\n{text}")):
        prune(path.parent.glob("*.json"), _KEPT)


def _path(content: bytes) -> Path | None:
    """Path by the digest of the file and the version of windIO whose schema it fits."""
    try:
        schema = version("windIO")
    except PackageNotFoundError:
        return None
    digest = hashlib.sha256(content)
    digest.update(f"\0{_FORMAT}\0{schema}".encode())
    return cached_file("turbines", f"{digest.hexdigest()[:32]}.json")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


# ---- keys and values against windIO's schema -------------------------------------------------------------------------

SCHEMA = "turbine/turbine_schema.yaml"

_ADDED = {
    "components": ("RNA",),
    "components.blade.structure.elastic_properties.structural_damping": ("damping_ratio",),
    "components.tower.structure.elastic_properties.structural_damping": ("damping_ratio",),
    "components.drivetrain.elastic_properties": ("spring_constant", "damping_coefficient", "inertia_tt"),
    "components.yaw.elastic_properties": ("spring_constant", "damping_coefficient"),
}
"""Keys that this package reads in addition to the schema's, by their parent's path."""

_UNCHECKED = (
    "airfoils",  # thousands of numbers, which their reader checks one by one
    "comments",
    "components.blade.outer_shape.surface",
    "components.blade.structure",
    "components.floating_platform",
    "components.jacket",
    "components.monopile",
    "components.mooring",
    "components.drivetrain.bedplate",
    "components.drivetrain.hss",
    "components.drivetrain.nose",
    "components.drivetrain.other_components",
    "materials",
    "outputs",
)
"""Parts whose values are not held against the schema: nothing is built from them, or their reader checks them."""

_ALIKE = 0.8  # Likeness of two keys, from 0 to 1, from which one is taken for a typing error of the other


@dataclass
class ForeignKeys:
    """Keys that windIO does not know."""

    by_parent: dict[str, list[str]] = field(default_factory=dict)
    """Key path of the mapping (``[*]`` for any entry of a list) and the foreign keys in it."""
    resembling: dict[str, str] = field(default_factory=dict)
    """Key path that windIO knows and the file lacks, and the foreign key beside it that resembles it."""

    def notes(self) -> list[str]:
        """Return a sentence for every mapping with foreign keys."""
        sentences = []
        for parent, keys in self.by_parent.items():
            where = parent or "top level"
            found = {known.removeprefix(f"{parent}.") if parent else known: key
                     for known, key in self.resembling.items() if known.rpartition(".")[0] == parent}  # fmt: skip
            alike = "".join(f"; {key} resembles {known}, which is missing" for known, key in found.items())
            sentences.append(f"{where}: keys that windIO does not know are left aside: {', '.join(keys)}{alike}")
        return sentences


def take_out_foreign_keys(data: dict[str, Any]) -> ForeignKeys:
    """Remove the keys that windIO's schema does not know from the content of a file, in place."""
    found = ForeignKeys()
    _scan(data, _schema(), "", found)
    return found


def check_values(data: dict[str, Any]) -> None:
    """Hold the values of the parts that a turbine is built from against windIO's schema."""
    from jsonschema import Draft7Validator

    checked = _without(data, "")
    errors = sorted(Draft7Validator(_optional(_schema())).iter_errors(checked), key=lambda error: error.json_path)
    if not errors:
        return
    path, message = errors[0].json_path.removeprefix("$").lstrip("."), errors[0].message
    if len(message) > 300:
        # The offending value comes first and may be a whole table; what is allowed stands at the end.
        message = f"{message[:100]} ... {message[-180:]}"
    more = f" (and {len(errors) - 1} more violations of the schema)" if len(errors) > 1 else ""
    raise TurbineDefinitionError(f"{path or 'top level'}: {message}{more}")


@cache
def _schema() -> dict[str, Any]:
    # windIO pulls in xarray and netCDF4, most of a second: only those who read a new file pay for it.
    import windIO
    from windIO.schemas import schemaPath

    out: dict[str, Any] = windIO.load_yaml(schemaPath / SCHEMA)
    return out


def _optional(schema: Any) -> Any:
    """Return a schema that requires no keys, without its name, by which references would be looked up elsewhere."""
    if isinstance(schema, dict):
        return {
            key: _optional(value)
            for key, value in schema.items()
            if not (key == "required" and isinstance(value, list)) and key != "$id"
        }
    return [_optional(value) for value in schema] if isinstance(schema, list) else schema


def _without(value: Any, path: str) -> Any:
    """Return a copy of the nested mappings without the parts that are not checked and without empty entries."""
    if not isinstance(value, dict):
        return value
    places = {key: f"{path}.{key}" if path else str(key) for key in value}
    return {
        key: _without(entry, places[key])
        for key, entry in value.items()
        if places[key] not in _UNCHECKED and entry is not None
    }


def _alternatives(schema: Any) -> list[dict[str, Any]]:
    """Return the schemas that describe a value: the one given, or the alternatives that it names."""
    if not isinstance(schema, dict):
        return []
    if "$ref" in schema:
        target: Any = _schema()
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        return _alternatives(target)
    found = [schema] if "properties" in schema or "items" in schema else []
    for key in ("oneOf", "anyOf", "allOf"):
        for option in schema.get(key, ()):
            found += _alternatives(option)
    return found


def _scan(value: Any, schema: Any, path: str, found: ForeignKeys) -> None:
    options = _alternatives(schema)
    if isinstance(value, list):
        items = [option["items"] for option in options if isinstance(option.get("items"), dict)]
        if items and any(isinstance(entry, (dict, list)) for entry in value):
            for entry in value:
                _scan(entry, {"anyOf": items}, f"{path}[*]", found)
        return
    known: dict[str, list[Any]] = {}
    # Where windIO admits keys of others, they stay unnamed unless they look like typing errors.
    open_to_others = any(option.get("additionalProperties") is True for option in options)
    for option in options:
        for key, part in option.get("properties", {}).items():
            known.setdefault(key, []).append(part)
    if not isinstance(value, dict) or not known:
        return
    for key in _ADDED.get(path, ()):
        known[key] = [{}]
    foreign = [key for key in value if key not in known]
    for key in foreign:
        missing = [name for name in known if value.get(name) is None]
        alike = difflib.get_close_matches(str(key), missing, 1, _ALIKE)
        for name in alike:
            found.resembling[f"{path}.{name}" if path else name] = str(key)
        if alike or not open_to_others:
            keys = found.by_parent.setdefault(path, [])
            if str(key) not in keys:
                keys.append(str(key))
        del value[key]
    for key, entry in value.items():
        _scan(entry, {"anyOf": known[key]}, f"{path}.{key}" if path else str(key), found)
