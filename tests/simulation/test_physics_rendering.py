"""Pictures of simulated drives, where there is something to draw with; a clear word where there is not."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from oed.foundation.errors import Failure
from oed.simulation.physics import FourWheels, drive, frames
from oed.simulation.physics.engine import engine_library

SCRIPT = """
from oed.foundation.errors import Failure
from oed.simulation.physics import FourWheels, drive, frames
motion = drive(FourWheels(), [(6, 3)] * 3, 0.1)
try:
    pictures = list(frames(FourWheels(), motion, rate=10, size=(120, 160)))
except Failure as failure:
    print("nothing to draw with", "MUJOCO_GL" in str(failure))
else:
    print(len(pictures), pictures[0].shape, bool((pictures[0] != pictures[-1]).any()))
"""


@pytest.mark.slow
def test_pictures_follow_the_robot():
    # The graphics library is chosen when the engine is first imported: a process of its own.
    environment = {**os.environ, "MUJOCO_GL": "egl"}
    command = [sys.executable, "-c", SCRIPT]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    if "nothing to draw with True" in run.stdout:
        pytest.skip("nothing to draw with here")
    assert run.stdout.strip() == "4 (120, 160, 3) True"


def test_nothing_to_draw_with_says_so(monkeypatch: pytest.MonkeyPatch):
    def broken(*_: object) -> None:
        raise RuntimeError("no display")

    motion = drive(FourWheels(), np.zeros((1, 2)), 0.1)
    monkeypatch.setattr(engine_library(), "Renderer", broken, raising=False)
    with pytest.raises(Failure, match=r"MUJOCO_GL=egl .*\(no display\)"):
        next(frames(FourWheels(), motion))
