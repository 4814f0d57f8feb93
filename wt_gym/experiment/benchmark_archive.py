"""Archives of results of the benchmark, and runs that are repeated to verify them."""

import hashlib
import io
import json
import lzma
import tarfile
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.canary import differing
from wt_gym.base.errors import BenchmarkError
from wt_gym.base.files import write_whole
from wt_gym.control.controllers.names import Name
from wt_gym.experiment.benchmark import BenchmarkAgent, BenchmarkRun, ResultFolder, entry_of, run_jobs
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.execute import Executor
from wt_gym.experiment.store import digest
from wt_gym.experiment.trained_agent import MODEL_FILE, RECORD_FILE, model_digests, model_files

RUNS, MODELS = "runs", "models"
"""Folders of an archive: results of a `wt_gym.experiment.benchmark.ResultFolder`, and models by `model_folder`."""
_MANIFEST = "manifest.json"


def model_folder(digests: Mapping[str, str]) -> str:
    """Name of the folder of a model: a digest of the SHA-256 sums of its files by name, as a definition has them."""
    return digest(dict(digests))


def write_archive(path: Path, runs: Iterable[Path], models: Mapping[str, Iterable[Path]]) -> dict[str, str]:
    """Write an archive (tar, xz); the same content gives the same bytes.

    Takes result files, and files of each model by the name of its folder; returns the SHA-256 sum of each member by its
    name, which the archive has as ``manifest.json``.
    """
    members = {f"{RUNS}/{file.name}": file.read_bytes() for file in runs}
    for folder, files in models.items():
        members |= {f"{MODELS}/{folder}/{file.name}": file.read_bytes() for file in files}
    sums = {name: hashlib.sha256(members[name]).hexdigest() for name in sorted(members)}
    manifest, whole = json.dumps(sums, indent=1) + "\n", io.BytesIO()
    with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, content in ((_MANIFEST, manifest.encode()), *((name, members[name]) for name in sums)):
            about = tarfile.TarInfo(name)
            about.size = len(content)
            archive.addfile(about, io.BytesIO(content))
    write_whole(path, lambda file: file.write(lzma.compress(whole.getvalue())))
    return sums


def read_archive(path: Path, folder: Path) -> None:
    """Unpack an archive into a folder, after its sums have been checked.

    Parameters
    ----------
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


SAME = 2e-5
"""Relative change of a metric within which a run is the same as before. The same sources, whose numbers are the same to
the last bit on one machine, gave up to 8e-6 of pitch duty, 1e-6 of a load and 1e-8 of power on two kinds of processor
after 600 s; an effect on the score begins at 1e-3."""


@dataclass(frozen=True)
class Verified:
    """A run and its repetition."""

    label: str  #: agent, task and wind
    deviation: float
    """Largest relative difference of a metric, over those of the recorded run [-]; infinite where the runs ended
    differently."""
    metric: str  #: of that difference
    other: tuple[str, ...]  #: parts of the fingerprint in which the recorded run differs from the current sources

    @property
    def same(self) -> bool:
        """Whether the numbers are those recorded, within what processors differ by."""
        return self.deviation <= SAME


@contextmanager
def opened(source: Path) -> Iterator[tuple[ResultFolder, dict[str, Path]]]:
    """Results of a folder or an archive, and the models in it by the name of `model_folder`."""
    if source.is_dir():
        yield ResultFolder(source), {}
        return
    if not source.is_file():
        raise FileNotFoundError(f"no folder of results or archive at {source}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        read_archive(source, folder)
        models = folder / MODELS
        yield ResultFolder(folder / RUNS), {one.name: one for one in models.iterdir()} if models.is_dir() else {}


def pack(folder: ResultFolder, paths: Iterable[str | Path], file: Path) -> dict[str, Any]:
    """Write results and the models that made them into one file.

    Of the paths of trained models those that made no run are left out. Returns ``runs`` and ``models`` (numbers),
    ``bytes``, and ``missing``: names of trained agents whose model is not among the paths.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If there are no results.
    """
    results = list(folder)
    if not results:
        raise BenchmarkError(f"{folder.path} holds no results; wt-gym benchmark run makes them")
    known = {model_folder(model_digests(path)): path for path in paths}
    used: dict[str, set[str]] = {}
    for result in results:
        agent = result["definition"]["agent"]
        if agent["kind"] == "trained":
            used.setdefault(model_folder(agent["sha256"]), set()).add(result["agent"])
    models = {}
    for name in used.keys() & known:
        files = model_files(known[name])
        record = files[0].with_name(RECORD_FILE)  # of the training, where it is beside the model
        models[name] = [*files, *([record] if record.is_file() else [])]
    write_archive(file, [folder.file(result["definition"]) for result in results], models)
    missing = sorted(agent for name in used if name not in known for agent in used[name])
    return {"runs": len(results), "models": len(models), "bytes": file.stat().st_size, "missing": missing}


def verify(
    folder: ResultFolder,
    models: dict[str, Path],
    agents: Sequence[str] = (),
    sample: int | None = 6,
    seed: int = 0,
    executor: Executor | None = None,
) -> list[Verified]:
    """Repeat runs and compare their metrics with the recorded ones.

    Parameters
    ----------
    models : dict
        Folders of models by the name of `model_folder`.
    agents : sequence of str
        Further agents as ``NAME=CHOICE``: models that are elsewhere, and classes in files.
    sample : int, optional
        How many runs, drawn evenly; None: all.
    seed : int
        Of the draw.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If there are no results, a task is unknown, or an agent cannot be made from what is there.
    """
    results = list(folder)
    if not results:
        raise BenchmarkError(f"{folder.path} holds no results")
    results = drawn(results, sample, seed)
    given = [entry_of(text) for text in agents]
    jobs = [_job(result, models, given) for result in results]
    with tempfile.TemporaryDirectory() as name:
        kept = ResultFolder(name)
        run_jobs(jobs, kept, executor)
        return [_compared(job, result, kept.read(job.definition))
                for job, result in zip(jobs, results, strict=True)]  # fmt: skip


def drawn(results: Sequence[Any], sample: int | None, seed: int) -> list[Any]:
    """Some of the results, drawn evenly without repetition, in their order; all of them where there are not more."""
    if sample is None or sample >= len(results):
        return list(results)
    chosen = np.random.default_rng(seed).choice(len(results), sample, replace=False)
    return [results[k] for k in sorted(chosen)]


def _job(result: dict[str, Any], models: dict[str, Path], given: Sequence[BenchmarkAgent]) -> BenchmarkRun:
    """The job that a result says it was."""
    definition = result["definition"]
    task = load_task(definition["task"])
    if task.version != definition["version"]:
        recorded = f"{definition['task']}-v{definition['version']}"
        raise BenchmarkError(f"{recorded} must be a task of this version of the package; known: {task.id}")
    wind = next((wind for wind in task.winds if digest(wind.definition) == digest(definition["wind"])), None)
    if wind is None:
        raise BenchmarkError(f"{result['agent']}: {definition['wind']} must be a wind of {task.id}")
    return BenchmarkRun(task, wind, _entry(result, models, given))


def _entry(result: dict[str, Any], models: dict[str, Path], given: Sequence[BenchmarkAgent]) -> BenchmarkAgent:
    """Agent of a result, with the interface that its definition has."""
    about = {key: value for key, value in result["definition"]["agent"].items() if key != "name"}
    interface, name = result["definition"].get("interface", {}), result["agent"]
    if (match := next((one for one in given if one.definition == about), None)) is not None:
        return BenchmarkAgent(name, match.choice, about, interface)
    if about["kind"] == "trained":
        folder = models.get(model_folder(about["sha256"]))
        if folder is None:
            raise BenchmarkError(
                f"the model of {name!r} must be in the archive or be given as NAME=PATH with the files of its digests"
            )
        path = folder if (folder / MODEL_FILE).is_file() else next(folder.glob("*.zip"))
        return BenchmarkAgent(name, str(path), about, interface)
    if "class" in about:
        raise BenchmarkError(f"the class of {name!r} must be given as NAME=FILE.py:Class, with the same source")
    of_controller = about["kind"] == "controller"
    target = about["controller"] if of_controller else about["kind"]
    made = entry_of(Name("controller" if of_controller else "word", target, about.get("parameters", {})).text)
    if made.definition != about:
        raise BenchmarkError(f"{name!r} must be {about}; what has this name here is {made.definition}")
    return BenchmarkAgent(name, made.choice, about, interface)


def _compared(job: BenchmarkRun, recorded: dict[str, Any], found: dict[str, Any]) -> Verified:
    """Differences of a repetition."""
    other = tuple(differing(recorded["definition"]["fingerprint"], found["definition"]["fingerprint"]))
    if recorded["ending"] != found["ending"] or recorded["metrics"].keys() - found["metrics"].keys():
        return Verified(job.label, float("inf"), f"ending ({recorded['ending']}, now {found['ending']})", other)
    pairs = {key: (value, found["metrics"][key]) for key, value in recorded["metrics"].items()}
    pairs = {"duration": (recorded["duration"], found["duration"])} | pairs
    deviations = {
        key: abs(now - before) / abs(before) if before else (0.0 if now == 0.0 else float("inf"))
        for key, (before, now) in pairs.items()
    }
    metric = max(deviations, key=deviations.__getitem__)
    return Verified(job.label, deviations[metric], metric, other)
