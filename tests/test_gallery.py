"""Reports in the repository: those of the gallery, and nothing that a run writes."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from places import REPORTS, ROOT

WRITTEN = ("record.json", "report.html", "report.md", "figures/best_path.svg", "ipopt.csv", "drive.gif")

pytestmark = pytest.mark.skipif(
    shutil.which("git") is None or not (ROOT / ".git").exists(), reason="no clone by git"
)


def ignored(*names: str) -> list[str]:
    asked = subprocess.run(
        ["git", "check-ignore", "--no-index", *names], cwd=ROOT, capture_output=True, text=True
    )
    return asked.stdout.split()


def test_a_run_leaves_the_repository_as_it_was():
    # `make demo` writes the first, a sweep and a comparison the others.
    folders = ("choi_skid_steer", "choi_skid_steer-sweep/point_1", "comparison")
    written = [f"reports/{folder}/{name}" for folder in folders for name in WRITTEN]
    assert ignored(*written) == written


def test_the_gallery_is_kept_without_what_only_repeats_its_records():
    kept = [f"reports/gallery/new/{name}" for name in WRITTEN]
    assert ignored(*kept) == ["reports/gallery/new/report.html"]
    tracked = subprocess.run(["git", "ls-files", "reports"], cwd=ROOT, capture_output=True, text=True)
    assert tracked.stdout.split()
    assert all(name.startswith("reports/gallery/") for name in tracked.stdout.split())
    assert {one.name for one in REPORTS.iterdir()} >= {"choi_skid_steer", "obstacle_course"}
