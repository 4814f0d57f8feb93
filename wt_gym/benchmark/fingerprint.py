"""What the numbers of a run depend on besides task and agent: the turbine, the fidelity, and the source of the physics.

Results can be compared only where all of them are the same.
"""

from __future__ import annotations

import hashlib
import io
import tokenize
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import wt_gym
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.state import fingerprint
from wt_gym.simulation.tip_twist import suited_fidelity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["benchmark_fingerprint", "code_of", "differing", "sources_digest"]

_ROOT = Path(wt_gym.__file__).parent
_SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.ENCODING, tokenize.ENDMARKER}
_WITHOUT_NUMBERS = {"box_cache.py", "bts.py", "compilation.py", "compile_ahead.py"}
"""Files that change no number of a task: they keep and read boxes of wind, and say when kernels are compiled."""
_ENVIRONMENT = (
    "costs.py",
    "episode.py",
    "layout.py",
    "observable.py",
    "observations.py",
    "readers.py",
    "turbine_env.py",
)
_STATEMENT_BEGINS = {tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


def benchmark_fingerprint(turbine: Turbine, fidelity: str | Fidelity | None) -> dict[str, str]:
    """Digests by part.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str or Fidelity or None
        None: what suits the turbine.

    Returns
    -------
    dict
        ``turbine``, ``fidelity``, and of the sources ``kernels``: all compiled kernels and how they are compiled,
        ``model``: what else the simulator is made of, ``wind``: what makes the winds, ``control``: controllers and
        actions, ``environment``: a step and its end, ``metrics``: what is measured of a run. Of sources neither
        comments nor docstrings count.
    """
    chosen = fidelity_of(suited_fidelity(turbine) if fidelity is None else fidelity)
    return {
        "turbine": fingerprint(turbine)[:16],
        "fidelity": fingerprint(chosen)[:16],
        **_sources(),
    }


@cache
def _sources() -> dict[str, str]:
    kernels = {*_ROOT.rglob("*_kernels.py"), _ROOT / "compiled.py", _ROOT / "kernel_linking.py"}
    rooms = {
        "model": _modules("aerodynamics", "multibody", "simulation", "structure"),
        "wind": {*_modules("wind"), _ROOT / "envs" / "wind_sampler.py"},
        "control": {
            *_modules("control"),
            *(_ROOT / "control").rglob("tuned*.json"),
            *(_ROOT / "control").rglob("*.npz"),
        },
        "environment": {_ROOT / "tasks.py", *(_ROOT / "envs" / name for name in _ENVIRONMENT)},
        "metrics": {_ROOT / "analysis" / "metrics.py", _ROOT / "benchmark" / "run.py", _ROOT / "runs" / "playing.py"},
    }
    rooms = {"kernels": kernels} | {name: files - kernels for name, files in rooms.items()}
    return {name: sources_digest(files, _ROOT) for name, files in rooms.items()}


def sources_digest(files: Iterable[Path], root: Path) -> str:
    """Digest of sources and arrays by their paths below a folder; neither comments nor docstrings count."""
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(file.relative_to(root).as_posix().encode() + b"\0")
        if file.suffix == ".npz":
            total.update(file.read_bytes() + b"\0")
        else:
            total.update(code_of(file.read_text(encoding="utf-8")).encode() + b"\0")
    return total.hexdigest()[:16]


def _modules(*rooms: str) -> set[Path]:
    files = {file for room in rooms for file in (_ROOT / room).rglob("*.py")}
    return {file for file in files if file.name not in _WITHOUT_NUMBERS}


def code_of(source: str) -> str:
    """Tokens of a source with its lines and indents, without comments, blank lines, docstrings and all other space.

    Python 3.12 takes formatted strings apart where earlier versions give one token; without space both are the same.
    """
    kept, begins = [], True
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in _SILENT or (token.type == tokenize.NEWLINE and begins):  # the latter ends a docstring
            continue
        if token.type in _STATEMENT_BEGINS:
            kept.append({tokenize.NEWLINE: "\n", tokenize.INDENT: "{", tokenize.DEDENT: "}"}[token.type])
            begins = True
        elif not (token.type == tokenize.STRING and begins):
            kept.append("".join(token.string.split()))
            begins = False
    return "".join(kept)


def differing(first: dict[str, str], second: dict[str, str]) -> list[str]:
    """Names of the parts in which two fingerprints differ."""
    return sorted(name for name in {*first, *second} if first.get(name) != second.get(name))
