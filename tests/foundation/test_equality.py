"""Data that holds arrays, compared."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from builders import problem_of, random_drive

from oed.foundation.equality import equal
from oed.kernel.evaluation import evaluate


def test_what_was_copied_or_pickled_is_equal():
    problem = problem_of()
    score = evaluate(problem, random_drive(problem, 1))
    for other in (copy.deepcopy(score), pickle.loads(pickle.dumps(score))):
        assert score == other
        assert score in [other]
    assert score != evaluate(problem, random_drive(problem, 2))
    assert score != "score"


def test_one_number_makes_the_difference():
    drive = random_drive(problem_of(), 1)
    coefficients = drive.coefficients.copy()
    coefficients[0, 0] = np.nextafter(coefficients[0, 0], np.inf)
    assert drive == dataclasses.replace(drive)
    assert drive != dataclasses.replace(drive, coefficients=coefficients)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1.0]), np.array([1]), False),
        (np.array([1.0]), np.array([[1.0]]), False),
        (np.array([1.0]), [1.0], True),
        ({"a": np.zeros(2)}, {"a": np.zeros(2)}, True),
        ({"a": np.zeros(2)}, {"b": np.zeros(2)}, False),
        ([np.zeros(2)], [np.zeros(2), 1], False),
        ((1, "a"), (1, "b"), False),
        (1, 1.0, True),
    ],
)
def test_values(one: object, other: object, same: bool):
    assert equal(one, other) is same
    assert equal(other, one) is same
