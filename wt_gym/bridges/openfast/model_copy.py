"""The files that an OpenFAST model names, copied beside a run, so that its folder can be moved."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from wt_gym.bridges.openfast.input_text import InputFile

__all__ = ["FOLDER", "copy_named_files"]

FOLDER = "model"
"""Folder of the copies."""
_NAMED = re.compile(r'"([^"\n]{1,250})"|@([^\s"]{1,250})')
_MOST_BYTES = 20_000_000
"""Larger files are data, which name nothing."""


def copy_named_files(files: Sequence[InputFile], folder: Path) -> None:
    """Copy what input files name, and what that names, into `FOLDER`, and have the input files name the copies.

    The copies stand to each other as the files do, so that relative names in them hold. Files of one stem are copied
    together where the stem is named, as HydroDyn's potential-flow data. Whole paths in copied files stay as they are.

    Parameters
    ----------
    files : sequence of InputFile
        To be written into ``folder``.
    folder : Path
    """
    found: dict[Path, None] = {}
    for file in files:
        _collect(file.path.parent.resolve(), "\n".join(file.lines), found)
    if not found:
        return
    root = Path(os.path.commonpath([path.parent for path in found]))
    for path in found:
        copy = folder / FOLDER / path.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    for file in files:
        base = file.path.parent.resolve()
        for name in {match.group(1) for match in _NAMED.finditer("\n".join(file.lines)) if match.group(1)}:
            if any(_files_of(base, name)):
                inside = _place(base, name).relative_to(root)
                file.rename(name, (Path(FOLDER) / inside).as_posix())


def _place(base: Path, name: str) -> Path:
    return Path(os.path.normpath(base / name.replace("\\", "/")))


def _files_of(base: Path, name: str) -> Iterator[Path]:
    """Files that a name in a file of a folder stands for: that file, else those of the stem."""
    place = _place(base, name)
    if place.is_file():
        yield place
    elif place.parent.is_dir():
        for path in sorted(place.parent.iterdir()):
            if path.name.startswith(f"{place.name}.") and path.is_file():
                yield path


def _collect(base: Path, text: str, found: dict[Path, None]) -> None:
    for match in _NAMED.finditer(text):
        for path in _files_of(base, match.group(1) or match.group(2)):
            if path in found:
                continue
            found[path] = None
            if path.stat().st_size <= _MOST_BYTES and b"\0" not in (content := path.read_bytes()):
                _collect(path.parent, content.decode("utf-8", "replace"), found)
