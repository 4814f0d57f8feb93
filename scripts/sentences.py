#!/usr/bin/env python3
"""List sentences of more than 25 words in the pages that are read first.

    scripts/sentences.py            # README, the three reader pages, tutorials and how-to guides
    scripts/sentences.py FILE ...   # other pages

Exit code 1 where there is one. Code, tables and headings do not count; of a link its text does.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST = 25
_BLOCKS = re.compile(
    r"^---\n.*?^---$|^ *(```|~~~|:::).*?^ *\1[`~:]*$|^\$\$.*?^\$\$$|<!--.*?-->", re.MULTILINE | re.DOTALL
)
_LEFT_OUT = re.compile(r"^(?:\||#| {4}\S|\(\S+\)=$|!\[)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")
_END = re.compile(r"(?<=[.!?])[)*\"]*\s+(?=[\"'*(`\[]*[A-Z0-9`])")


def pages() -> list[Path]:
    """Pages whose sentences are short."""
    docs = ROOT / "docs"
    first = [ROOT / "README.md", *(docs / f"{name}.md" for name in ("learn", "bring", "check"))]
    return [*first, *sorted((docs / "tutorials").glob("*.md")), *sorted((docs / "howto").glob("*.md"))]


def paragraphs(text: str) -> list[str]:
    """Paragraphs and items of lists, each on one line, without code, tables, headings and targets of links."""
    found = [""]
    for line in _BLOCKS.sub("", text).splitlines():
        if not line.strip() or _LEFT_OUT.match(line):
            found.append("")
        elif _ITEM.match(line):
            found.append(_ITEM.sub("", line))
        else:
            found[-1] += f" {line.strip()}"
    return [re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", paragraph).strip() for paragraph in found if paragraph.strip()]


def sentences(text: str) -> list[str]:
    """Sentences of a page in Markdown."""
    return [sentence for paragraph in paragraphs(text) for sentence in _END.split(paragraph)]


def length(sentence: str) -> int:
    """Words of a sentence; what is in one pair of backquotes is a word."""
    return len(re.findall(r"\S*\w\S*", re.sub(r"`[^`]*`", "code", sentence)))


def main(words: list[str]) -> int:
    """List them."""
    count = 0
    for path in [Path(word) for word in words] or pages():
        for sentence in sentences(path.read_text(encoding="utf-8")):
            if (n := length(sentence)) > MOST:
                count += 1
                print(f"{path}: {n} words: {sentence}")
    if count:
        print(f"error: {count} sentences of more than {MOST} words", file=sys.stderr)
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
