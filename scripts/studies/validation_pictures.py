"""The figures of the page docs/validation.md, from runs of validation cases and from their record.

    python scripts/studies/validation_pictures.py                      # draw again
    python scripts/studies/validation_pictures.py --run all            # run the cases first, some minutes
    python scripts/studies/validation_pictures.py --run uae-phase-vi   # run some of them first

Steady states of docs/data/steady_states.json are those that ``wt-gym simulate --json`` prints. A run of a case replaces
its curves in the file. The bars of the cases come from docs/data/validation.json. All reference data are in the
repository.
"""

import argparse
import json
import math
import re
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from study_pages import DATA, ROOT, read_json, save_svg, write_entries

from envs_tests.physics.validation import Figure as CaseFigure
from envs_tests.physics.validation import bounds_of, load_cases, read_record, run_case
from wt_gym.base.files import read_toml
from wt_gym.base.picture_style import BLUE, COLORS, GRAY, GREEN, INK, LINE_STYLES, ORANGE, plain

CURVES, RECORD, STEADY = "validation_figures.json", "validation.json", "steady_states.json"
PUBLISHED = ROOT / "envs_tests" / "physics" / "data"
QUANTITIES = {"rotor speed [rpm]": 1.0, "pitch [deg]": 1.0, "power [MW]": 1e-3, "thrust [kN]": 1.0}
"""Panels of the steady states with the factors of their data."""
MOST_POINTS = 240  # of a curve
PICTURES = read_toml(Path(__file__).with_suffix(".toml"))
"""Parts of pictures, see the file."""


CASES = tuple(dict.fromkeys(part[0] for parts in PICTURES.values() for part in parts if len(part) == 2))
"""Names of the cases whose figures are drawn."""


def curves_of(result):
    """Figures of a case as plain data: few points, four digits."""
    figures = {}
    for title, figure in result.figures.items():
        if not isinstance(figure, CaseFigure):
            continue
        curves = []
        for curve in figure.curves:
            x, y = (np.asarray(values, dtype=float) for values in (curve.x, curve.y))
            chosen = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST_POINTS)).round().astype(int))
            rounded = ([float(f"{value:.4g}") for value in values[chosen]] for values in (x, y))
            curves.append({"label": curve.label, "style": curve.style, **dict(zip("xy", rounded, strict=True))})
        figures[title] = {"x_label": figure.x_label, "y_label": figure.y_label, "curves": curves}
    return figures


def run(names, path):
    """Run cases and keep their curves, each when it is done."""
    known = load_cases()
    for name in names:
        result = run_case(known[name])
        stored = (read_json(path) if path.exists() else {}) | {name: curves_of(result)}
        write_entries(path, dict(sorted(stored.items())), lambda value: json.dumps(value, ensure_ascii=False))
        print(f"{name}: {len(stored[name])} figures, {result.wall_time:.0f} s", flush=True)


def panels(parts, stored, record):
    """Titles and data of the figures that a picture shows; those of cases without data are left out.

    Parameters
    ----------
    parts : sequence of tuple
        As in `PICTURES`.
    stored : dict
        Curves by case and title.
    record : dict
        Cases of the record.
    """

    def number(title):
        """Number of a published figure, by which those that have one are sorted."""
        found = re.search(r"Fig\D*(\d+)", title)
        return int(found[1]) if found else 0

    shown = []
    for case, pattern, *words in parts:
        if words:
            checks = record.get(case, {}).get("checks", ())
            matches = [(re.search(pattern, check["quantity"]), check) for check in checks]
            chosen = sorted((float(match[1]), check) for match, check in matches if match)
            shown += [(words[0], compared(chosen, *words[1:]))] if chosen else []
        else:
            titles = sorted((title for title in stored.get(case, ()) if re.search(pattern, title)), key=number)
            shown += [(title, stored[case][title]) for title in titles]
    return shown


def compared(chosen, x_label, y_label):
    """Panel of checks, pairs of abscissa and check: expected values with their tolerance, and the obtained ones."""
    x = [place for place, _ in chosen]
    expected, obtained = ([check[key] for _, check in chosen] for key in ("expected", "obtained"))
    band = [check["tolerance"] * (abs(check["expected"]) if check["relative"] else 1.0) for _, check in chosen]
    source = "measured" if "UAE" in chosen[0][1]["source"] else "published"
    curves = [{"label": source, "style": "ks-", "x": x, "y": expected},
              {"label": "simulator", "style": "o-", "x": x, "y": obtained}]  # fmt: skip
    return {"x_label": x_label, "y_label": y_label, "curves": curves, "band": band}


def look(style, k, over_time=False):
    """Marker, line style and color of the curve number k of a panel from matplotlib's short form; over time, a line."""
    marker = next((m for m in "osx+*^." if m in style), None)
    line: object = next((text for text in ("--", "-.", "-", ":") if text in style), "")
    if over_time and marker:
        marker, line = None, LINE_STYLES[k % len(LINE_STYLES)]
    filled = bool(line) or marker not in ("o", "s", "^")
    return {
        "color": INK if "k" in style else COLORS[k % len(COLORS)], "marker": marker, "markersize": 3.5,
        "linestyle": line or ("none" if marker else "-"), "linewidth": 1.3,
        "markerfacecolor": None if filled else "none",
    }  # fmt: skip


def draw_panels(shown, columns=2):
    """Figure with a panel for each pair of a title and its data."""
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(9.2, 2.7 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, (title, data) in zip(grid.ravel(), shown, strict=False):
        plain(axes, data["x_label"], data["y_label"], title[0].upper() + title[1:])
        axes.title.set_fontsize(9)
        k = 0
        for curve in data["curves"]:
            own = look(curve["style"], k, "time" in data["x_label"])
            k += "k" not in curve["style"]
            axes.plot(curve["x"], curve["y"], label=curve["label"] or None, **own)
        if "band" in data:
            x, y, band = (np.array(values) for values in (data["curves"][0]["x"], data["curves"][0]["y"], data["band"]))
            axes.fill_between(x, y - band, y + band, color="0.55", alpha=0.2, linewidth=0, label="tolerance")
        if any(curve["label"] for curve in data["curves"]):
            axes.legend(fontsize=7, frameon=False)
    for axes in grid.ravel()[len(shown) :]:
        axes.remove()
    return figure


def margin(case):
    """Largest error of a case in tolerances: above 1 it fails. None where all checks are bounds that are kept.

    A bound that is missed counts as 1 and by how much, in parts of the bound or of the width of the interval; a sign
    that is missed as 2.
    """
    worst = None
    for check in case["checks"]:
        error, tolerance = (math.inf if isinstance(check[key], str) else check[key] for key in ("error", "tolerance"))
        if check["passed"]:
            found = error / tolerance if tolerance > 0.0 and not isinstance(check["expected"], str) else None
        elif isinstance(check["expected"], str):
            low, high = bounds_of(check["expected"])
            scale = high - low if math.isfinite(high - low) else abs(low if math.isfinite(low) else high)
            found = 1.0 + error / (scale or error)
        else:
            found = error / tolerance if tolerance > 0.0 else math.inf
        if found is not None:
            worst = found if worst is None else max(worst, found)
    return worst


def draw_cases(cases):
    """A bar a case: its largest error in tolerances."""
    margins = {name: margin(case) for name, case in cases.items()}
    order = sorted(margins, key=lambda name: (margins[name] is not None, margins[name] or 0.0), reverse=True)
    half = -(-len(order) // 2)
    figure = Figure(figsize=(9.2, 0.165 * half + 1.0), layout="constrained")
    high = 2.5
    for axes, names in zip(figure.subplots(1, 2), (order[:half], order[half:]), strict=True):
        plain(axes, "largest error in tolerances")
        axes.set_xlim(0.0, high)
        axes.set_ylim(half - 0.3, -0.7)
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.grid(visible=False, axis="y")
        axes.axvline(1.0, color=INK, linewidth=1.0)
        for k, name in enumerate(names):
            value, checks = margins[name], cases[name]["checks"]
            failed = sum(not check["passed"] for check in checks)
            axes.barh(k, min(value or 0.0, high), color=ORANGE if failed else BLUE, height=0.72)
            if value is None:
                axes.plot([0.02], [k], "D", color=GREEN, markersize=4)
            if failed:
                beyond = "" if value is None or value <= high else f", {value:.3g} tolerances"
                inside = value is not None and value > 1.5
                axes.annotate(
                    f"{failed} of {len(checks)} fail{beyond}", (0.0 if inside else value or 0.0, k), xytext=(3, 0),
                    textcoords="offset points", fontsize=7, va="center", color="white" if inside else ORANGE,
                )  # fmt: skip
        axes.tick_params(axis="y", length=0, colors=INK)
        axes.spines["left"].set_color(GRAY)
    bounds = Line2D([], [], color=GREEN, marker="D", linestyle="none", label="passed, bounds only")
    figure.legend(
        handles=[Patch(color=BLUE, label="passed"), bounds,
                 Patch(color=ORANGE, label="a check failed")],
        loc="outside upper center", ncols=3, frameon=False, fontsize=8,
    )  # fmt: skip
    return figure


def steady_states(folder, record):
    """Steady states by turbine and source: wind, then `QUANTITIES` (5, n); a thrust with the rotor's weight is nan."""
    runs = read_json(folder / STEADY)
    found = {name: dict(zip(one, map(np.array, one.values()), strict=True)) for name, one in runs.items()}
    openfast = np.genfromtxt(PUBLISHED / "nrel5mw_openfast.csv", delimiter=",", skip_header=4)
    found["NREL 5-MW"]["OpenFAST"] = openfast[:, [0, 1, 2, 3, 4]].T
    fast = np.genfromtxt(PUBLISHED / "nrel5mw_steady_state.csv", delimiter=",", skip_header=6)
    power = np.minimum(0.944 * fast[:, 3], 5000.0)
    found["NREL 5-MW"]["FAST, published"] = np.array([*fast[:, :3].T, power, np.full(len(fast), np.nan)])
    published = np.genfromtxt(PUBLISHED / "iea22mw_steady.csv", delimiter=",", skip_header=4)
    table = re.findall(r"^\| \d.*$", record["iea22-steady"]["notes"], re.MULTILINE)
    rows = [re.findall(r"(?<=\| )[-+]?[\d.]+", line) for line in table]
    own = np.array(rows, dtype=float)[:, [0, 1, 4, 10, 7]].T * np.array([1.0, 1.0, 1.0, 1e3, 1.0])[:, None]
    both = {name: published[:, [0, k, k + 1, k + 3, k + 2]].T for name, k in (("OpenFAST", 1), ("HAWC2", 6))}
    found["IEA 22-MW"] = {"wt_gym": own} | {
        f"{name}, published": values * np.array([1.0, 1.0, 1.0, 1e3, 1.0])[:, None] for name, values in both.items()
    }
    return found


def draw_steady(states):
    """Rotor speed, pitch, power and thrust over the wind: a column a turbine, a line a source."""
    figure = Figure(figsize=(9.2, 9.6), layout="constrained")
    grid = figure.subplots(len(QUANTITIES), len(states), sharex=True)
    styles = {
        "wt_gym": "o",
        "OpenFAST": "-",
        "OpenFAST, published": "-",
        "HAWC2, published": "--",
        "FAST, published": "--",
    }
    for column, (turbine, sources) in enumerate(states.items()):
        for row, (quantity, factor) in enumerate(QUANTITIES.items()):
            axes = grid[row, column]
            plain(axes, "wind [m/s]" if row == len(QUANTITIES) - 1 else "", quantity if column == 0 else "", "")
            for name, values in sources.items():
                own = name == "wt_gym"
                axes.plot(
                    values[0], factor * values[row + 1], styles[name], label=name, markersize=3.5, linewidth=1.2,
                    color=BLUE if own else ORANGE if styles[name] == "-" else INK, zorder=3 if own else 2,
                )  # fmt: skip
            axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        grid[0, column].set_title(turbine, fontsize=10)
        grid[0, column].legend(fontsize=7, frameon=False, loc="lower right")
    return figure


def draw(folder):
    """Draw all pictures whose data are there; gives their paths."""
    figures = {}
    stored = read_json(folder / CURVES) if (folder / CURVES).exists() else {}
    record = read_record(folder / RECORD) if (folder / RECORD).exists() else {}
    for name, parts in PICTURES.items():
        if shown := panels(parts, stored, record):
            figures[name] = draw_panels(shown)
    if record:
        figures["validation_cases"] = draw_cases(record)
    if "iea22-steady" in record and (folder / STEADY).exists():
        figures["validation_steady"] = draw_steady(steady_states(folder, record))
    paths = [save_svg(figure, folder / f"{name}.svg") for name, figure in figures.items()]
    for path in paths:  # hundredths of a point are enough
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r"\d+\.\d{3,}", lambda found: f"{float(found[0]):.2f}", text), encoding="utf-8")
    return paths


def main(words=None):
    """Run cases, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", nargs="+", default=[], choices=[*CASES, "all"], help="cases to run first")
    parser.add_argument("--out", type=Path, default=DATA, help="folder of data and figures (default: %(default)s)")
    arguments = parser.parse_args(words)
    arguments.out.mkdir(parents=True, exist_ok=True)
    run(CASES if "all" in arguments.run else arguments.run, arguments.out / CURVES)
    for path in draw(arguments.out):
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
