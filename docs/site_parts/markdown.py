"""Pieces of Markdown."""

import inspect
import re

__all__ = ["first_sentence", "meaning", "table", "value"]


def table(headings, rows, kind=""):
    """Table with one row of headings; ``kind`` is its class in the page. A long list is folded."""
    lines = [headings, ["---"] * len(headings), *rows]
    body = "\n".join("| " + " | ".join(_cell(text) for text in line) + " |" for line in lines)
    body = f"{{.{kind}}}\n{body}\n" if kind else f"{body}\n"
    folded = kind in ("options", "channels") and len(rows) > 30
    return f":::::{{dropdown}} {len(rows)} rows: {', '.join(headings)}\n{body}:::::\n" if folded else body


def _cell(text):
    return str(text).replace("\n", " ").replace("|", "\\|")


def value(thing):
    """A default as code; numbers short."""
    if isinstance(thing, float):
        return f"`{thing:.6g}`"
    if isinstance(thing, str):
        return f'`"{thing}"`'
    return f"`{thing!r}`"


def first_sentence(thing):
    """Of a docstring."""
    text = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return re.split(r"(?<=\.)\s", text)[0].replace("``", "`")


def meaning(declared):
    """Unit, allowed values and meaning of a declared option."""
    allowed = declared.allowed_text or declared.range_text
    return declared.unit, allowed, f"{declared.meaning}.".replace("``", "`")
