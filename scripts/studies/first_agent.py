"""Run the cells of docs/tutorials/first_agent.md, and record what those print that the site does not run.

    python scripts/studies/first_agent.py            # blocks of the page, docs/data/first_agent.json and .svg
"""

import json
import os
import re
import tempfile
from contextlib import redirect_stdout
from hashlib import sha256
from io import StringIO

import matplotlib.pyplot as plt
from study_pages import DATA, ROOT, renew, save_svg

import wt_gym
from wt_gym.base.files import write_text_whole

PAGE = ROOT / "docs" / "tutorials" / "first_agent.md"


def main() -> None:
    """Run the cells in an empty folder, as a reader does."""
    page, names, printed = PAGE.read_text(encoding="utf-8"), {}, []
    plt.switch_backend("agg")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for cell in re.findall(r"^```\{code-cell\} ipython3\n(?::tags: [^\n]*\n)?(.*?)^```", page, re.MULTILINE | re.DOTALL):
            with redirect_stdout(StringIO()) as text:
                exec(cell, names)
            printed.append(text.getvalue().rstrip())
        os.chdir(ROOT)
    save_svg(plt.gcf(), DATA / "first_agent.svg")
    renew(PAGE, {"printed": lambda number: f"```\n{printed[int(number)]}\n```"})
    code = "".join(re.findall(r"^```\{code-cell\}.*?^```", page, re.MULTILINE | re.DOTALL))
    record = {"version": wt_gym.__version__, "cells": sha256(code.encode()).hexdigest()}
    write_text_whole(DATA / "first_agent.json", f"{json.dumps(record)}\n")


if __name__ == "__main__":
    main()
