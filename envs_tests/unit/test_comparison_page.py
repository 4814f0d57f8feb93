"""The page of compared controllers, and that all pages have the same style."""

import re

import pytest

from wt_gym.analysis.page import Section, write_page
from wt_gym.analysis.results import Wind
from wt_gym.experiment.comparison import COLUMNS, ControllerRuns, write_comparison

SEEDS = (1001, 1002, 1003)
SETTINGS = {"duration": 150.0, "skip": 30.0, "fidelity": "training"}


def runs(name, factor, failed=False):
    """Flapwise loads of a controller over three seeds at two speeds; the others are 1."""
    cases = [Wind(speed, seed) for speed in (12.0, 18.0) for seed in SEEDS]
    metrics = {
        case: {key: 1e6 for key, _ in COLUMNS} | {"blade_flap_del": 1e6 * factor(k)} for k, case in enumerate(cases)
    }
    failures = {cases[-1]: "the simulation <failed>"} if failed else {}
    for case in failures:
        del metrics[case]
    return ControllerRuns(name, metrics, failures)


@pytest.fixture
def page(tmp_path):
    compared = [
        runs("discon", lambda k: 1.0),
        runs("ipc", lambda k: 0.8, failed=True),
        runs("a<b", lambda k: 1.0 + 0.05 * (k % 3 - 1)),
    ]
    return write_comparison(compared, tmp_path / "page.html", "Turbine", SETTINGS).read_text(encoding="utf-8")


def test_the_page_answers_first(page):
    header, body = page.split("</header>")
    assert "Least fatigue: ipc changes flapwise blade fatigue by \u221220.0\u00a0%" in header
    assert "<dd>12, 18 m/s</dd>" in header
    assert "seeds 1001, 1002, 1003" in header
    assert body.index("class='legend'") < body.index("<table>")
    assert "ipc at 18 m/s, seed 1003: the simulation &lt;failed&gt;" in body
    assert "a&lt;b" in body
    assert "a<b" not in body


def test_changes_have_their_marks(page):
    rows = page.split("<tbody>")[1].split("<tr>")
    (ipc, *_), (other, *_) = ([row for row in rows if f"</i>{name}</th>" in row] for name in ("ipc", "a&lt;b"))
    assert re.search(r"<span class='diff main better'>\u221220\.0 %<small>\[\u221220\.0, \u221220\.0\]", ipc)
    assert re.search(r"<span class='diff main open'>0\.0 %<small>\[\u2212", other)


def test_a_page_without_figures_has_no_plotly_and_the_style_of_all(page, tmp_path):
    assert len(page) < 100_000
    other = write_page(tmp_path / "other.html", title="T", result="R", facts={}, sections=[Section("a", "A", "text")])
    first, second = (text.split("<style>")[1].split("</style>")[0] for text in (page, other.read_text("utf-8")))
    assert first == second
    assert not re.search(r"@import|url\(|https?:", page)
