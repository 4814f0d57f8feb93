"""Skeleton and style of report pages. Comments such as ``<!--title-->`` are replaced by those who write a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plotly.offline import get_plotlyjs

from wt_gym.files import write_text_whole

if TYPE_CHECKING:
    from collections.abc import Mapping

    import plotly.graph_objects as go

__all__ = ["PAGE", "SHELL", "figure_element", "section", "write_page"]

_STYLE = """
:root { --ink: #1c2733; --muted: #465462; --line: #d5dce4; --paper: #ffffff; --ground: #f3f6f9; --accent: #0b4f79; }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 16px/1.55 Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif; }
header { background: linear-gradient(135deg, #07324f 0%, #0b4f79 55%, #19779a 100%); color: #fff; }
header .inner { max-width: 1200px; margin: 0 auto; padding: 22px 24px 18px; }
header h1 { margin: 0 0 6px; font-size: clamp(1.4rem, 3vw, 1.9rem); line-height: 1.2; letter-spacing: -0.01em; }
header p { margin: 0 0 14px; font-size: 1.1rem; color: #dceaf3; }
header ul { display: flex; flex-wrap: wrap; gap: 8px; margin: 0; padding: 0; list-style: none; }
header li { padding: 3px 12px; border-radius: 99px; background: rgba(255, 255, 255, .14); font-size: .86rem; }
main { max-width: 1200px; margin: 0 auto; padding: 24px; }
section { margin: 0 0 22px; padding: 22px 24px; background: var(--paper); border: 1px solid var(--line);
  border-radius: 12px; }
h2 { margin: 0 0 10px; font-size: 1.25rem; letter-spacing: -0.01em; }
h3 { margin: 0 0 8px; font-size: 1.02rem; }
p { margin: 0 0 10px; max-width: 112ch; }
.caption { color: var(--muted); font-size: .92rem; }
small { font-size: .82em; color: var(--muted); font-weight: 400; }
.diff { margin-left: 8px; font-size: .82rem; font-weight: 600; }
.diff small { display: block; color: inherit; opacity: .85; white-space: nowrap; }
.better { color: #00694f; } .better::before { content: '\\2713\\00A0'; }
.worse { color: #a63c00; } .worse::before { content: '\\2717\\00A0'; }
.equal, .open, .none { color: var(--muted); font-weight: 400; }
.open::before { content: '\\2248\\00A0'; }
.badge { display: inline-block; padding: 2px 10px; border-radius: 99px; font-size: .84rem; font-weight: 600;
  background: #e9eef3; color: var(--ink); }
.badge::before { content: none; }
.badge.better { background: #d8efe4; color: #00543f; }
.badge.worse, .badge.lost { background: #fbe3d6; color: #8a3200; }
.badge.trade { background: #fdf0cf; color: #6b4e00; }
.verdicts thead tr th { text-align: right; white-space: normal; color: var(--ink); font-weight: 500; }
.verdicts thead tr th:first-child, .verdicts thead tr th:nth-child(2) { text-align: left; }
.verdicts tbody th { min-width: 90px; }
.verdicts td.verdict { text-align: left; } .verdicts td.verdict small { display: block; }
.verdicts td .diff { font-size: .95rem; } .verdicts i, thead i { display: inline-block; width: 10px; height: 10px;
  margin-right: 6px; border-radius: 3px; }
.scroll { overflow-x: auto; margin: 0 -24px; padding: 0 24px; }
table { border-collapse: separate; border-spacing: 0; width: 100%; font-size: .9rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: 7px 10px; border-bottom: 1px solid #e6ebf0; text-align: right; white-space: nowrap; }
td .diff { display: block; margin: 0; font-size: .78rem; }
thead th { border-bottom: 1px solid var(--line); font-weight: 600; }
thead tr:first-child th { color: var(--accent); text-align: center; }
thead tr:last-child th { color: var(--ink); text-align: right; }
tbody th, thead tr:first-child th:first-child { position: sticky; left: 0; z-index: 1; background: var(--paper);
  text-align: left; font-weight: 500; white-space: normal; min-width: 170px; }
td.first, th.first { border-left: 1px solid var(--line); }
tbody tr:hover td, tbody tr:hover th { background: #f4f8fb; }
.legend { display: flex; flex-wrap: wrap; gap: 6px 18px; margin: 12px 0 0; font-size: .86rem; color: var(--muted); }
.plot { width: 100%; }
ul { padding-left: 1.2em; } li { margin: 4px 0; }
pre { overflow-x: auto; padding: 12px; background: var(--ground); border-radius: 8px; font-size: .8rem; }
section details { border-top: 1px solid #e6ebf0; padding: 8px 0; }
details summary { cursor: pointer; color: var(--accent); font-weight: 600; }
footer { max-width: 1200px; margin: 0 auto; padding: 0 24px 40px; color: var(--muted); font-size: .86rem; }
@media (max-width: 640px) {
  main { padding: 12px; } section { padding: 16px 14px; border-radius: 10px; }
  header .inner { padding: 26px 16px 22px; } .scroll { margin: 0 -14px; padding: 0 0 0 14px; }
  th, td { padding: 6px 7px; } tbody th, thead tr:first-child th:first-child { min-width: 118px; }
}
@media print { body { background: #fff; } section { break-inside: avoid; border: 0; } }
"""

_SCRIPT = """
(function () {
  const narrow = window.innerWidth < 640;
  const options = {responsive: true, displaylogo: false, displayModeBar: narrow ? false : 'hover',
    modeBarButtonsToRemove: ['select2d', 'lasso2d']};
  function draw(element) {
    const figure = JSON.parse(document.getElementById(element.dataset.figure).textContent);
    return Plotly.newPlot(element, figure.data, figure.layout, options);
  }
  // Figures in closed parts have no width yet: they are drawn when somebody opens them.
  const waiting = [];
  for (const element of document.querySelectorAll('.plot')) {
    const closed = element.closest('details:not([open])');
    if (closed) closed.addEventListener('toggle', () => draw(element), {once: true}); else waiting.push(element);
  }
  function drawNext() {
    const element = waiting.shift();
    if (element) draw(element).finally(() => setTimeout(drawNext, 0));
  }
  drawNext();
})();
"""

SHELL = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title><!--title--></title>
<link rel="icon" href="data:,">
<style>{_STYLE}</style>
</head>
<body>
<header><div class="inner"><h1><!--title--></h1><p><!--headline--></p><ul><!--facts--></ul></div></header>
<main>
<!--body-->
</main>
<footer>Made with wt_gym: flexible multibody turbine with unsteady vortex-lattice loads and a free wake.</footer>
<script><!--replayjs--></script>
<script><!--plotlyjs--></script>
<script>{_SCRIPT}</script>
</body>
</html>
"""
"""Page without sections: title, headline, facts, body, scripts."""

PAGE = SHELL.replace(
    "<!--body-->\n",
    """<section id="verdict"><h2><!--question--></h2><!--verdicts--></section>
<section id="summary"><h2>In words</h2><!--summary--></section>
<section id="comparison"><h2>Comparison</h2>
<p class="caption">Every metric over all winds and at each mean wind speed, with its change against the baseline.</p>
<div class="scroll"><!--table--></div>
<p class="legend"><span class="better">better than the baseline</span><span class="worse">worse than the baseline</span>
<span class="open">chance not excluded</span><span>† a run ended early, not compared</span></p></section>
<!--lifetime-->
<!--sections-->
<section id="method"><h2>How to read the numbers</h2><!--method--></section>
""",
)
"""Page of an evaluation."""


def section(name: str, heading: str, caption: str, content: str) -> str:
    """Section of a page."""
    return f"<section id='{name}'><h2>{heading}</h2><p class='caption'>{caption}</p>{content}</section>"


def figure_element(name: str, figure: go.Figure) -> str:
    """A figure that the page's script draws."""
    # "</" would end the script element early.
    data = figure.to_json().replace("</", "<\\/")
    height = int(figure.layout.height)
    return (
        f"<div class='plot' style='height:{height}px' data-figure='{name}-data'></div>"
        f"<script type='application/json' id='{name}-data'>{data}</script>"
    )


def write_page(path: str | Path, skeleton: str, parts: Mapping[str, str]) -> Path:
    """Write a page whole: a skeleton with its comments replaced by parts of their names, and plotly.js inside.

    Parameters
    ----------
    path : str or path
        HTML file; its folder is created if missing.
    skeleton : str
        `PAGE` or `SHELL`.
    parts : mapping

    Returns
    -------
    pathlib.Path
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    page = skeleton
    for name, text in {**parts, "plotlyjs": get_plotlyjs()}.items():
        page = page.replace(f"<!--{name}-->", text)
    write_text_whole(path, page)
    return path
