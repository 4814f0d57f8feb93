"""What runs are worth: load metrics, spectra, results on disk, figures and the HTML report of an evaluation.

Numbers: `metrics`, `spectra`, `lifetime`, `statistics`, `paired`; on disk: `results`, `replay`; for the page:
`summary`, `plots`, `comparison_plots`, `learning_plots`, `replay_section`, `report`. Plotting libraries are imported by
the modules that draw only.
"""
