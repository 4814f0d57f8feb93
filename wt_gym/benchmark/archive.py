"""Results of the benchmark and the models that made them, in one compressed file."""

from __future__ import annotations

import hashlib
import io
import json
import lzma
import tarfile
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import BenchmarkError
from wt_gym.base.files import write_whole
from wt_gym.runs.definition import digest

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

__all__ = ["MODELS", "RUNS", "model_folder", "read_archive", "write_archive"]

RUNS, MODELS = "runs", "models"
"""Folders of an archive: results as `wt_gym.benchmark.ResultFolder` has them, and models by `model_folder`."""
_MANIFEST = "manifest.json"


def model_folder(digests: Mapping[str, str]) -> str:
    """Name of the folder of a model: a digest of the sums of its files.

    Parameters
    ----------
    digests : mapping
        SHA-256 sums of the files by name, as the definition of a run has them.
    """
    return digest(dict(digests))


def write_archive(path: Path, runs: Iterable[Path], models: Mapping[str, Iterable[Path]]) -> dict[str, str]:
    """Write an archive (tar, xz); the same content gives the same bytes.

    Parameters
    ----------
    path : pathlib.Path
    runs : iterable of pathlib.Path
        Result files.
    models : mapping
        Files of each model by the name of its folder.

    Returns
    -------
    dict
        SHA-256 sum of each member by its name; the archive has it as ``manifest.json``.
    """
    members = {f"{RUNS}/{file.name}": file.read_bytes() for file in runs}
    for folder, files in models.items():
        members |= {f"{MODELS}/{folder}/{file.name}": file.read_bytes() for file in files}
    sums = {name: hashlib.sha256(members[name]).hexdigest() for name in sorted(members)}
    whole = io.BytesIO()
    with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, content in ((_MANIFEST, _json(sums)), *((name, members[name]) for name in sums)):
            about = tarfile.TarInfo(name)
            about.size = len(content)
            archive.addfile(about, io.BytesIO(content))
    write_whole(path, lambda file: file.write(lzma.compress(whole.getvalue())))
    return sums


def read_archive(path: Path, folder: Path) -> None:
    """Unpack an archive into a folder, after its sums have been checked.

    Parameters
    ----------
    path : pathlib.Path
    folder : pathlib.Path
        Gets the members; it exists.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the file is not an archive, is damaged, or has a member that its manifest does not name or names otherwise.
    """
    try:
        with tarfile.open(path, mode="r:xz") as archive:
            members = [(member.name, archive.extractfile(member)) for member in archive]
            content = {name: member.read() for name, member in members if member is not None}
        sums: Any = json.loads(content.pop(_MANIFEST))
    except (tarfile.TarError, lzma.LZMAError, EOFError, KeyError, ValueError) as error:
        raise BenchmarkError(f"{path} must be an archive of wt-gym benchmark archive: {error}") from error
    found = {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}
    wrong = sorted(name for name in {*found, *sums} if found.get(name) != sums.get(name))
    if wrong:
        raise BenchmarkError(f"{path} is damaged: {', '.join(wrong[:3])} must be as the manifest says")
    for name, data in content.items():
        file = folder / name
        parts = name.split("/")
        known = (len(parts), parts[0]) in ((2, RUNS), (3, MODELS))
        if not known or any(part in ("", ".", "..") or "\\" in part for part in parts):
            raise BenchmarkError(f"{path}: names of members must be {RUNS}/FILE or {MODELS}/MODEL/FILE, got {name!r}")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)


def _json(values: Any) -> bytes:
    return (json.dumps(values, indent=1) + "\n").encode()
