"""Constants of the public modules, which autodoc does not see where they are imported from elsewhere."""

import inspect
import sys
from importlib import import_module

from site_parts.markdown import table

_LONGEST = 70


def constants(module):
    """Public names that are neither classes nor functions, with what is said where they are made."""
    from sphinx.pycode import ModuleAnalyzer  # not where the parts are tested without the site

    public, rows = import_module(module), []
    said = [name for place, name in ModuleAnalyzer.for_module(module).find_attr_docs() if not place and name[0] != "_"]
    for name in getattr(public, "__all__", said):
        thing = getattr(public, name)
        if not (inspect.isclass(thing) or inspect.isroutine(thing)):
            rows.append((f"`{name}`", _said(name, thing), _shown(thing)))
    return f"**Constants**\n\n{table(('name', 'what it is', 'value'), rows, 'options')}" if rows else ""


def _said(name, thing):
    """Docstring of a constant, from the module that assigns it."""
    from sphinx.pycode import ModuleAnalyzer

    for place in sorted(found for found in sys.modules if found.startswith("wt_gym")):
        module = sys.modules[place]
        if vars(module).get(name) is thing and hasattr(module, "__file__"):
            analyzer = ModuleAnalyzer.for_module(place)
            if text := analyzer.find_attr_docs().get(("", name)):
                return " ".join(" ".join(text).split()).replace("``", "`")
    return ""


def _shown(thing):
    """Value, or of what many the first are."""
    text = repr(list(thing) if isinstance(thing, dict) else thing)
    return f"`{text}`" if len(text) <= _LONGEST else f"`{text[:_LONGEST].rsplit(', ', 1)[0]}, …`"
