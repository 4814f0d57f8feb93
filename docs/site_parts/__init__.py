"""Parts of pages that are made from the code when the site is built.

A page says where: ``<!-- generated: channels -->`` on a line of its own becomes what the function of that name in
`PARTS` returns, Markdown. Words after a name are its arguments.
"""

import json
import re
from pathlib import Path

from site_parts import beyond_pi, command_line, constants, environment, options, studies, validation_record
from wt_gym.analysis.crosscheck import tables

_ROOT = Path(__file__).resolve().parents[2]


def _file(name):
    """A page of the clone outside the site's folder, with its links as they are from the top of the site."""
    text = (_ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"\]\(docs/", "](", text)
    return re.sub(r"\]\((CHANGELOG|CONTRIBUTING)\.md\)", lambda found: f"]({found[1].lower()}.md)", text)


def _crosscheck(name="crosscheck"):
    """Settings of the runs of a record of the crosscheck between simulators, and all its tables."""
    content = json.loads((_ROOT / "docs" / "data" / f"{name}.json").read_text(encoding="utf-8"))
    settings = content["settings"][0]
    head = (
        f"{content['turbine']}, `{settings['env_id']}`, {settings['duration']:g} s a run, of which the first "
        f"{settings['skip']:g} s are left out; {len(content['winds'])} winds: {'; '.join(content['winds'])}.\n\n"
    )
    return f"{head}{tables(content)}\n"


PARTS = {
    "file": _file,
    "beyond_pi": beyond_pi.beyond_pi,
    "constants": constants.constants,
    "ids": environment.ids,
    "environment": environment.manual,
    "observation": environment.observation,
    "action": environment.action,
    "rewards": environment.rewards,
    "study": studies.study,
    "channels": options.channels,
    "turbines": options.turbines,
    "controllers": options.controllers,
    "parameters": options.parameters,
    "records": options.records,
    "fidelities": options.fidelities,
    "lattices": options.lattices,
    "cli": command_line.commands,
    "crosscheck": _crosscheck,
    "headline": validation_record.headline,
    "validation": validation_record.summary,
    "checks": validation_record.checks,
}
_MARK = re.compile(r"^<!-- generated: ([\w ./-]+?) -->$", re.MULTILINE)


def _fill(app, docname, source):
    def made(found):
        name, *words = found[1].split()
        return PARTS[name](*words)

    source[0] = _MARK.sub(made, source[0])


def _outdated(app, env, added, changed, removed):
    """Pages with generated parts: nothing in their files tells when the code has changed."""
    paths = ((name, env.doc2path(name)) for name in env.found_docs)
    return [name for name, path in paths if _MARK.search(open(path, encoding="utf-8").read())]


def setup(app):
    """Connect the parts to Sphinx."""
    app.connect("source-read", _fill)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True}
