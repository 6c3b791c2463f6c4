"""The shipped problems of other robots, rooms and runs: solved, scored again, above all their baselines."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from places import PROBLEMS

from oed.kernel.evaluation import Evaluation
from oed.optimize import Ipopt, solve
from oed.robots.baselines import baselines
from oed.robots.models import MODELS
from oed.study.study import Study
from oed.workflow.studies import load_study, parse_study

STARTS = {"husky_outdoors": 2, "tractor_trailer": 2}
"""Starts needed for a design above everyday paths, where one is not enough."""
NAMES = (
    "ackermann",
    "husky_outdoors",
    "mecanum",
    "mecanum_per_sample",
    "obstacle_course",
    "offset_marker",
    "omni_three",
    "own_robot",
    "skid_steer_icr",
    "skid_steer_slip",
    "three_runs",
    "tractor_trailer",
    "tricycle",
    "unicycle",
)


def solved(name: str) -> tuple[Study, Evaluation]:
    # Half the samples: the same problem in half the time. Paths that stop to steer need them all.
    text = (PROBLEMS / f"{name}.yaml").read_text()
    if "steering_angle" not in text:
        for samples in (80, 60, 50, 40):
            text = text.replace(f"samples: {samples}\n", f"samples: {samples // 2}\n")
    study = parse_study(text, str(PROBLEMS / f"{name}.yaml"))
    iterations = 300 if name == "obstacle_course" else 100
    few = Ipopt(starts=STARTS.get(name, 1), perturbations=0, second_stage="none", max_iterations=iterations)
    found = solve(study.problem, few, seed=study.seed, workers=1)
    assert found.evaluation is not None
    return study, found.evaluation


@pytest.mark.slow
def test_every_robot_has_a_problem():
    echoes = [load_study(file).echo() for file in PROBLEMS.glob("*.yaml")]
    kinds = {one["robot"]["kind"] for one in echoes if "robot" in one}
    assert {model.model_fields["kind"].default for model in MODELS} <= kinds


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("obstacle_course", "three_runs")])
def test_designs_are_above_all_everyday_paths(name: str):
    study, design = solved(name)
    assert_above_all_paths(study, design)


def assert_above_all_paths(study: Study, design: Evaluation) -> None:
    assert design.feasible
    for path in study.file.baselines:
        (plain,) = baselines(study.problem, path, seed=study.seed)
        assert plain.evaluation is not None
        if plain.evaluation.feasible:
            assert design.objective > plain.evaluation.objective, path


@pytest.mark.slow
def test_a_room_with_a_corner_and_two_obstacles():
    study, design = solved("obstacle_course")
    assert_above_all_paths(study, design)
    # On the fine grid the body, a disc, touches neither walls nor obstacles, by an independent geometry.
    limits = study.echo()["limits"]
    room = shapely.Polygon(limits["workspace"]["points"])
    column, table = limits["obstacles"]["shapes"]
    for taken in (shapely.Point(column["x"], column["y"]).buffer(column["radius"], 64), table["points"]):
        room = room.difference(shapely.Polygon(taken))
    body = study.problem.model.body_radius
    places = shapely.points(design.path[:, :2])
    assert shapely.contains(room, places).all()
    assert shapely.distance(places, room.boundary).min() >= body - 1e-3
    assert np.hypot(*(design.path[-1, :2] - design.path[0, :2])) <= 0.0101 * np.sqrt(2)


@pytest.mark.slow
def test_every_run_begins_in_the_room_and_keeps_to_its_length():
    study, design = solved("three_runs")
    assert_above_all_paths(study, design)
    runs = np.split(design.path, study.problem.design.runs)
    body = study.problem.model.body_radius
    for path in runs:
        assert np.abs(path[:, :2]).max() <= 0.75 - body + 1e-3
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).sum() <= 3.0 * 1.001
    starts = np.array([path[0, :3] for path in runs])
    assert len(np.unique(starts.round(3), axis=0)) == 3
