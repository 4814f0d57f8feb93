"""Pieces of Markdown."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields

from sphinx.pycode import ModuleAnalyzer

__all__ = ["field_texts", "first_sentence", "table", "value"]


def table(headings, rows, kind=""):
    """Table with one row of headings; ``kind`` is its class in the page."""
    lines = [headings, ["---"] * len(headings), *rows]
    body = "\n".join("| " + " | ".join(_cell(text) for text in line) + " |" for line in lines)
    return f"{{.{kind}}}\n{body}\n" if kind else f"{body}\n"


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


def field_texts(cls):
    """Type and text of the fields of a dataclass, from the docstring of the class or what stands beside each field."""
    docstring = inspect.getdoc(cls)
    texts = {
        name: (kind.replace(" : ", ""), text)
        for section in ("Parameters", "Attributes")
        if f"\n{section}\n---" in docstring
        for names, kind, text in attributes_of(docstring, section)
        for name in names.split(", ")
    }
    if not texts:
        said = ModuleAnalyzer.for_module(cls.__module__).find_attr_docs()
        for field in fields(cls):
            text = " ".join(" ".join(said.get((cls.__name__, field.name), ())).split()).replace("``", "`")
            several = re.match(r"((?:\w+, )+\w+): ", text)  # one text for neighbors
            text = text[several.end() :] if several else text
            for name in several[1].split(", ") if several else (field.name,):
                texts[name] = (cls.__annotations__[name], text[:1].upper() + text[1:])
    return texts


def attributes_of(docstring, section="Attributes"):
    """Name, type and text of the entries in a section of a docstring in NumPy's style."""
    lines = inspect.cleandoc(docstring).splitlines()
    start = lines.index(section) + 2
    entries = []
    for k, line in enumerate(lines[start:], start):
        if k + 1 < len(lines) and lines[k + 1].startswith("---"):
            break  # the next section
        if line and not line.startswith(" "):
            name, _, kind = line.partition(" : ")
            entries.append((name, kind, []))
        elif line.strip():
            entries[-1][2].append(line.strip())
    return [(name, kind, " ".join(text).replace("``", "`")) for name, kind, text in entries]
