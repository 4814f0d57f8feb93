"""Files of turbines that were read before: the same turbine, and nothing else, comes back."""

import datetime
import hashlib
import logging
import os
from importlib import import_module

import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import load_turbine
from wt_gym.turbines import windio_file as file_cache
from wt_gym.turbines import windio_file as source
from wt_gym.turbines.catalog import turbine_file

CONTENT = b"name: a turbine"
DATA = {"name": "a", "numbers": [1, 2.5, -1e-30, 0.1 + 0.2], "deep": {"none": None, "yes": True}}


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    return tmp_path / "turbines"


def test_what_was_kept_comes_back(cache):
    assert file_cache._cached(CONTENT) is None
    file_cache._store(CONTENT, DATA)
    assert file_cache._cached(CONTENT) == DATA
    assert file_cache._cached(CONTENT + b" ") is None
    assert [path.suffix for path in cache.iterdir()] == [".json"]


def test_a_turbine_is_read_once(monkeypatch):
    path, module = turbine_file("nrel_5mw"), import_module("wt_gym.turbines.windio")
    monkeypatch.setattr(module, "_loaded", {})
    first = load_turbine(path)
    monkeypatch.setattr(module, "_loaded", {})
    monkeypatch.setattr(source, "_load", None)  # nobody reads it again
    again = load_turbine(path)
    assert again is not first
    assert fingerprint(again) == fingerprint(first)
    assert again.notes == first.notes


def proved(text):
    """Text that bears out its own digest."""
    return f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}".encode()


@pytest.mark.parametrize(
    "damage",
    [
        lambda b: b[:-5], lambda b: b.replace(b"2.5", b"2.6"), lambda b: b"\xff" + b, lambda _: proved("[1]"),
        lambda _: proved(""), lambda _: proved("[" * 100_000),
    ],
)  # fmt: skip
def test_damaged_files_are_read_anew(cache, damage, caplog):
    file_cache._store(CONTENT, DATA)
    (path,) = cache.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    with caplog.at_level(logging.WARNING, file_cache.__name__):
        assert file_cache._cached(CONTENT) is None
    assert "made again" in caplog.text
    file_cache._store(CONTENT, DATA)
    assert file_cache._cached(CONTENT) == DATA


@pytest.mark.parametrize("value", [datetime.date(2020, 1, 1), {1: "a"}, float("nan"), float("inf"), (1, 2)])
def test_what_json_would_change_is_not_kept(cache, value):
    file_cache._store(CONTENT, {"a": [value]})
    assert not cache.exists()


def test_a_cache_that_cannot_be_written_is_told(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path / "file"))
    with caplog.at_level(logging.WARNING, file_cache.__name__):
        file_cache._store(CONTENT, DATA)
        assert file_cache._cached(CONTENT) is None
    assert "could not be cached" in caplog.text


def test_files_that_do_not_fit_are_never_kept(cache, tmp_path):
    path = tmp_path / "turbine.yaml"
    path.write_text("name: nothing\nwindIO_version: '2.0'\n")
    for _ in range(2):
        with pytest.raises(TurbineDefinitionError, match="missing, the windIO schema requires it"):
            load_turbine(path)
    assert not cache.exists()


def test_a_cache_of_nobody_is_none(monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", "~no_such_user_here/cache")
    file_cache._store(CONTENT, DATA)
    assert file_cache._cached(CONTENT) is None


@pytest.mark.parametrize("tag", ["!include", "!%69nclude"], ids=["plain", "escaped"])
def test_files_with_others_in_them_are_read_each_time(cache, tmp_path, tag):
    """What an included file holds is not in the digest, however the file says that it includes it."""
    text = turbine_file("nrel_5mw").read_text(encoding="utf-8")
    (tmp_path / "name.yaml").write_text("first\n")
    path = tmp_path / "turbine.yaml"
    first_line = next(line for line in text.splitlines() if line.startswith("name:"))
    path.write_text(text.replace(first_line, f"name: {tag} name.yaml", 1), encoding="utf-8")
    assert load_turbine(path).name == "first"
    (tmp_path / "name.yaml").write_text("second\n")
    assert load_turbine(path).name == "second"
    assert not cache.exists()


def test_the_oldest_go(cache, monkeypatch):
    monkeypatch.setattr(file_cache, "_KEPT", 3)
    for k in range(5):
        file_cache._store(CONTENT + bytes([48 + k]), DATA)
        for path in cache.iterdir():
            os.utime(path, (path.stat().st_mtime - 10, path.stat().st_mtime - 10))
    assert len(list(cache.iterdir())) == 3
    assert file_cache._cached(CONTENT + b"0") is None
    assert file_cache._cached(CONTENT + b"4") == DATA
