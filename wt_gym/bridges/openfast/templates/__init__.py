"""Input files of OpenFAST 5 as templates: all that is the same for every turbine.

A keyword with the value ``?`` needs one, a line ``<name>`` stands for rows of a table.
"""

import re
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path

from wt_gym.turbines.openfast_text import write_lines

_KEYWORD = re.compile(r".{26}  (\S+) +-")


def write_from_template(
    path: Path,
    title: str,
    values: Mapping[str, object],
    tables: Mapping[str, Iterable[str | tuple[str, object]]] | None = None,
) -> None:
    """Write an input file from the template of its name.

    Parameters
    ----------
    values : mapping
        Values of keywords in place of the template's.
    tables : mapping, optional
        Rows by the name of their line.

    Raises
    ------
    KeyError
        For keywords that the template has not, and for values and tables that are missing.
    """
    values, tables = dict(values), dict(tables or {})
    rows: list[str | tuple[str, object]] = []
    for line in resources.files(__name__).joinpath(path.name).read_text(encoding="utf-8").splitlines():
        match = _KEYWORD.fullmatch(line)
        keyword = "" if match is None else match[1]
        if line.startswith("<"):
            rows += tables.pop(line[1:-1])
        elif keyword in values or line.startswith("?"):
            rows.append((keyword, values.pop(keyword)))
        else:
            rows.append(line)
    if unknown := [*values, *tables]:
        raise KeyError(f"{path.name} has no keywords {sorted(unknown)}")
    write_lines(path, title, rows)
