"""Public sets of logs through the command line, with a short study and no script: the estimates are true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from public_sets import SETS, PublicSet
from scipy import stats
from twin_drives import pulls

from oed.cli import main
from oed.records.record import load_estimate

HERE = Path(__file__).parent
MOST_LINES = 30
"""That a study of somebody else's logs may have."""
DRAWN = ("uwb",)
"""Whose figures are drawn: of sensors without poses. Those of x, y and heading other tests draw."""


def study_of(own: PublicSet) -> Path:
    return HERE / f"{own.name}.yaml"


@pytest.mark.parametrize("own", SETS, ids=str)
def test_its_study_is_short_and_says_nothing_of_designs(own: PublicSet):
    text = study_of(own).read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    assert set(yaml.safe_load(text)) <= {"format", "name", "robot", "measurement", "log", "calibration"}


@pytest.mark.slow
@pytest.mark.parametrize("own", SETS, ids=str)
def test_its_intervals_hold_the_truth(
    own: PublicSet, tmp_path: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
):
    if own.name not in DRAWN:
        request.getfixturevalue("blank_figures")
    logs, out = own.logs(tmp_path), tmp_path / "out"
    assert main(["estimate", str(study_of(own)), *map(str, logs), "--out", str(out), "--quiet"]) == 0
    record = load_estimate(out)
    placed = {one.name: (one.value, one.standard_error) for one in record.nuisances}
    away = list(pulls(record, own.truth).values())
    away += [(placed[name][0] - value) / placed[name][1] for name, value in own.place.items()]
    inside = int(np.sum(np.abs(away) < record.half_width))
    # No fewer are inside their 95 % intervals than nine times in ten.
    assert inside >= stats.binom.ppf(0.1, len(away), 0.95), away
    assert np.abs(away).max() < 1.5 * record.half_width, away
    assert set(own.findings) <= {finding.name for log in record.logs for finding in log.findings}
    assert record.converged
    assert "<svg" in (out / "estimate.html").read_text(encoding="utf-8")
    assert capsys.readouterr().out.rstrip().endswith("estimate.html")
