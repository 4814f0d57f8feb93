"""Words of the documentation: a list of phrases that stop a reader, over pages, public docstrings and help texts.

Pages state what is, in the present tense and in the terms of the field. How something was found, when and on which
machine belongs to the change log. Spelling is the task of typos (``scripts/test``).
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PHRASES = {
    r"wanted": "required, or a tolerance",
    r"beneath": "base controller, below",
    r"anew": "again",
    r"(?:,|\band) of (?:which|whom|these)\b|^of which": "a sentence of its own",
    r"of one['’]s own|\bone['’]s own": "your own",
    r"go(?:es)? on(?! (?:the|a) )|going on|went on": "resume, continue",
    r"(?<!there )(?<!if )\bis no (?!longer|more|less|slower|faster|better|worse|higher|lower|larger)": "is not a",
    r"is told of|are told of": "is described in",
    r"but for": "except for",
    r"sources of the morning|better hours?|beside other work|at hand was": "away",
    r"not met again|was tried|were tried|has been tried": "away, or the change log",
    r"whoever|whosoever": "you",
    r"outshout|stand(?:s)? on the page|sparing|spares? the": "reduces loads",
    r"by hand(?!,? (?:or|and))": "hand-designed",
    r"comes? from nothing": "energy balance violated",
    r"the knee(?! of)": "the trade-off",
    r"ever after|without hope|without fear": "away",
    r"takes? (?:\d+ % )?off the": "lowers",
    r"\d{1,2} (?:January|February|March|April|May|June|July|August|September|October|November|December) 20\d\d": "away",
    r"20\d\d-\d\d-\d\d": "away",
}
"""What must not be said, as regular expressions, and what to say instead."""

ALLOWED = {
    "docs/loadcases.md": (r"takes? (?:\d+ % )?off the",),  # "a quarter to a third off": a load, not an aircraft
}
OTHERS = {"docs/changelog.md", "docs/contributing.md"}  # show files from elsewhere in the clone
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "AGENTS.md", "llms.txt", "agents/trained/README.md")]
PAGES += [path for path in sorted((ROOT / "docs").rglob("*.md")) if path.relative_to(ROOT).as_posix() not in OTHERS]
LONGEST = 60  # words of a sentence
GENERATED = re.compile(
    r"<!-- (scores|kinds|fault study|budget study|leaderboard|ceilings|ladder|crosscheck)[^>]*-->.*?<!-- end[^>]*-->",
    re.DOTALL,
)


def prose(text):
    """Text of a page without code, generated tables, formulas and targets of links; its lines keep their number."""

    def blank(found):
        return "\n" * found[0].count("\n")

    text = re.sub(r"\A---\n.*?\n---\n", blank, text, flags=re.DOTALL)
    text = re.sub(r"^(`{3,}|~{3,}).*?^\1", blank, text, flags=re.DOTALL | re.MULTILINE)
    text = GENERATED.sub(blank, text)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`\n]*`", "CODE", text)
    return re.sub(r"\]\([^)]*\)", "]", text)


def findings(text):
    """Number of the line, phrase found and what to say instead, for every phrase in a text."""
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        for pattern, instead in PHRASES.items():
            for hit in re.finditer(rf"\b(?:{pattern})" if pattern[0].isalpha() else pattern, line, re.IGNORECASE):
                found.append((number, hit[0], instead))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_are_in_plain_words(page):
    name = page.relative_to(ROOT).as_posix()
    allowed = [PHRASES[pattern] for pattern in ALLOWED.get(name, ())]
    assert [found for found in findings(prose(page.read_text(encoding="utf-8"))) if found[2] not in allowed] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_sentences_can_be_read(page):
    lines = [line for line in prose(page.read_text(encoding="utf-8")).splitlines() if not line.startswith("|")]
    paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:[-*#:]|\d+\.) ?)", "\n".join(lines))
    sentences = [s for p in paragraphs for s in re.split(r"(?<=[.!?:;])\s+", " ".join(p.split()))]
    long = {s: n for s in sentences if (n := sum(bool(re.search("[A-Za-z]", word)) for word in s.split())) > LONGEST}
    assert long == {}


def test_phrases_are_found():
    text = "The wanted speed goes on anew.\n\nIt is no rotor, of which the blades are told of by hand.\n"
    text += "`beneath`\n\n    wanted\n"
    assert [hit for _, hit, _ in findings(prose(text))] == [
        "wanted",
        "anew",
        "goes on",
        ", of which",
        "is no ",
        "are told of",
        "by hand",
    ]
    assert findings("There is no wind. It is no longer there. It goes on the tower.") == []


# ---- docstrings of public names, and help of commands ----------------------------------------------------------------


def docstrings(path):
    """Docstrings of a module and of its public classes and functions, by line."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            public = isinstance(node, ast.Module) or not node.name.startswith("_")
            if public and (text := ast.get_docstring(node)):
                yield getattr(node, "lineno", 1), text


ROOMS = ("wt_gym", "agents")
SOURCES_LATER = ("wt_gym/control/controllers/linear_optimal.py",)  # a parameter is called "wanted"
SOURCES = [
    path
    for room in ROOMS
    for path in sorted((ROOT / room).rglob("*.py"))
    if path.relative_to(ROOT).as_posix() not in SOURCES_LATER and not path.stem.endswith("_kernels")
]


def spoken(text):
    """A docstring or message without code."""
    return re.sub(r"``[^`]*``", "CODE", text)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_public_docstrings_are_in_plain_words(path):
    assert [(line, hit) for line, text in docstrings(path) if (hit := findings(spoken(text)))] == []


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_messages_and_help_are_in_plain_words(path):
    """Strings of a module that a user can read: longer than three words."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    assert [hit for text in texts if len(text.split()) > 3 and (hit := findings(spoken(text)))] == []
