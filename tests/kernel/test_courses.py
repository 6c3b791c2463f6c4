"""What a design does over time: derivatives of states and readings, against differences."""

from __future__ import annotations

import numpy as np
import pytest

import oed
from oed.kernel.courses import reading_courses, state_courses

RATE, MOST = 0.8, 2.0
SPACE = oed.SignalSpace(duration=4, samples=8, runs=2, signals=("constant",), start=(0.3,))


def growing(rate: float = RATE, most: float = MOST) -> oed.Problem:
    """Logistic growth that is fed: derivatives by its parameters depend on where it is."""
    system = oed.Equations(
        states={"a": ""},
        derivatives={"a": "u + r * a * (1 - a / c)"},
        parameters={"r": f"{rate} 1/s", "c": f"{most}"},
        inputs={"u": "1/s"},
        outputs={"a": "a ** 2"},
    )
    return oed.Problem(
        model=system,
        design=SPACE,
        measurement=oed.Outputs(noise={"a": 0.1}),
        limits=[oed.InputRange(input="u", range=("0 1/s", "1 1/s"))],
        criterion="D",
    )


@pytest.mark.slow
@pytest.mark.parametrize("courses", [state_courses, reading_courses])
@pytest.mark.parametrize("finer", [1, 3])
def test_slopes_are_those_of_the_parameters(courses, finer: int):
    drive = growing().design.trajectory(np.linspace(0.1, 0.6, 16)[:, None], np.full((2, 1), 0.3))
    found = courses(growing(), drive, finer)
    step = 1e-5
    ways = ({"rate": RATE + step}, {"rate": RATE - step}, {"most": MOST + step}, {"most": MOST - step})
    moved = [courses(growing(**way), drive, finer) for way in ways]
    assert len(found) == 2
    for run, (one,) in enumerate(found):
        ahead, back, more, less = (np.asarray(other[run][0].values) for other in moved)
        differences = np.column_stack([ahead - back, more - less]) / (2 * step)
        np.testing.assert_allclose(one.slopes, differences, rtol=1e-6, atol=1e-8)
        assert np.abs(one.slopes[-1]).min() > 0.01
