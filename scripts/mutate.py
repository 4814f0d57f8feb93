#!/usr/bin/env python3
"""Mutants of a file of Python against the tests that should notice them.

    pip install cosmic-ray
    scripts/mutate.py wt_gym/control/actions.py -- envs_tests/unit/test_control_residual.py

cosmic-ray changes one sign, factor, comparison or number at a time; each mutant runs in a process of its own, forked
from one that has imported all that does not depend on the file, in a copy of the repository. Mutants of annotations,
docstrings and messages are left out, and of operators that stand in for each other one is taken. Survivors are printed
as differences: each calls for a test, or for the reason why it changes nothing. Kernels (`*_kernels.py`) are compiled
for minutes and are no case for this tool.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import importlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ARITHMETIC = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Div", "Mod_Mul")
COMPARISONS = ("Eq_NotEq", "NotEq_Eq", "Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt",
               "Is_IsNot", "IsNot_Is")  # fmt: skip
OTHERS = ("ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "ReplaceTrueWithFalse",
          "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd", "NumberReplacer",
          "ZeroIterationForLoop")  # fmt: skip
OPERATORS = (
    *(f"ReplaceBinaryOperator_{name}" for name in ARITHMETIC),
    *(f"ReplaceComparisonOperator_{name}" for name in COMPARISONS),
    *OTHERS,
)


class _WithoutWords(ast.NodeTransformer):
    """Leaves out what no test has to notice: annotations, docstrings, words of errors, guards."""

    def visit_arg(self, node):
        node.annotation = None
        return node

    def visit_AnnAssign(self, node):
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_keyword(self, node):
        return None if node.arg in ("strict", "frozen") else self.generic_visit(node)

    def visit_JoinedStr(self, node):
        return ast.Constant("")

    def visit_If(self, node):
        return None if ast.unparse(node.test) == "TYPE_CHECKING" else self.generic_visit(node)

    def without_docstring(self, node):
        node.returns = None
        node.body = [i for i in node.body if not (isinstance(i, ast.Expr) and isinstance(i.value, ast.Constant))]
        return self.generic_visit(node)

    visit_FunctionDef = visit_ClassDef = visit_Module = without_docstring


def meaning(code: str) -> str:
    """What of a source a test can notice."""
    return ast.dump(_WithoutWords().visit(ast.parse(code)))


def mutants(source: str) -> list[str]:
    """All mutants of a source that mean something else, each a source."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    found, known = [], {meaning(source)}
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        count = sum(len(list(operator.mutation_positions(node))) for node in ast_nodes(get_ast(source)))
        for occurrence in range(count):
            code = mutate_code(source, operator, occurrence)
            try:
                said = meaning(code)
            except SyntaxError:
                continue
            if said not in known:
                known.add(said)
                found.append(code)
    return found


def forget(module: str) -> None:
    """Unload a module of the package and all that import it, so that a fork loads them anew."""
    importers: dict[str, set[str]] = {}
    ours = {name: item for name, item in sys.modules.items() if name.split(".")[0] == "wt_gym"}
    for name, item in ours.items():
        path = getattr(item, "__file__", None)
        for node in ast.walk(ast.parse(Path(path).read_text(encoding="utf-8"))) if path else ():
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            else:
                continue
            for imported in names:
                importers.setdefault(imported, set()).add(name)
    stale, left = set(), [module]
    while left:
        name = left.pop()
        if name not in stale:
            stale.add(name)
            left += importers.get(name, ())
    for name in stale & ours.keys():
        del sys.modules[name]


def noticed(tests: list[str], limit: float) -> bool:
    """Whether the tests fail, or take longer than a limit [s], in a fork of this process."""
    child = os.fork()
    if child == 0:
        os.setsid()
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        import pytest

        os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", *tests])))
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status != 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


@contextmanager
def clone(*modules: str) -> Iterator[Path]:
    """Temporary copy of the repository that this process works in, with modules that forks share."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "wt_gym"
        skipped = shutil.ignore_patterns(".git", ".venv", "__pycache__", "shared", "docs", "*.ipynb")
        shutil.copytree(ROOT, copy, symlinks=True, ignore=skipped)
        os.chdir(copy)
        sys.dont_write_bytecode = True
        sys.path[:] = [str(copy), *(entry for entry in sys.path if entry not in ("", str(ROOT), str(ROOT / "scripts")))]
        for name in ("pytest", "hypothesis.extra.numpy", "scipy.stats", *modules):
            importlib.import_module(name)
        yield copy


def main() -> int:
    """Run the mutants of one file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file", help="the file, from the root of the repository")
    parser.add_argument("tests", nargs="+", help="arguments of pytest, after --")
    parser.add_argument("--sample", type=int, help="how many mutants, drawn with a fixed seed; by default all")
    chosen = parser.parse_args()
    with clone("xarray", "wt_gym.envs.turbine_env") as copy:
        module = ".".join(Path(chosen.file).with_suffix("").parts).removesuffix(".__init__")
        forget(module)
        path = copy / chosen.file
        source = path.read_text(encoding="utf-8")
        begun = time.monotonic()
        if noticed(chosen.tests, 600.0):
            print("the tests fail without a mutant")
            return 2
        limit = 10.0 + 5.0 * (time.monotonic() - begun)
        codes, survivors = mutants(source), 0
        if chosen.sample and chosen.sample < len(codes):
            codes = random.Random(0).sample(codes, chosen.sample)
        for code in codes:
            path.write_text(code, encoding="utf-8")
            if not noticed(chosen.tests, limit):
                survivors += 1
                lines = difflib.unified_diff(source.splitlines(), code.splitlines(), chosen.file, "", "", "", 0, "")
                print("\n".join(list(lines)[2:]), flush=True)
    print(f"{chosen.file}: {len(codes)} mutants, {survivors} survived, {time.monotonic() - begun:.0f} s", flush=True)
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
