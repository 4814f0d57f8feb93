"""Links of the pages lead to files and headings, and every page is near the start page."""

import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
OTHERS = "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "AGENTS.md", "llms.txt", "agents/README.md"
PAGES = sorted(DOCS.rglob("*.md")) + [ROOT / name for name in (*OTHERS, "agents/trained/README.md")]


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


def is_right(target, anchor):
    """The file is there with the heading; headings of generated parts are known to the site alone."""
    if not target.exists():
        return False
    generated = anchor and "<!-- generated:" in target.read_text(encoding="utf-8")
    return not anchor or bool(generated) or anchor in anchors(target)


def test_links_lead_to_files_and_headings():
    wrong = {
        f"{page.relative_to(ROOT)}: {target.name}#{anchor}"
        for page in PAGES
        for target, anchor in links(page)
        if not is_right(target, anchor)
    }
    assert wrong == set()


def test_every_page_is_within_four_clicks():
    clicks = reached(DOCS / "index.md")
    assert [page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md") if clicks.get(page, 9) > 4] == []


def test_a_link_that_leads_nowhere_is_noticed(tmp_path):
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    other.write_text("# One `two`, three\n", encoding="utf-8")
    page.write_text("[a](other.md#one-two-three) [b](gone.md)\n```\n[c](code.md)\n```\n", encoding="utf-8")
    assert [(target.name, anchor) for target, anchor in links(page)] == [("other.md", "one-two-three"), ("gone.md", "")]
    assert anchors(other) == {"one-two-three"}
