"""Commands and their options, from the parsers themselves."""

import argparse
import re
import textwrap

import validate

from site_parts.markdown import table
from wt_gym.commands import COMMANDS, parser_of


def commands():
    """Every command with its description and options."""
    sections = []
    for name, text in COMMANDS.items():
        parser = parser_of(name)
        sections.append(f"## {name}\n\n{text[0].upper()}{text[1:]}.\n\n{_described(parser)}\n\n{_options(parser)}")
    options = _options(validate.make_parser())
    sections.append(f"## validate.py (in a clone)\n\n{_blocks(validate.__doc__)}\n\n{options}")
    return "\n".join(sections)


def _described(parser):
    """The description without its first sentence: what is indented stands in columns, the rest is text."""
    return _blocks(parser.description.strip().partition("\n\n")[2])


def _blocks(text):
    blocks = re.split(r"\n\s*\n", text.strip("\n"))
    return "\n\n".join(
        f"```text\n{textwrap.dedent(block)}\n```" if block.startswith(" ") else _plain(block) for block in blocks
    )


def _plain(text):
    """Text whose options are code, so that their hyphens stay."""
    return re.sub(r"(?<![\w-])--[a-z][\w-]*", r"`\g<0>`", re.sub(r"[*<]", r"\\\g<0>", text))


def _options(parser, level="###"):
    rows, below = [], []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                below.append(f"{level} {name}\n\n{sub.description or ''}\n\n{_options(sub, level + '#')}")
            continue
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._HelpAction):
            continue
        rows.append((_name(action), _help(parser, action)))
    return (table(("option", "what it does"), rows, "options") if rows else "") + "\n" + "\n".join(below)


def _name(action):
    if not action.option_strings:
        return f"`{action.metavar or action.dest.upper()}`"
    word = ""
    if action.nargs != 0 and not isinstance(action, argparse.BooleanOptionalAction):
        word = action.metavar or (
            "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
        )
        word = f" {word}" + (" …" if action.nargs in ("+", "*") else "")
    return f"`{', '.join(action.option_strings)}{word}`"


def _help(parser, action):
    return _plain((action.help or "") % {**vars(action), "prog": parser.prog})
