"""Identity of the code that a program part depends on: digests of its sources and data, found by following imports.

Comments, docstrings and blank lines do not count. A new module, or one that moves, needs no entry in any list.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import logging
import tokenize
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from wt_gym.base.files import write_text_whole
from wt_gym.base.user_cache import user_cache

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["code_of", "source_files", "sources_digest"]

_log = logging.getLogger(__name__)
_PACKAGE = Path(__file__).parents[1]
_APART = {
    "wt_gym",  # registers ids from `wt_gym.tasks` and the records, and holds the version
    "wt_gym.analysis.results",  # holds and weighs what runs gave
    "wt_gym.envs.rendering",  # draws what has been simulated
    "wt_gym.runs.progress",  # prints how far a run is
    "wt_gym.simulation.recorder",  # writes what has been simulated
    "wt_gym.turbines.catalogue",  # reads turbines, whose values are an identity of their own
}
"""Modules that change no number of an episode; what only they import does not count either."""
_SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.ENCODING, tokenize.ENDMARKER}
_FORMATTED = getattr(tokenize, "FSTRING_MIDDLE", None)
_STATEMENT_BEGINS = {tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
_MOST_STORED = 4000


class _Source(NamedTuple):
    """One source: digest of its code, dotted names that it imports, texts that may name its data.

    ``loads_all`` says that it imports by names that the program computes.
    """

    code: str
    imports: tuple[str, ...]
    texts: tuple[str, ...]
    loads_all: bool


def sources_digest(*modules: str, package: Path = _PACKAGE) -> str:
    """Digest of everything that some modules load: their own code, that of all they import, and its data.

    Parameters
    ----------
    *modules : str
        Dotted names, for example ``"wt_gym.envs.running_record"``.
    package : pathlib.Path
        Folder ``wt_gym``, by default that of this program.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    total = hashlib.sha256()
    files, sources = _loaded(modules, package)
    for name, path in files.items():
        source = sources.get(name)
        total.update(f"{name} {_digest(path.read_bytes()) if source is None else source.code}\n".encode())
    return total.hexdigest()[:32]


def source_files(*modules: str, package: Path = _PACKAGE) -> dict[str, Path]:
    """Files that some modules load, by dotted name; a data file follows the name of its module after a slash.

    Imports count wherever they stand, within functions too, except those under ``TYPE_CHECKING``. The packages
    above a module, which Python runs first, do not count: they hold nothing but names. A package that imports its
    modules by computed names counts with all of them. Data of a module that asks for ``__file__`` are the files whose
    names stand in its source, and those in such folders.

    Parameters
    ----------
    *modules, package
        As of `sources_digest`.
    """
    return _loaded(modules, package)[0]


def _loaded(modules: tuple[str, ...], package: Path) -> tuple[dict[str, Path], dict[str, _Source]]:
    """Files by name, and the sources among them."""
    paths, store = _module_files(package), _Store()
    files: dict[str, Path] = {}
    sources: dict[str, _Source] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in files:
            continue
        files[name] = path = paths[name]
        sources[name] = source = store.source(path)
        waiting += {_module_of(text, paths) for text in source.imports} - _APART - {""}
        if source.loads_all and path.name == "__init__.py":
            waiting += [other for other in paths if other.rpartition(".")[0] == name]
        files |= {f"{name}/{file.relative_to(path.parent).as_posix()}": file for file in _data(path.parent, source)}
    store.save()
    return dict(sorted(files.items())), sources


def _module_files(package: Path) -> dict[str, Path]:
    """Path of each module by its name."""
    paths = {}
    for path in package.rglob("*.py"):
        parts = ["wt_gym", *path.relative_to(package).with_suffix("").parts]
        paths[".".join(parts[:-1] if path.name == "__init__.py" else parts)] = path
    return paths


def _module_of(text: str, paths: dict[str, Path]) -> str:
    """Module that a dotted text names, itself or by a thing in it; empty where there is none."""
    while text and text not in paths:
        text = text.rpartition(".")[0]
    return text


def _data(folder: Path, source: _Source) -> Iterator[Path]:
    """Files that a source names, and those in folders without code that it names."""
    for text in source.texts:
        for path in folder.rglob(text):
            if path.is_file() and path.suffix != ".py":
                yield path
            elif path.is_dir() and not (path / "__init__.py").exists():
                yield from (file for file in path.rglob("*") if file.is_file())


class _Store:
    """Sources by the digest of their bytes, stored for the next process: reading all takes a second."""

    def __init__(self) -> None:
        cache_folder = user_cache()
        own = _digest(Path(__file__).read_bytes())[:16]  # another reader may find other things
        self._file = None if cache_folder is None else cache_folder / f"sources-{own}.json"
        self._sources, self._additions = self._load(), dict[str, _Source]()

    def source(self, path: Path) -> _Source:
        """Source that a file holds."""
        content = path.read_bytes()
        key = _digest(content)
        if key not in self._sources:
            self._sources[key] = self._additions[key] = _source(content.decode("utf-8").replace("\r\n", "\n"))
        return self._sources[key]

    def save(self) -> None:
        """Write the file if there are additions; where nothing can be written, the next process reads again."""
        if self._file is None or not self._additions:
            return
        entries = self._sources if len(self._sources) <= _MOST_STORED else self._additions
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text_whole(self._file, json.dumps(entries))
        except OSError as error:
            _log.warning("digests of sources could not be kept in %s (%s)", self._file, error)

    def _load(self) -> dict[str, _Source]:
        if self._file is None:
            return {}
        try:
            rows: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
            return {key: _Source(code, tuple(names), tuple(texts), bool(all_))
                    for key, (code, names, texts, all_) in rows.items()}  # fmt: skip
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError, AttributeError) as error:
            _log.warning("digests of sources in %s are unreadable (%s); they are made again", self._file, error)
            return {}


def _source(text: str) -> _Source:
    """Read a source."""
    nodes = list(_running(ast.parse(text)))
    names = [name for node in nodes for name in _imported(node)]
    identifiers = {node.id for node in nodes if isinstance(node, ast.Name)}
    texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    data_names = {text for text in texts if text.replace(".", "").replace("_", "").isalnum()}
    return _Source(
        _digest(code_of(text).encode()),
        tuple(dict.fromkeys(name for name in names if name.partition(".")[0] == "wt_gym")),
        tuple(sorted(data_names)) if "__file__" in identifiers else (),
        any(getattr(node, "id", getattr(node, "attr", "")) == "import_module" for node in nodes),
    )


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a tree except those under ``TYPE_CHECKING``, which no program runs."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            for other in child.orelse:
                yield other
                yield from _running(other)
            continue
        yield child
        yield from _running(child)


def _imported(node: ast.AST) -> list[str]:
    """Dotted names that a statement imports; the names of a module may be modules or things in it."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and not node.level:
        return [f"{node.module}.{alias.name}" for alias in node.names]
    return []


def code_of(source: str) -> str:
    """Tokens of a source with its lines and indents, without comments, blank lines, docstrings and all other space.

    Python 3.12 takes formatted strings apart where earlier versions give one token; without space both are the same.
    """
    code, begins = [], True
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in _SILENT or (token.type == tokenize.NEWLINE and begins):  # the latter ends a docstring
            continue
        if token.type in _STATEMENT_BEGINS:
            code.append({tokenize.NEWLINE: "\n", tokenize.INDENT: "{", tokenize.DEDENT: "}"}[token.type])
            begins = True
        elif not (token.type == tokenize.STRING and begins):
            text = token.string
            if token.type == _FORMATTED:  # whose doubled braces are single ones here
                text = text.replace("{", "{{").replace("}", "}}")
            code.append("".join(text.split()))
            begins = False
    return "".join(code)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
