"""What the README says runs as it is printed: commands are accepted, examples run, links and the picture are there."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from wt_gym.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/quickstart.md")}
BLOCKS = [
    (name, language, block)
    for name, text in PAGES.items()
    for language, block in re.findall(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
]
LINES = dict.fromkeys(
    line.split("#")[0].strip() for _, kind, block in BLOCKS if not kind for line in block.splitlines()
)


def test_it_is_short():
    assert len(README.splitlines()) < 120


@pytest.mark.parametrize("line", LINES)
def test_commands_are_accepted(line):
    program, *words = shlex.split(line)
    if program.endswith(".py"):
        assert import_module(f"wt_gym.commands.{Path(program).stem}").parse_arguments(words)
    elif program.startswith("scripts/"):
        assert (ROOT / program).stat().st_mode & 0o100
        assert not words
    elif program == "wt-gym":
        assert words[0] in (*COMMANDS, "--help")
    else:
        assert (program, words[0]) == ("pip", "install")


def test_commands_are_found():
    assert {"scripts/demo", "scripts/test", "scripts/docs"} <= set(LINES)
    assert len(LINES) >= 5


@pytest.mark.parametrize("page", PAGES)
def test_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, examples = {}, [block for name, kind, block in BLOCKS if name == page and kind == "python"]
    for example in examples:
        exec(compile(example, page, "exec"), names)
    assert names["observation"].shape == names["env"].observation_space.shape or "controller=" in examples[-2]
    if page == "docs/quickstart.md":
        assert (tmp_path / "run.nc").stat().st_size > 1000


def test_the_picture_moves_and_is_small():
    from PIL import Image

    file = ROOT / re.search(r"\((docs/data/\w+\.gif)\)", README)[1]
    assert file.stat().st_size < 1.5e6
    with Image.open(file) as picture:
        assert picture.n_frames >= 20
        assert picture.size[0] <= 1000


@pytest.mark.parametrize("name", re.findall(r"agents/\w+/\w+", README))
def test_files_are_there(name):
    assert (ROOT / name).exists()


def test_messages_on_the_page_about_refusals_are_those_of_the_code():
    sources = "".join(
        p.read_text(encoding="utf-8") for room in ("wt_gym", "agents") for p in (ROOT / room).rglob("*.py")
    )
    page = (ROOT / "docs" / "howto" / "trouble.md").read_text(encoding="utf-8")
    messages = re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE)
    assert len(messages) > 6
    for message in messages:
        for part in filter(None, (part.strip() for part in message.split("…"))):
            assert part in sources, message
