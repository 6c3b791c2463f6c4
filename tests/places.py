"""Where things are."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
PROBLEMS, REPORTS = ROOT / "problems", ROOT / "reports" / "gallery"
