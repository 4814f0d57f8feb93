"""What runs are worth: load metrics, spectra, results on disk, figures and the HTML report of an evaluation.

Modules: `metrics`, `spectra`, `results`, `summary`, `plots`, `scene`, `report`. Plotting libraries are imported by the
modules that draw only.
"""
