"""Analysis of runs: load metrics, changes against a baseline, results on disk, figures and pages.

Numbers: `metrics`, `statistics`; on disk: `results`; pages: `page` (their parts), `figures`, `summary` (words),
`report` (evaluations), `crosscheck` (two simulators); pictures: `scene`. Plotly is imported where it draws only.
"""
