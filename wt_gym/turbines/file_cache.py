"""Contents of windIO files that were read and found valid before: reading and checking one again takes seconds.

Kept as JSON in ``$WT_GYM_CACHE/turbines`` or the user's cache directory, by the digest of the file and the version of
windIO whose schema it fits. A file here that does not match its own digest is ignored and made again.
"""

import contextlib
import hashlib
import json
import logging
import math
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from wt_gym.base.files import whole_file
from wt_gym.base.user_cache import user_cache

__all__ = ["load", "store"]

_FORMAT = 5  # raise when what is checked before a file counts as valid changes
_KEPT = 100  # files, of some 0.5 MB each
_log = logging.getLogger(__name__)


def load(content: bytes) -> dict[str, Any] | None:
    """Return what a file of this content holds, or None if it has not been read before."""
    path = _path(content)
    if path is None:
        return None
    try:
        digest, _, text = path.read_text(encoding="utf-8").partition("\n")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        _log.warning("cached turbine %s is unreadable (%s); its file is read again", path, error)
        return None
    if digest != _digest(text):
        _log.warning("cached turbine %s is damaged; its file is read again", path)
        return None
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, dict):
        _log.warning("cached turbine %s holds no turbine; its file is read again", path)
        return None
    return data


def store(content: bytes, data: dict[str, Any]) -> None:
    """Keep what a file holds; without a word if JSON has no such thing, with a warning if it cannot be written."""
    path = _path(content)
    if path is None or not _is_plain(data):
        return
    try:
        text = json.dumps(data)
    except ValueError:  # integers of thousands of digits
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as partial:
            partial.write_text(f"{_digest(text)}\n{text}", encoding="utf-8")
        _prune(path.parent)
    except OSError as error:
        _log.warning("turbine could not be cached in %s (%s)", path.parent, error)


def _prune(folder: Path) -> None:
    """Remove the files that were written first beyond those that are kept."""
    age = {}
    for path in folder.glob("*.json"):
        with contextlib.suppress(FileNotFoundError):  # another process may prune at the same time
            age[path] = path.stat().st_mtime
    for path in sorted(age, key=lambda one: age[one])[: max(len(age) - _KEPT, 0)]:
        path.unlink(missing_ok=True)


def _path(content: bytes) -> Path | None:
    folder = user_cache()
    if folder is None:
        return None
    try:
        schema = version("windIO")
    except PackageNotFoundError:
        return None
    digest = hashlib.sha256(content)
    digest.update(f"\0{_FORMAT}\0{schema}".encode())
    return folder / "turbines" / f"{digest.hexdigest()[:32]}.json"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _is_plain(value: Any) -> bool:
    """Whether JSON gives back just this: no dates, no keys but texts, no numbers that are none."""
    if isinstance(value, dict):
        return all(type(key) is str for key in value) and all(map(_is_plain, value.values()))
    if isinstance(value, list):
        return all(map(_is_plain, value))
    if type(value) is float:
        return math.isfinite(value)
    return value is None or type(value) in (str, int, bool)
