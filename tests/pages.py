"""The pages of the documentation that are written by hand, as text, and the blocks in them."""

from __future__ import annotations

import re

from places import ROOT

DOCS = ROOT / "docs"
PAGES = {
    str(file.relative_to(DOCS).with_suffix("")): file.read_text(encoding="utf-8")
    for file in DOCS.rglob("*.md")
    if not {"_build", "generated"} & set(file.relative_to(DOCS).parts)
}
"""Text of every page that is written by hand."""


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[page], flags=re.DOTALL | re.MULTILINE)
