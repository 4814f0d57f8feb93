"""Skeleton and style of the report page. Comments such as ``<!--title-->`` are replaced by `wt_gym.analysis.report`."""

__all__ = ["PAGE"]

_STYLE = """
:root { --ink: #1c2733; --muted: #465462; --line: #d5dce4; --paper: #ffffff; --ground: #f3f6f9; --accent: #0b4f79; }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 16px/1.55 Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif; }
header { background: linear-gradient(135deg, #07324f 0%, #0b4f79 55%, #19779a 100%); color: #fff; }
header .inner { max-width: 1200px; margin: 0 auto; padding: 40px 24px 34px; }
header h1 { margin: 0 0 6px; font-size: clamp(1.5rem, 3.4vw, 2.2rem); line-height: 1.2; letter-spacing: -0.01em; }
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
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); gap: 16px; margin-top: 16px; }
.card { border: 1px solid var(--line); border-top: 4px solid var(--agent); border-radius: 10px; padding: 14px 16px; }
.card dl { margin: 0; }
.figure { display: flex; justify-content: space-between; gap: 12px; padding: 5px 0; border-top: 1px solid #edf1f5; }
.figure:first-child { border-top: 0; }
.figure dt { color: var(--muted); font-size: .9rem; }
.figure dd { margin: 0; font-weight: 600; text-align: right; white-space: nowrap;
  font-variant-numeric: tabular-nums; }
.diff { margin-left: 8px; font-size: .82rem; font-weight: 600; }
.better { color: #00694f; } .better::before { content: '\\2713\\00A0'; }
.worse { color: #a63c00; } .worse::before { content: '\\2717\\00A0'; }
.equal, .none { color: var(--muted); font-weight: 400; }
.scroll { overflow-x: auto; margin: 0 -24px; padding: 0 24px; }
table { border-collapse: separate; border-spacing: 0; width: 100%; font-size: .9rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: 7px 10px; border-bottom: 1px solid #e6ebf0; text-align: right; white-space: nowrap; }
td .diff { display: block; margin: 0; font-size: .78rem; }
thead th { border-bottom: 1px solid var(--line); font-weight: 600; }
thead tr:first-child th { color: var(--accent); text-align: center; }
thead tr:last-child th { color: var(--ink); }
thead i { display: inline-block; width: 10px; height: 10px; margin-right: 6px; border-radius: 3px; }
tbody th, thead tr:first-child th:first-child { position: sticky; left: 0; z-index: 1; background: var(--paper);
  text-align: left; font-weight: 500; white-space: normal; min-width: 170px; }
td.first, th.first { border-left: 1px solid var(--line); }
tbody tr:hover td, tbody tr:hover th { background: #f4f8fb; }
.legend { display: flex; flex-wrap: wrap; gap: 6px 18px; margin: 12px 0 0; font-size: .86rem; color: var(--muted); }
.plot { width: 100%; }
ul { padding-left: 1.2em; } li { margin: 4px 0; }
pre { overflow-x: auto; padding: 12px; background: var(--ground); border-radius: 8px; font-size: .8rem; }
details summary { cursor: pointer; color: var(--accent); font-weight: 600; }
footer { max-width: 1200px; margin: 0 auto; padding: 0 24px 40px; color: var(--muted); font-size: .86rem; }
.no-graphics { padding: 40px 16px; text-align: center; color: var(--muted); }
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
  const options = {responsive: true, displaylogo: false, displayModeBar: !narrow, modeBarButtonsToRemove: ['select2d',
  'lasso2d']}; const waiting = Array.from(document.querySelectorAll('.plot'));
  function drawNext() {
    const element = waiting.shift();
    if (!element) return;
    const figure = JSON.parse(document.getElementById(element.dataset.figure).textContent);
    Plotly.newPlot(element, figure.data, figure.layout, options).catch(function () {
      element.innerHTML = '<p class="no-graphics">This figure needs WebGL, which this browser does not offer.</p>';
    }).finally(function () { setTimeout(drawNext, 0); });
  }
  drawNext();
})();
"""

PAGE = f"""<!DOCTYPE html>
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
<section id="summary"><h2>Summary</h2><!--summary--><div class="cards"><!--cards--></div></section>
<section id="comparison"><h2>Comparison</h2>
<p class="caption">Every metric in the mean and in each wind, with the difference to the baseline.</p>
<div class="scroll"><!--table--></div>
<p class="legend"><span class="better">better than the baseline</span><span class="worse">worse than the baseline</span>
<span>† run ended early, not compared</span></p></section>
<!--sections-->
<section id="method"><h2>How to read the numbers</h2><!--method--></section>
</main>
<footer>Made with wt_gym: flexible multibody turbine with unsteady vortex-lattice loads and a free wake.</footer>
<script><!--plotlyjs--></script>
<script>{_SCRIPT}</script>
</body>
</html>
"""
