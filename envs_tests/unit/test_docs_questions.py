"""Thirty questions of new users: each is answered at a page and anchor, at most three clicks from the start page.

All links between pages lead to a file, and to a heading where they name one.
"""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
STARTS = (DOCS / "index.md", ROOT / "README.md")
CLICKS = 3

QUESTIONS = {
    # training
    "Which environment do I start with?": "faq.md#which-environment-should-i-start-with",
    "How do I train an agent in ten minutes?": "tutorials/first_agent.md",
    "Which algorithm works?": "training.md#algorithms",
    "How do I resume a training?": "training.md#stopping-and-resuming",
    "How do I train with several seeds?": "training.md#several-seeds",
    "Where are the hyperparameters?": "training.md#hyperparameters",
    "What does an agent observe, and how do I change it?": "environments.md#observations",
    "What do the actions mean?": "environments.md#actions",
    "What is the reward, and how do I change it?": "rewards.md#definition",
    "How do I step many turbines at once?": "environments.md#many-turbines-at-once",
    "How do I train on a cluster?": "ray.md#training",
    # own controllers, turbines and winds
    "How do I write my own controller?": "howto/own_controller.md#the-contract",
    "How do I use a model of stable-baselines3?": "howto/own_agent.md#a-model-of-stable-baselines3",
    "How do I use ROSCO?": "howto/bladed.md#rosco",
    "Which controllers are there to compare with?": "baselines.md#catalog",
    "How do I tune a controller?": "baselines.md#tuning",
    "How do I load my own turbine?": "reference/turbine_files.md#what-is-read",
    "How do I use my own wind file?": "wind.md#winds-from-files",
    "How do I read an OpenFAST model?": "howto/openfast.md#read-a-model",
    "How do I export an agent to OpenFAST?": "howto/export.md#openfast-a-complete-model",
    "How do I record signals?": "howto/signals.md#from-an-environment",
    # trust
    "Are the physics validated?": "validation.md#cases",
    "What does not pass?": "aerodynamics_results.md#known-deviations",
    "What is not modeled?": "limits.md",
    "Does the effect of an agent hold in OpenFAST?": "crosscheck.md",
    "How fast is it?": "performance.md#speed",
    "How accurate is the fast fidelity?": "performance.md#accuracy-of-the-fast-fidelities",
    "Which winds does an evaluation use, and what do intervals mean?": "evaluation.md#comparison-with-the-reference",
    "How is the benchmark scored?": "benchmark.md#score",
    "What do axes and signs mean?": "frames.md",
    "Are results reproducible?": "versions.md",
    "How do I cite it?": "cite.md",
    "How does it compare with OpenFAST, QBlade or FLORIS?": "comparison.md",
    "What does this error message mean?": "howto/trouble.md",
}
PAGES = sorted(DOCS.rglob("*.md")) + [
    ROOT / name
    for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "AGENTS.md", "llms.txt", "agents/trained/README.md")
]


def bare(text):
    """A page without code, except for the tables of contents."""

    def kept(block):
        return block[0] if block[1].startswith("{toctree}") else ""

    return re.sub(r"^```([^\n]*)\n.*?^```$", kept, text, flags=re.DOTALL | re.MULTILINE)


@cache
def anchors(page):
    """Anchors of the headings of a page, as GitHub and the site make them, and those written out."""
    found, text = [], bare(page.read_text(encoding="utf-8"))
    for heading in re.findall(r"^#{1,6} (.+)$", text, re.MULTILINE):
        plain = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        found.append(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return {*found, *re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE)}


def links(page):
    """Files that a page links to, with their anchors: links, tables of contents and cards."""
    text = bare(page.read_text(encoding="utf-8"))
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not re.match(r"https?:|mailto:", target):
            path, _, anchor = target.partition("#")
            yield (page.parent / path).resolve() if path else page, anchor
    for block in re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        for entry in re.findall(r"^(?!:)(\S+)$", block, re.MULTILINE):
            yield (page.parent / f"{entry}.md").resolve(), ""
    for entry in re.findall(r"^:link: (\S+)$", text, re.MULTILINE):
        yield (page.parent / f"{entry}.md").resolve(), ""
    for entry in re.findall(r"^:img-top: (\S+)$", text, re.MULTILINE):
        yield (page.parent / entry).resolve(), ""


@cache
def reached(start):
    """Clicks that it takes from a page to every other one."""
    clicks, edge = {start: 0}, [start]
    while edge:
        page = edge.pop(0)
        for target, _ in links(page):
            if target.suffix == ".md" and target.exists() and target not in clicks:
                clicks[target] = clicks[page] + 1
                edge.append(target)
    return clicks


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings(page):
    wrong = []
    for target, anchor in links(page):
        generated = (
            "<!-- generated:" in target.read_text(encoding="utf-8")
            if target.suffix == ".md" and target.exists()
            else False
        )
        if not target.exists() or (anchor and not generated and anchor not in anchors(target)):
            wrong.append((target.name, anchor))
    assert wrong == []


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_near_the_start(question):
    name, _, anchor = QUESTIONS[question].partition("#")
    page = DOCS / name
    assert page.exists()
    assert not anchor or anchor in anchors(page)
    for start in STARTS:
        assert reached(start)[page] <= CLICKS, start


def test_every_page_can_be_reached():
    found = reached(DOCS / "index.md")
    assert [page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md") if page not in found] == []


def test_a_link_that_leads_nowhere_is_noticed(tmp_path):
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    other.write_text("# One `two`, three\n", encoding="utf-8")
    page.write_text("[a](other.md#one-two-three) [b](gone.md)\n```\n[c](code.md)\n```\n", encoding="utf-8")
    assert [(target.name, anchor) for target, anchor in links(page)] == [("other.md", "one-two-three"), ("gone.md", "")]
    assert anchors(other) == {"one-two-three"}


def test_there_are_thirty_questions():
    assert len(QUESTIONS) >= 30
