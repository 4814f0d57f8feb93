"""Files that are there when they are whole, and values as a JSON file gives them back."""

from __future__ import annotations

import csv
import json
import os
import shutil
import tempfile
import threading
import tomllib
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    import xarray as xr


class HeldFolder:
    """Temporary folder that goes with the last object that holds it, or before by `remove`.

    Its name has the prefix. Where a file of it is still in use, as Windows does for a moment, the folder stays.
    """

    def __init__(self, prefix: str):
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self.remove = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


def shipped_folder() -> Path:
    """Folder of recipes, hyperparameters and trained agents: ``agents`` of a clone, ``wt_gym/agents`` of a wheel."""
    package = Path(__file__).parents[1]
    installed = package / "agents"
    return installed if (installed / "recipes").is_dir() else package.parent / "agents"


def json_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Give a table as a JSON file of it gives it back: tuples as lists, what JSON does not know as text."""
    read: dict[str, Any] = json.loads(json.dumps(values, default=str))
    return read


def read_json(path: Path, kind: type = dict) -> Any:
    """Read a JSON file that holds a value of a kind, by default a table; a `ValueError` if it does not."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(value, kind):
            raise ValueError(f"it must hold a {kind.__name__}, got {value!r:.80}")
    except ValueError as error:  # no JSON, or no text at all
        raise ValueError(f"{path} is damaged: {error}") from error
    return value


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table that belongs to the package, values by the names in its first line."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read_toml(path: Path) -> dict[str, Any]:
    """Values of a TOML file that belongs to the package."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, which takes the name of the file in the end: nobody ever meets half of it.

    The folder of the file exists. Processes and threads that write the same file at the same time do not disturb each
    other. Where writing fails with an `OSError`, the file stays as it was and the temporary one is removed.
    """
    partial = path.with_name(f".{path.name}.{threading.get_ident()}.{os.getpid()}.partial")
    try:
        yield partial
        with partial.open("rb+") as file:  # on the disk before the old content is gone
            os.fsync(file.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def require_writable(folder: Path) -> None:
    """Make a folder if there is none, and try to write there; an `OSError` if nothing can be written.

    Permissions do not tell of full or read-only disks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"\0")


def remove_partial(folder: Path) -> None:
    """Remove what killed processes had begun to write; what a running one writes at the moment stays."""
    for file in folder.glob(".*.partial"):
        if not _writes(file):
            with suppress(PermissionError):
                file.unlink(missing_ok=True)


def _writes(partial: Path) -> bool:
    """Whether the process whose number stands in the name of a temporary file is another one that runs."""
    number = partial.name.split(".")[-2]
    if not number.isdigit() or int(number) == os.getpid():  # one of an earlier process with the same number
        return False
    if os.name == "nt":  # where a file that is written cannot be removed, and os.kill would end the process
        return False
    try:
        os.kill(int(number), 0)  # only asks
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it is someone else's
        pass
    return True


def write_whole(path: Path, write: Callable[[BinaryIO], Any]) -> None:
    """Write a file as `whole_file` does; ``write`` gets the open file."""
    with whole_file(path) as partial, partial.open("wb") as file:
        write(file)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text in UTF-8 as `whole_file` does."""
    write_whole(path, lambda file: file.write(text.encode()))


def write_netcdf_whole(path: Path, data: xr.Dataset) -> None:
    """Write a data set as NetCDF 4, as `whole_file` does.

    The file is made in memory: the HDF5 library crashes the process where it finds no room on a disk.
    """
    write_whole(path, lambda file: file.write(data.to_netcdf(engine="h5netcdf")))


def decoded_text(data: bytes) -> str:
    """Return the text of a file, UTF-8 with or without its mark or else Latin-1, with the line ends of this system."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")
