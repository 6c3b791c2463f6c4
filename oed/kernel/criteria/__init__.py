"""Optimality criteria. A new one is a class in a file here and a name in `CRITERIA`."""

from oed.kernel.criteria.criterion import Criterion, Epigraph, Factor, Subject
from oed.kernel.criteria.driven import Leg, TaskDrive
from oed.kernel.criteria.prediction import G, I
from oed.kernel.criteria.python_criterion import PythonCriterion
from oed.kernel.criteria.spectral import E, ModifiedE
from oed.kernel.criteria.volume import A, D

CRITERIA: tuple[type[Criterion], ...] = (E, D, A, ModifiedE, G, I)
CRITERION_CHOICES = (*CRITERIA, PythonCriterion)
"""Choices for a study's `criterion: {kind: ...}`."""

__all__ = [
    "CRITERIA",
    "CRITERION_CHOICES",
    "A",
    "Criterion",
    "D",
    "E",
    "Epigraph",
    "Factor",
    "G",
    "I",
    "Leg",
    "ModifiedE",
    "PythonCriterion",
    "Subject",
    "TaskDrive",
]
