"""How the site is built: ``scripts/docs``, or ``python -m sphinx -W docs build/site`` where the extra is installed."""

import os
import re
import sys
from pathlib import Path

from docutils import nodes
from jupyter_client import KernelManager

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = map(str, (ROOT, Path(__file__).parent, ROOT / "scripts", ROOT / "scripts" / "studies"))
# the notebooks' kernels are processes of their own, in folders of their own
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
for _name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import wt_gym  # noqa: E402 - found by the path above

project = "wt_gym"
author = "the wt_gym authors"
copyright = "the wt_gym authors, MIT license"
version = release = wt_gym.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "site_parts",  # tables made from the code
]
exclude_patterns = ["site_parts"]
smartquotes_action = "De"  # dashes and ellipses; quotes are as they are typed
default_role = "py:obj"  # `name` in docstrings; one that has no page of its own stays as it is
# short names in types, as `Channel`, of which there are two: the reader sees by the module which is meant
suppress_warnings = ["config.cache", "ref.python"]

# Markdown: anchors of headings, so that pages can point at them
myst_enable_extensions = ["colon_fence", "deflist", "attrs_inline", "attrs_block"]
myst_heading_anchors = 3

# Notebooks are text without outputs, and run at each build but for cells with the tag skip-execution, whose results are
# recorded; -D nb_execution_mode=off leaves them unrun
nb_execution_mode = "force"
nb_execution_timeout = 1800  # wall time of a cell, also on a busy machine
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_in_temp = True
nb_merge_streams = True
if hasattr(KernelManager, "transport_encryption"):  # without it each kernel warns of an open socket
    KernelManager.transport_encryption.default_value = "auto"

autodoc_typehints = "none"  # the docstrings say it, with shapes and units
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_custom_sections = [("Methods", "notes")]

html_theme = "furo"
html_title = f"wt_gym {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(ROOT / "docs" / "site_parts" / "search.js")  # titles and headings first
html_copy_source = html_show_sphinx = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b6aa2", "color-brand-content": "#0b6aa2"},
    "dark_css_variables": {"color-brand-primary": "#6cb8e6", "color-brand-content": "#6cb8e6"},
    "navigation_with_keys": True,
}
highlight_language = "text"  # commands; where it is Python, the block says so
pygments_style = "default"
pygments_dark_style = "monokai"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# Pages are read in a clone too, where their links go to files; on the site the same files are pages
_PAGES = {"../CHANGELOG.md": "changelog.md", "../CONTRIBUTING.md": "contributing.md"}


def _links(app, docname, source):
    """Turn links to files of the clone into links to the pages that show them; end examples without a blank line."""
    source[0] = re.sub(r"\]\(([^)\s]+)\)", lambda found: f"]({_PAGES.get(found[1], found[1])})", source[0])
    source[0] = re.sub(r"^(```python\n(?:(?!```).*\n)*?)\n+```$", r"\1```", source[0], flags=re.MULTILINE)


_TOP = {
    "learn": "Learn a controller", "bring": "Bring your turbine and controller", "check": "Check the physics",
    "reference/environment": "Reference", "contributing": "Contribute", "howto/install": "Install",
    "frames": "Frames and signs",
}  # fmt: skip


def _top(app, pagename, templatename, context, doctree):
    """Put a navigation above each page, where the theme has an announcement."""
    links = (f'<a href="{context["pathto"](page)}">{title}</a>' for page, title in _TOP.items())
    context["theme_announcement"] = f'<nav class="top">{"".join(links)}</nav>'


_UNITS = "%|°|[kMG]?W|[kM]?N|[kcm]?m|k?Hz|m?s|µs|min|h|rpm|deg|rad|kg|t|MiB|GB"
_TOGETHER = re.compile(rf"(?<=\d) (?=\d{{3}}(?!\d)|(?:{_UNITS})(?![^\W_]))")  # "12 m/s", "50 000"


def _numbers(app, doctree, docname):
    """Keep the digits of a number, and a number and its unit, on one line."""
    as_it_is = (nodes.literal, nodes.literal_block, nodes.doctest_block, nodes.raw, nodes.math)
    for text in list(doctree.findall(nodes.Text)):
        if not isinstance(text.parent, as_it_is):
            kept = _TOGETHER.sub("\N{NO-BREAK SPACE}", text)
            if kept != text:
                text.parent.replace(text, nodes.Text(kept))


_SEVERAL = re.compile(r"(\w+(?:, \w+)+) : (.+)")


def _one_by_one(lines):
    """Attributes that share an entry ("a, b : int") as entries of their own, which napoleon wants."""
    if "Attributes" not in lines:
        return lines
    kept, rest = lines[: lines.index("Attributes")], lines[lines.index("Attributes") :]
    while rest:
        entry = [rest.pop(0)]
        while rest and rest[0].startswith(" "):
            entry.append(rest.pop(0))
        found = _SEVERAL.fullmatch(entry[0])
        for name in found[1].split(", ") if found else ():
            kept += [f"{name} : {found[2]}", *entry[1:]]
        kept += [] if found else entry
    return kept


def _docstrings(app, what, name, obj, options, lines):
    """Bars are magnitudes, not substitutions. A docstring in Markdown has a page of its own: its head is enough."""
    lines[:] = _one_by_one(lines)
    for k, line in enumerate(lines):
        parts = line.split("``")  # every second one is literal
        lines[k] = "``".join(part if place % 2 else part.replace("|", "\\|") for place, part in enumerate(parts))
    if name in ("wt_gym.envs.WindTurbineEnv", "wt_gym.envs.turbine_env.WindTurbineEnv"):
        first = lines.index("")
        lines[:] = [*lines[:first], "", "Arguments, spaces and reward: :doc:`/reference/environment`.", ""]


def setup(app):
    """Connect what is above to Sphinx."""
    app.connect("source-read", _links)
    app.connect("html-page-context", _top)
    app.connect("doctree-resolved", _numbers)
    app.connect("autodoc-process-docstring", _docstrings, priority=100)  # before napoleon
