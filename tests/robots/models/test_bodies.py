"""How large robots are drawn, and where what they tow is."""

from __future__ import annotations

import numpy as np
import pytest

from oed.robots.models import (
    Ackermann,
    DifferentialDrive,
    Mecanum,
    Model,
    OmniThree,
    TractorTrailer,
    Tricycle,
)

RADIUS = {"wheel_radius": 0.05}


@pytest.mark.parametrize(
    ("robot", "width", "sideways"),
    [
        (DifferentialDrive(track=0.2, **RADIUS), 0.2, False),
        (Mecanum(half_wheelbase_plus_half_track=0.3, **RADIUS), 0.3, True),
        (OmniThree(centre_distance=0.2, **RADIUS), 0.3, True),
        (Ackermann(wheelbase=0.5, **RADIUS), 0.3, False),
        (Tricycle(wheelbase=0.5, **RADIUS), 0.3, False),
    ],
    ids=lambda value: value.kind if isinstance(value, Model) else "",
)
def test_robots_know_their_width_and_that_they_tow_nothing(robot: Model, width: float, sideways: bool):
    assert robot.body_width == pytest.approx(width)
    assert robot.sideways is sideways
    assert robot.towed is None
    assert robot.body(np.zeros((4, 3))).shape == (4, 0, 2)


def test_a_trailer_hangs_behind_the_hitch():
    robot = TractorTrailer(track=0.2, hitch_offset=0.1, trailer_length=0.4, **RADIUS)
    straight, bent = robot.body(np.array([[1.0, 2.0, 0.0, 0.0], [1.0, 2.0, np.pi / 2, np.pi / 2]]))
    np.testing.assert_allclose(straight, [[0.9, 2.0], [0.5, 2.0]])
    # The robot faces up and its trailer to the left: the axle is to the right of the hitch.
    np.testing.assert_allclose(bent, [[1.0, 1.9], [1.4, 1.9]])
    assert robot.towed == (0.1, 0.4)
