"""Tables of the validation cases, from the record of their last runs."""

import json
import textwrap
from pathlib import Path

from envs_tests.physics.validation import load_cases, read_record
from site_parts.markdown import table

RECORD = Path(__file__).resolve().parents[1] / "data" / "validation.json"
_NAME = "docs/data/validation.json"
_WIDTH = 110


def headline():
    """How many checks pass, and what those concern that do not."""
    found, known = read_record(RECORD), json.loads(RECORD.with_name("studies.json").read_text(encoding="utf-8"))
    failing = {name for name, case in found.items() if not case["passed"]}
    concerns = dict.fromkeys(what for name, what, *_ in known["deviations"][1:] if name.strip("`") in failing)
    *most, last = concerns
    checks = [check["passed"] for case in found.values() for check in case["checks"]]
    return f"{sum(checks)} of {len(checks)} checks pass; the failing ones concern {', '.join(most)} and {last}.\n"


def summary():
    """When the record was made, of what, and how the cases did; those that are not in it by name."""
    found, known = read_record(RECORD), load_cases()
    dates = sorted(case["date"] for case in found.values())
    versions = ", ".join(sorted({case["version"] for case in found.values()}))
    missing = [name for name in known if name not in found]
    text = (
        f"From `{_NAME}`, runs of {dates[0]} to {dates[-1]}, version {versions}: {len(found)} of {len(known)} cases, "
        f"{sum(case['passed'] for case in found.values())} of them pass whole.\n\n"
    )
    rows = [
        (f"[`{name}`](#case-{name})", case["title"],
         f"{sum(check['passed'] for check in case['checks'])} / {len(case['checks'])}", _VERDICT[case["passed"]],
         case["date"][:10].replace("-", "\u2011") + _commit(case))
        for name, case in found.items()
    ]  # fmt: skip
    text += table(("case", "title", "checks passed", "result", "run"), rows, "options")
    if missing:
        text += "\nNot in this record: " + ", ".join(f"`{name}`" for name in missing) + ".\n"
    return text


def checks():
    """Every check of every recorded case."""
    return "\n".join(_section(name, case) for name, case in read_record(RECORD).items())


def _section(name, case):
    rows = [
        (check["quantity"], *(f"{_number(check[key])} {check['unit']}" for key in ("expected", "obtained")),
         _share(check["error"], check), _share(check["tolerance"], check), _VERDICT[check["passed"]])
        for check in case["checks"]
    ]  # fmt: skip
    title = case["title"][0].upper() + case["title"][1:]
    head = f"(case-{name})=\n\n## {title}\n\n`{name}` · {case['source']} · run {case['date']}{_commit(case)}\n\n"
    body = table(("quantity", "expected", "obtained", "error", "tolerance", "result"), rows, "checks")
    passed = f"{sum(check['passed'] for check in case['checks'])} of {len(rows)} checks pass"
    return f"{head}:::::{{dropdown}} {passed}\n{body}\n{_notes(case.get('notes', ''))}\n:::::\n"


def _notes(notes):
    """Remarks of a case: a table as such, everything else line by line as it is."""
    lines = notes.strip("\n").splitlines()
    if all(line.startswith("|") for line in lines):
        return "\n".join(["{.checks}", *lines] if lines else [])
    return "\n".join(["~~~~~~text", *(part for line in lines for part in _wrapped(line)), "~~~~~~"])


def _wrapped(line):
    """Prose in lines of a readable length; the rows of a table, which are spaced, stay whole."""
    if "  " in line.strip() or len(line) <= _WIDTH:
        return [line]
    return textwrap.wrap(line, _WIDTH, break_long_words=False, break_on_hyphens=False)


def _commit(case):
    """Commit behind a date; records from before it was kept, and runs without git, have none."""
    return f" `{case['commit']}`" if case.get("commit") else ""


_VERDICT = {True: "pass", False: "**FAIL**"}


def _number(number, form=".6g"):
    return number if isinstance(number, str) else f"{number:{form}}"


def _share(number, check):
    return f"{100 * number:.3g} %" if check["relative"] and not isinstance(number, str) else _number(number, ".3g")
