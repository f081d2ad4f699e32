"""The documentation site: every page is listed, links have targets, and its dark and light pictures are small."""

import re

import pytest
from doc_pages import DOCS, ROOT

PAGES = [p for p in DOCS.rglob("*.md") if not {"node_modules", "build"} & set(p.relative_to(DOCS).parts)]
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]*)#?([^)\s]*)\)")


def anchors(path):
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", t).lower()).replace(" ", "-") for t in titles}


def test_the_site_has_every_page_and_each_has_a_title():
    listed = set()
    for index in (DOCS / "index.md", *DOCS.glob("*/index.md")):
        for block in re.findall(r"```{toctree}\n(.*?)```", index.read_text(encoding="utf-8"), re.DOTALL):
            listed |= {
                (index.parent / name).with_suffix(".md") for name in re.findall(r"^([\w/]+)$", block, re.MULTILINE)
            }
    assert set(PAGES) - {DOCS / "index.md"} <= listed
    assert all(re.match(r"# \S|\(.+\)=\n# ", p.read_text(encoding="utf-8")) for p in PAGES)


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES], ids=lambda p: p.stem)
def test_internal_links_lead_somewhere(page):
    """Links between files of the project, with their anchors."""
    wrong = []
    for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        path = (page.parent / target) if target else page
        if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors(path)):
            wrong.append(f"{target}#{anchor}")
    assert wrong == []


def test_pictures_are_small():
    pictures = [p for p in (DOCS / "pictures").iterdir() if p.suffix in (".png", ".svg")]
    assert len(pictures) >= 6 and max(p.stat().st_size for p in pictures) < 150_000
