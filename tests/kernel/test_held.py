"""Experiments of which nothing is chosen."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from oed.foundation.errors import PartError
from oed.kernel.dynamics.held import HeldSpace

HELD = np.arange(12.0).reshape(6, 2)
STARTS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])


def test_the_experiment_is_what_was_given():
    space = HeldSpace.of(HELD, STARTS, duration=1.5)
    # Also as it is read from a record.
    again = TypeAdapter(HeldSpace).validate_python(space.model_dump())
    for one in (space, again):
        assert (one.samples, one.runs, one.period) == (3, 2, 0.5)
        np.testing.assert_array_equal(one.only.inputs, HELD)
        np.testing.assert_array_equal(one.only.starts, STARTS)


def test_inputs_are_of_every_period():
    space = HeldSpace.of(HELD, STARTS, duration=1.5).model_dump()
    with pytest.raises(PartError, match="expected inputs of 6 periods, got 5"):
        HeldSpace(**{**space, "held": space["held"][:5]})
