"""The validation report: every number and plot on one self-contained HTML page."""

from __future__ import annotations

import base64
import html
import io
from pathlib import Path
from typing import Any

from validation.case import Case, CaseResult, Curve, Figure

__all__ = ["write_report"]

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1b2733; }
h1 { font-size: 1.7rem } h2 { font-size: 1.2rem; margin-top: 2.5rem; border-top: 1px solid #d5dde5; padding-top: 1rem }
table { border-collapse: collapse; width: 100%; font-size: .9rem } th { text-align: left; color: #5b6b7b }
td, th { padding: .25rem .6rem; border-bottom: 1px solid #eaeff4; vertical-align: top }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap } .pass { color: #147a3d } .fail { color: #c0182b;
font-weight: 600 } .source { color: #5b6b7b; font-size: .85rem } pre { white-space: pre-wrap; background: #f4f7fa;
padding: .7rem; border-radius: 6px; font: inherit; font-size: .9rem } figure { margin: 1rem 0 } img { max-width: 100% }
"""


def write_report(folder: str | Path, results: list[tuple[Case, CaseResult]]) -> Path:
    """Write ``validation.html`` into a folder (created if missing) and return its path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "validation.html"
    passed = sum(result.passed for _, result in results)
    body = [
        f"<h1>Validation: {passed} of {len(results)} cases pass</h1>",
        "<table><tr><th>case</th><th>title</th><th>checks</th><th></th><th>time</th></tr>",
        *(_summary_row(case, result) for case, result in results),
        "</table>",
        *(_section(case, result) for case, result in results),
    ]
    head = f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>wt_gym validation</title><style>{STYLE}'
    path.write_text(f"{head}</style></head><body>{''.join(body)}</body></html>", encoding="utf-8")
    return path


def _mark(passed: bool) -> str:
    return '<span class="pass">pass</span>' if passed else '<span class="fail">FAIL</span>'


def _summary_row(case: Case, result: CaseResult) -> str:
    good = sum(check.passed for check in result.checks)
    return (
        f'<tr><td><a href="#{html.escape(case.name)}">{html.escape(case.name)}</a></td>'
        f"<td>{html.escape(case.title)}</td>"
        f'<td class="number">{good}/{len(result.checks)}</td><td>{_mark(result.passed)}</td>'
        f'<td class="number">{result.wall_time:.1f} s</td></tr>'
    )


def _section(case: Case, result: CaseResult) -> str:
    rows = []
    for check in result.checks:
        expected = check.expected if isinstance(check.expected, str) else f"{check.expected:.6g}"
        percent = check.is_relative
        error = f"{100 * check.error:.3g} %" if percent else f"{check.error:.3g}"
        tolerance = f"{100 * check.tolerance:.3g} %" if percent else f"{check.tolerance:.3g}"
        source = f'<div class="source">{html.escape(check.source)}</div>' if check.source else ""
        cells = "".join(
            f'<td class="number">{html.escape(text)}</td>'
            for text in (f"{expected} {check.unit}", f"{check.obtained:.6g} {check.unit}", error, tolerance)
        )
        rows.append(f"<tr><td>{html.escape(check.quantity)}{source}</td>{cells}<td>{_mark(check.passed)}</td></tr>")
    figures = "".join(
        f'<figure><img alt="{html.escape(title)}" src="data:image/png;base64,{_image(title, figure)}"></figure>'
        for title, figure in result.figures.items()
    )
    notes = f"<pre>{html.escape(result.notes)}</pre>" if result.notes else ""
    return (
        f'<h2 id="{html.escape(case.name)}">{html.escape(case.title)} {_mark(result.passed)}</h2>'
        f'<p class="source">{html.escape(case.name)} · {html.escape(case.source)}</p>'
        "<table><tr><th>quantity</th><th>expected</th><th>obtained</th><th>error</th><th>tolerance</th><th></th></tr>"
        f"{''.join(rows)}</table>{notes}{figures}"
    )


def _image(title: str, figure: Any) -> str:
    """A figure of any allowed form as PNG in base64."""
    drawn = figure() if callable(figure) else _draw(title, figure)
    stream = io.BytesIO()
    drawn.savefig(stream, format="png", dpi=110, bbox_inches="tight")
    return base64.b64encode(stream.getvalue()).decode("ascii")


def _draw(title: str, figure: Any) -> Any:
    from matplotlib.figure import Figure as Canvas

    if not isinstance(figure, Figure):
        figure = Figure((Curve(*figure),))
    canvas = Canvas(figsize=(8.0, 4.5))
    axes = canvas.add_subplot()
    for curve in figure.curves:
        axes.plot(curve.x, curve.y, curve.style, label=curve.label or None, linewidth=1.2, markersize=4)
    axes.set(title=title, xlabel=figure.x_label, ylabel=figure.y_label)
    if figure.equal_axes:
        axes.set_aspect("equal")
    if figure.log_x:
        axes.set_xscale("log")
    if figure.log_y:
        axes.set_yscale("log")
    if any(curve.label for curve in figure.curves):
        axes.legend(fontsize="small", ncols=2 if len(figure.curves) > 6 else 1)
    axes.grid(alpha=0.3)
    return canvas
