"""Pages that are made from the package itself: the gallery of studies and the reference of public names."""

from __future__ import annotations

import shutil
from pathlib import Path

import gallery
import names

PLACE = "generated"
"""Folder of the pages, beside those that are written."""
SAMPLES = ("robust_laser_tracker/figures/bundles.svg",)
"""Figures of the committed reports that pages show."""


def everything(docs: Path) -> None:
    """Write all generated pages into the folder of the documentation."""
    names.write(docs / PLACE / "api")
    gallery.write(docs.parent / "problems", docs / PLACE / "gallery")
    _samples(docs.parent / "reports" / "gallery", docs / PLACE / "samples")


def _samples(reports: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for figure in SAMPLES:
        shutil.copy2(reports / figure, folder)
