"""Behavior of a version of the package, as stored numbers, and its comparison with another one.

Benchmark references, kept runs and records of starts belong to a version of the package. The text of its sources does
not count, its behavior does: beside them stands a *canary*, numbers of a few short episodes (`wt_gym.envs.canary`). Two
versions are the same where all channels agree within `TOLERANCE` of the range of the channel, so that rounding on
another processor does not matter. A canary is compared, never hashed. It is measured once for each state of the files
of the package and stored in the user's cache: a comment that is edited or a file that moves costs a few seconds, and
every result stays valid.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from wt_gym.base.files import read_json, write_text_whole
from wt_gym.base.user_cache import cached_file, prune, read_cached, write_cached

Canary: TypeAlias = "dict[str, str]"
"""Numbers of each channel, as text; a JSON value."""
CANARY = "canary"
"""Key of the canary in a fingerprint (`wt_gym.experiment.run.benchmark_fingerprint`)."""
TOLERANCE = 1e-4
"""Largest difference of two versions that are the same, over the range of a channel, or over its single number [-]."""
_SMALLEST_RANGE = 1e-3
"""Range of a channel that hardly changes, over its largest value [-]."""
_MOST_FILES = 64
"""Canaries in the cache; the oldest are removed."""
_known: dict[tuple[str, ...], Canary] = {}


def canary_text(values: Iterable[float]) -> str:
    """Numbers of a channel as they are stored, with nine digits."""
    return " ".join(f"{float(value):.9g}" for value in values)


def canary_differences(first: Mapping[str, str], second: Mapping[str, str]) -> list[str]:
    """Channels in which two canaries differ, the largest difference over the range of both first, with its size."""
    sizes: dict[str, float] = {}
    for name in {*first, *second}:
        texts = first.get(name), second.get(name)
        if texts[0] == texts[1]:
            continue
        try:
            rows = [np.array((text or "").split(), dtype=np.float64) for text in texts]
        except ValueError:  # one is the name of an error
            rows = []
        if len(rows) < 2 or rows[0].shape != rows[1].shape:
            sizes[name] = np.inf
            continue
        largest = float(np.abs(rows).max())
        scale = largest if rows[0].size == 1 else max(float(np.ptp(rows)), _SMALLEST_RANGE * largest)
        size = float(np.abs(rows[0] - rows[1]).max() / scale)
        if not size <= TOLERANCE:
            sizes[name] = size
    worst = sorted(sizes, key=lambda name: (-sizes[name], name))
    by = {name: f"by {size:.2g} of its range" if np.isfinite(size) else "in its form" for name, size in sizes.items()}
    return [f"{name} {by[name]}" for name in worst]


def differing(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[str]:
    """Parts in which two fingerprints differ: names of digests, and the channel in which the canaries differ most.

    Parameters
    ----------
    first, second : mapping
        Digests by name, and a canary under `CANARY`. A fingerprint without a canary is that of an earlier version.
    """
    parts = sorted(name for name in {*first, *second} - {CANARY} if first.get(name) != second.get(name))
    if (CANARY in first) is not (CANARY in second):
        return [*(name for name in parts if name in first and name in second), "behavior (one has no canary)"]
    differences = canary_differences(first.get(CANARY, {}), second.get(CANARY, {}))
    more = f", {len(differences) - 1} channels more" if len(differences) > 1 else ""
    return parts + ([f"behavior ({differences[0]}{more})"] if differences else [])


def cached_canary(name: str, key: str, measure: Callable[[], Canary]) -> Canary:
    """Canary of a kind in the memory of the process or in the user's cache; measured where the package has changed.

    ``key`` is the digest of everything besides the package on which it depends.
    """
    place = name, key[:16]
    if place in _known:
        return _known[place]
    file = cached_file("canaries", f"{'-'.join(place)}-{package_digest()[:16]}.json")
    canary: Canary | None = read_cached("canary", file, read_json)
    if canary is None:
        canary = measure()
        text = json.dumps(canary, indent=1) + "\n"
        if file is not None and write_cached("canary", file, lambda path: write_text_whole(path, text)):
            prune(file.parent.glob("*.json"), _MOST_FILES)
    _known[place] = canary
    return canary


@cache
def package_digest() -> str:
    """Digest of the bytes of all files of the package, and of what compiles and runs them."""
    from wt_gym.base.compiled import digest_of  # numba takes a while to load

    package, files = Path(__file__).parents[1], []
    for folder, folders, names in os.walk(package):
        folders[:] = [name for name in folders if name != "__pycache__"]
        files += [Path(folder, name) for name in names]
    return hashlib.sha256(" ".join((digest_of(package, files), *software())).encode()).hexdigest()


def software() -> tuple[str, ...]:
    """Libraries that compile and run the kernels, and the processor: the same ones give the same bits."""
    import llvmlite
    import llvmlite.binding
    import numba

    from wt_gym.base.compiled import way_to_compile

    cpu = llvmlite.binding.get_host_cpu_name()
    return numba.__version__, llvmlite.__version__, np.__version__, cpu, way_to_compile()
