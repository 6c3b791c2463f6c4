"""Logs of real robots, where they are at hand: other people's data, which the project does not carry.

They are looked for beside the project, in shared/data, or where the environment variable OED_LOGS says:
optiodom_differential and optiodom_tricycle (github.com/sousarbarb/optiodom), norlab_drive
(github.com/norlab-ulaval/DRIVE).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import PROBLEMS, ROOT

from oed.study.study import Study
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import load_study, parse_study

DATA = Path(os.environ.get("OED_LOGS", ROOT.parent / "shared" / "data"))

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the logs of real robots are not beside the project"),
]

SESSIONS = (
    ("square", "230620202042"),
    ("square", "230620202144"),
    ("square", "231220200029"),
    ("square", "231220200040"),
    ("free", "030120210006"),
)
"""Each of several runs of one path."""
CIRCLES = (("circular", "250620202104"), ("circular", "250620202236"))
"""Alike, of circles in one direction."""
OFF_CLOCK = {"231220200029_run-02", "030120210006_run-03"}
"""Runs whose encoders are known to be off the motion capture's clock."""


def study_of(name: str, **calibration: Any) -> Study:
    study = load_study(PROBLEMS / f"{name}.yaml")
    if not calibration:
        return study
    keys = ", ".join(f"{key}: {value}" for key, value in calibration.items())
    return parse_study(f"{study.text}\ncalibration: {{{keys}}}\n", study.source)


def runs_of(kind: str, session: str, robot: str = "differential") -> list[Path]:
    return sorted((DATA / f"optiodom_{robot}" / kind / session).glob("*_run-*.csv"))


def entry(found: Any, name: str) -> dict[str, Any]:
    entries = [*found.data["parameters"], *found.data["coefficients"]]
    return next(one for one in entries if one["name"] == name)


def meets(found: Any, name: str, low: float, high: float) -> bool:
    """Whether a parameter's 95 % interval meets a range."""
    first, last = entry(found, name)["interval"]
    return first <= high and last >= low


def size(one: Any, kind: str | None) -> float:
    return float(one.standard_error if kind is None else one.error(kind))


def scatter(
    sessions: tuple[tuple[str, str], ...], *kinds: str | None, **calibration: Any
) -> dict[str | None, np.ndarray]:
    """How much estimates of single runs scatter in units of their standard errors, (p,), by kinds of these;
    None for the one in use.
    """
    study = study_of("optiodom_differential", **calibration)
    found = dict[str | None, list[np.ndarray]]()
    for path, session in sessions:
        runs = [run for run in runs_of(path, session) if run.stem not in OFF_CLOCK]
        each = [estimate(study, [run]) for run in runs]
        variance = np.array([list(one.values.values()) for one in each]).var(axis=0, ddof=1)
        for kind in kinds:
            rows = [[size(one, kind) for one in run.parameters] for run in each]
            found.setdefault(kind, []).append(variance / (np.array(rows) ** 2).mean(axis=0))
    return {kind: np.sqrt(np.mean(ratios, axis=0)) for kind, ratios in found.items()}


@pytest.fixture(scope="module")
def squares() -> Any:
    apart = runs_of("free", "030120210006")
    return estimate(study_of("optiodom_differential"), runs_of("square", "231220200029"), apart=apart)


class TestDifferentialDrive:
    def test_agrees_with_a_careful_regression(self, squares):
        # Two-stage least squares on windows of 1 s gave r 41.8-41.9 mm, B 201-203 mm.
        for side in ("right", "left"):
            assert meets(squares, f"wheel_radius_{side}", 0.0418, 0.0419)
        assert meets(squares, "track", 0.201, 0.203)

    def test_dead_reckoning_of_free_drives_improves(self, squares):
        means = squares.data["held_out"]["mean"]
        for number in ("rmse_position", "rmse_heading", "end_position"):
            assert means["after"][number] < 0.6 * means["before"][number]

    def test_finds_clocks_that_are_apart(self):
        study = study_of("optiodom_differential", segment="2 s")
        each = {run.stem: estimate(study, [run]) for run in runs_of("free", "030120210006")}
        offsets = {name: found.data["logs"][0]["clock_offset"] for name, found in each.items()}
        assert offsets.pop("030120210006_run-03") == pytest.approx(0.34, abs=0.04)
        assert max(map(abs, offsets.values())) < 0.1
        values = {name: entry(found, "c11")["value"] for name, found in each.items()}
        repaired = values.pop("030120210006_run-03")
        assert repaired == pytest.approx(np.mean(list(values.values())), rel=0.01)

    def test_standard_errors_agree_with_the_scatter_of_runs(self):
        ratios = scatter(SESSIONS, "bootstrap", "information", covariance="bootstrap")
        assert np.all((ratios["bootstrap"] > 1 / 1.5) & (ratios["bootstrap"] < 1.5))
        assert np.all(ratios["information"] > 1.5)

    def test_default_standard_errors_are_not_smaller_than_the_scatter_of_runs(self):
        # A run's errors that all runs have in common show in its residuals, and not in this scatter; and a
        # bootstrap that is chosen, not asked for, is no surer than noise and drift leave it.
        ratios = scatter(SESSIONS, None)
        assert np.all((ratios[None] > 0.4) & (ratios[None] < 1.1))

    def test_f_inverse_under_drift_agrees_with_the_scatter_of_runs(self):
        # Pooled over sessions by their degrees of freedom, and all runs as those of one robot.
        study, each = study_of("optiodom_differential", method="likelihood"), []
        for path, session in SESSIONS:
            runs = [estimate(study, [run]) for run in runs_of(path, session) if run.stem not in OFF_CLOCK]
            values = np.array([list(one.values.values()) for one in runs])
            each.append(
                (values, np.array([[size(one, "information") for one in run.parameters] for run in runs]))
            )
        squares = sum((((values - values.mean(axis=0)) / errors) ** 2).sum(axis=0) for values, errors in each)
        within = np.sqrt(squares / sum(len(values) - 1 for values, _ in each))
        assert np.all((within > 0.7) & (within < 1.4))
        values, errors = (np.vstack(part) for part in zip(*each, strict=True))
        mean = (values / errors**2).sum(axis=0) / (1 / errors**2).sum(axis=0)
        whole = np.sqrt((((values - mean) / errors) ** 2).sum(axis=0) / (len(values) - 1))
        assert np.all((whole > 0.7) & (whole < 1.7))

    def test_so_do_those_of_circles_in_one_direction(self):
        ratios = scatter(CIRCLES, "information", None)
        assert np.all((ratios[None] > 1 / 1.5) & (ratios[None] < 1.5))
        assert np.all(ratios["information"] > 4)


class TestOtherRobots:
    def test_tricycle(self):
        runs = [
            run
            for session in ("140120211500", "140120211543")
            for run in runs_of("square", session, "tricycle")
        ]
        found = estimate(study_of("optiodom_tricycle"), runs)
        # A regression gave a wheel diameter of 63.5-64.3 mm, a wheelbase of 156-165 mm, -1.2 deg.
        assert meets(found, "wheel_radius", 0.03175, 0.03215)
        assert meets(found, "wheelbase", 0.156, 0.165)
        assert np.rad2deg(entry(found, "steering_offset")["value"]) == pytest.approx(-1.2, abs=0.2)

    @pytest.mark.parametrize(("robot", "track", "wider"), [("husky", 1.15, 2.1), ("warthog", 1.69, 1.56)])
    def test_skid_steer_turns_as_if_it_were_wider(self, robot, track, wider):
        study = study_of(f"norlab_{robot}")
        found = estimate(study, [DATA / "norlab_drive" / f"{robot}_windows.csv"])
        effective, nominal = entry(found, "effective_track")["value"], study.problem.model
        assert effective == pytest.approx(track, rel=0.04)
        assert effective / (nominal.y_icr_left - nominal.y_icr_right) == pytest.approx(wider, rel=0.04)


def test_windows_whose_clock_lies_in_a_corner_converge():
    # Variances and the last run's clock led each other to and fro by a fifth of its standard error.
    study = study_of("optiodom_tricycle")
    short = parse_study(study.text.replace("method: gls", "method: gls, segment: 1 s"), study.source)
    assert estimate(short, runs_of("square", "140120211500", "tricycle")).converged
