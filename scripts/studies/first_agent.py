"""Results of the cells of docs/tutorials/first_agent.md that the site does not run.

    python scripts/studies/first_agent.py

writes the blocks of the page, and docs/data/first_agent.json and .svg.
"""

import os
import re
import tempfile
from contextlib import redirect_stdout
from hashlib import sha256
from io import StringIO

import matplotlib.pyplot as plt
from study_pages import DATA, ROOT, renew, save_svg, write_entries

import wt_gym

PAGE, RECORD = ROOT / "docs" / "tutorials" / "first_agent.md", DATA / "first_agent.json"
CELL = re.compile(r"^```\{code-cell\} ipython3\n(?::tags: [^\n]*\n)?(.*?)^```", re.MULTILINE | re.DOTALL)


def state() -> dict[str, str]:
    """Version of the package and digest of the cells, for which a result holds."""
    cells = "".join(CELL.findall(PAGE.read_text(encoding="utf-8")))
    return {"version": wt_gym.__version__, "cells": sha256(cells.encode()).hexdigest()}


if __name__ == "__main__":
    names, printed = {}, []
    plt.switch_backend("agg")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for cell in CELL.findall(PAGE.read_text(encoding="utf-8")):
            with redirect_stdout(StringIO()) as text:
                exec(cell, names)
            printed.append(f"```\n{text.getvalue().rstrip()}\n```")
        os.chdir(ROOT)
    save_svg(plt.gcf(), DATA / "first_agent.svg")
    renew(PAGE, {"printed": lambda number: printed[int(number)]})
    write_entries(RECORD, state())
