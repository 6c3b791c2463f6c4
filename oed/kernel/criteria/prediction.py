"""Criteria of what the estimates are for: the variance of the states that they predict (G and I)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue, UserMistake
from oed.foundation.quantities import UNITS_BY_NAME
from oed.foundation.text import count, deviation_text, given_text
from oed.kernel.criteria.criterion import (
    Criterion,
    Epigraph,
    Factor,
    RootCriterion,
    Subject,
    factored,
    lifted,
    multipliers_of,
)
from oed.kernel.criteria.driven import (
    MOST_STEPS,
    Leg,
    TaskDrive,
    sensitivities,
    states_of,
    task_issues,
)
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.square_root import SquareRoot, rounding_of

FAINT = 1e-8
"""Information on every parameter that searches add, in the matrices' units (an optimiser's are typical ones).

It leaves factors to matrices of drives that identify no more than what the predictions need.
"""
PredictedDrive = tuple[Sequence[Sequence[float]], Sequence[float], Sequence[float] | None]
"""Inputs held in every leg of a drive, the legs' durations [s], and its start, if it has its own."""
Rows = tuple[tuple[tuple[tuple[float, ...], ...], ...], ...]


class Prediction(RootCriterion):
    """Shared by G and I.

    Attributes:
        test_drive: legs driven one after the other from the state in which the experiments begin, which is
            known; predictions are judged at the end of each.
        quantity: name of the predicted quantity, one of the system's `predictions`, all its states together.
    """

    of: ClassVar[str]
    """Statistic of the legs' variances that is judged."""
    root_of: ClassVar[str]
    """Standard deviation that is the root of that statistic."""
    test_drive: Annotated[tuple[Leg, ...], Field(min_length=1)]
    quantity: str = "position"
    _rows: Rows = PrivateAttr(default=())

    @property
    def rows(self) -> Rows:
        """Derivatives of the predictions by the scaled parameters: [block][leg][coordinate][parameter].

        Raises:
            UserMistake: the criterion belongs to no problem yet, which has them.
        """
        if not self._rows:
            text = f"{type(self).__name__} predicts with a system, and this criterion knows none"
            raise UserMistake(f"{text}: give `problem.objective` in place of `problem.criterion`")
        return self._rows

    def with_rows(self, rows: Any) -> Self:
        """The criterion with such derivatives.

        Args:
            rows: derivatives of every block, [block][leg][coordinate][parameter].
        """
        criterion = self.model_copy()
        criterion._rows = _nested(rows)
        return criterion

    def about(self, subject: Subject) -> Criterion:
        """The criterion with the predictions' derivatives by the parameters of each block."""
        picked = self.predicted(subject)
        names = [parameter.name for parameter in subject.system.exact.parameters]
        rows = []
        for parameters, scales in zip(subject.parameters, subject.scales, strict=True):
            columns = [names.index(name) for name in parameters]
            rows.append(self.condensed(picked[:, :, columns] * scales).tolist())
        return self.with_rows(rows)

    @property
    def _drives(self) -> list[PredictedDrive]:
        # Each is predicted from its own start.
        legs = self.test_drive
        return [([leg.inputs for leg in legs], [leg.duration for leg in legs], None)] if legs else []

    def predicted(self, subject: Subject) -> Array:
        """Return derivatives (predictions, coordinates, p) of all predictions by the system's parameters."""
        slopes = np.concatenate([sensitivities(subject, *drive) for drive in self._drives])
        return slopes[:, states_of(subject, self.quantity)]

    @property
    def seconds(self) -> float:
        """Longest time that is predicted at once [s], with nothing begun anew."""
        return max((sum(durations) for _, durations, _ in self._drives), default=0.0)

    def condensed(self, rows: Array) -> Array:
        """Rows (predictions, coordinates, p) in place of others with the same judgement; as they are."""
        return rows

    def issues(self, subject: Subject) -> list[Issue]:
        """Legs with more or fewer inputs than the system, parameters that it has not, an unknown quantity, or
        one that no estimated parameter changes, or that is not finite.
        """
        return self.misfits(subject) or self._unmoved(subject)

    def _unmoved(self, subject: Subject) -> list[Issue]:
        names = [name for names in subject.parameters for name in names]
        own_names = [parameter.name for parameter in subject.system.exact.parameters]
        slopes = self.predicted(subject)[..., [own_names.index(name) for name in names]]
        if not np.all(np.isfinite(slopes)):
            text = (
                f"derivatives of the predicted {self.quantity} are not finite: predict less far, or begin "
                "where the rates have finite slopes"
            )
            return [Issue(("criterion", "quantity"), text)]
        if np.any(slopes):
            return []
        text = f"the {self.quantity} predicted depends on none of {', '.join(names)}: every design would do"
        return [Issue(("criterion", "quantity"), text)]

    def misfits(self, subject: Subject) -> list[Issue]:
        """Return what keeps predictions from being made."""
        names, predictions = subject.system.exact.input_names, subject.system.exact.predictions
        issues = [
            Issue(
                ("criterion", "test_drive", index, "inputs"),
                f"expected {len(names)} inputs ({', '.join(names)}), got {len(leg.inputs)}",
            )
            for index, leg in enumerate(self.test_drive)
            if len(leg.inputs) != len(names)
        ]
        if not predictions:
            text = f"predicts states, of which this {subject.system.exact.noun} has none; use E, D or A"
            return [Issue(("criterion", "kind"), text)]
        if self.quantity not in predictions:
            text = f"expected one of {', '.join(predictions)}; got {self.quantity!r}"
            issues.append(Issue(("criterion", "quantity"), text))
        if self.seconds > MOST_STEPS * subject.period:
            horizon, period = given_text(self.seconds, "s"), given_text(subject.period, "s")
            text = f"predicts {horizon}, more than {MOST_STEPS} samples of {period}: predict less far"
            issues.append(Issue(("criterion", "kind"), text))
        own_names = {parameter.name for parameter in subject.system.exact.parameters}
        strangers = [name for names in subject.parameters for name in names if name not in own_names]
        if strangers:
            text = f"predictions follow from the {subject.system.exact.noun}'s parameters"
            text += f"; {', '.join(strangers)} are none"
            issues.append(Issue(("criterion", "kind"), text))
        return issues

    def variances(self, information: Sequence[SquareRoot]) -> Array:
        """Variance of each leg's prediction, (..., legs); infinite of what is not identifiable."""
        variances = [
            np.stack([root.variances(np.array(leg)).sum(axis=-1) for leg in rows], axis=-1)
            for root, rows in zip(information, self.rows, strict=True)
        ]
        return np.asarray(np.sum(variances, axis=0))

    def identifiable(self, information: Sequence[SquareRoot]) -> Array:
        """Return where the predictions are identifiable; other combinations of parameters need not be."""
        return np.asarray(np.isfinite(self.variances(information)).all(axis=-1))

    def symbolic_variances(self, factors: Sequence[Factor]) -> list[Expression]:
        """Variance of each leg's prediction for F_b = L_b L_b', as expressions."""
        totals: list[Expression] = [ca.SX(0)] * len(self.rows[0])
        for factor, block in zip(factors, self.rows, strict=True):
            for leg, rows in enumerate(block):
                totals[leg] += ca.sumsqr(factor.inverse(ca.SX(ca.DM(np.array(rows).T))))
        return totals

    def supergradient(self, matrix: Array, dual: Array | None = None) -> Array:
        """F^- C F^- of predictions with derivatives c, with C the mixture of c c' by `shares`; what a
        search's multipliers say is of the same size: with twice the information half the variance is left.
        """
        inverse = _inverse(matrix)
        plain = np.asarray(inverse @ np.tensordot(self.shares(matrix), self._squares, axes=1) @ inverse)
        multipliers = multipliers_of(dual)
        return (
            plain
            if multipliers is None
            else multipliers * (np.trace(plain @ matrix) / np.trace(multipliers @ matrix))
        )

    @property
    def _squares(self) -> Array:
        # c c' of every leg, (legs, p, p), of the only block.
        return np.array([np.array(leg).T @ np.array(leg) for leg in self.rows[0]])

    @abstractmethod
    def shares(self, matrix: Array, gradient: Array | None = None) -> Array:
        """Return the weights (legs,), 1 in all, with which the criterion is a mean of the legs' variances.

        Args:
            matrix: F, (p, p).
            gradient: G that is to be F^- C F^- for the mixture C; None without.
        """

    def homogeneous_bound(self, matrix: Array, root: Array, most: float) -> float:
        """Tr(C F'^-1) >= (tr (C^1/2 Z C^1/2)^1/2)^2 / tr(Z F') for any Z >= 0; and no mean of variances, by
        whichever shares of the legs, is above the largest.
        """
        return min(
            self._mixture_bound(self.shares(matrix, gradient), root, most)
            for gradient in (root @ root.T, None)
        )

    def _mixture_bound(self, shares: Array, root: Array, most: float) -> float:
        # The singular values of B S with C = B'B and Z = S S'.
        rows = np.vstack(
            [np.sqrt(share) * np.array(leg) for share, leg in zip(shares, self.rows[0], strict=True)]
        )
        mean = float(np.linalg.svd(rows @ root, compute_uv=False).sum())
        return -(mean**2) / most if most > 0 else -math.inf

    @property
    def meaning(self) -> str:
        """Minus a variance; the scaling of the parameters does not change it."""
        legs = count(len(self.test_drive), "leg")
        return f"minus the {self.of} variance of the {self.quantity} predicted after {legs} driven"

    def deviation(self, value: float, size: int) -> str:
        """Return the standard deviation of a prediction, in words."""
        text = deviation_text(math.sqrt(-value), UNITS_BY_NAME.get(self.quantity, ""))
        return f"the {self.root_of} standard deviation of a predicted {self.quantity} is {text}"

    def standard_error(self, names: Sequence[str]) -> str:
        """Return the name of a prediction's standard error."""
        return f"the {self.root_of} standard error of a predicted {self.quantity}"

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        """Ratio of the best design's variance to this one's."""
        return best / value if value < 0 and math.isfinite(best) else None


class G(Prediction):
    """G-optimality: minus the largest variance of a prediction, over the legs of a test drive."""

    of: ClassVar[str] = "largest"
    root_of: ClassVar[str] = "largest"
    share: ClassVar[str] = (
        "the best drive's largest variance of what is predicted for the test drive over this one's"
    )
    kind: Literal["G"] = "G"

    def shares(self, matrix: Array, gradient: Array | None = None) -> Array:
        """Return the weights of a gradient; without one the worst leg has all the weight."""
        inverse, shares = _inverse(matrix), np.zeros(len(self._squares))
        if gradient is not None:
            from scipy.optimize import nnls

            # Without units.
            sizes = np.sqrt(np.clip(np.diag(matrix), 0.0, None))
            gradients = (inverse @ self._squares @ inverse) * np.outer(sizes, sizes)
            gradients, wanted = (
                gradients.reshape(len(shares), -1),
                (gradient * np.outer(sizes, sizes)).ravel(),
            )
            wanted = wanted / (np.abs(wanted).max() or 1.0)
            shares = nnls((gradients / (np.abs(gradients).max() or 1.0)).T, wanted)[0]
        if not np.any(shares):
            shares[int(np.argmax(np.einsum("lab,ab->l", self._squares, inverse)))] = 1.0
        return np.asarray(shares / shares.sum())

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """Minus the largest variance."""
        return np.asarray(-self.variances(information).max(axis=-1))

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise -v with every leg's variance + slack^2 = v."""
        legs = factored(_raised(matrices), lambda factors: ca.vertcat(*self.symbolic_variances(factors)))
        worst, slack = ca.SX.sym("v"), ca.SX.sym("slack", len(self.test_drive))

        def initial(numeric: Sequence[Array]) -> Array:
            variances = self.variances([SquareRoot.of_matrix(lifted(matrix)) for matrix in numeric])
            start = 1.1 * float(variances.max())
            return np.concatenate([legs.initial(numeric), [start], np.sqrt(start - variances)])

        equalities = ca.vertcat(legs.equalities, legs.objective + slack**2 - worst)
        return Epigraph(-worst, ca.vertcat(legs.variables, worst, slack), equalities, initial)


class I(Prediction):  # noqa: E742
    """I-optimality: minus the mean variance of the predictions, over the legs of a test drive, or all along
    drives of the user's own.

    Attributes:
        task: drives to predict, instead of a test drive: predicted from a known start, the variance
            is the mean over all drives and the ends of all their periods. In a study each is the name of a
            trajectory CSV, from the study's folder.
    """

    of: ClassVar[str] = "mean"
    root_of: ClassVar[str] = "root mean square of the"
    share: ClassVar[str] = (
        "the best drive's mean variance of what is predicted for the test drive over this one's"
    )
    kind: Literal["I"] = "I"
    test_drive: tuple[Leg, ...] = ()
    task: tuple[str | TaskDrive, ...] = ()

    @model_validator(mode="after")
    def _one_of_the_two(self) -> I:
        if bool(self.test_drive) == bool(self.task):
            text = "the two exclude each other" if self.task else "and neither is there"
            raise ValueError(f"expected test_drive (legs) or task (drives of your own), {text}")
        return self

    def misfits(self, subject: Subject) -> list[Issue]:
        """Return what keeps predictions from being made, tasks included that are not read or not of this
        system.
        """
        return super().misfits(subject) or list(task_issues(subject, self.task))

    @property
    def _drives(self) -> list[PredictedDrive]:
        drives = [drive for drive in self.task if isinstance(drive, TaskDrive)]
        task = [(drive.inputs, [drive.period] * len(drive.inputs), drive.start) for drive in drives]
        return [*super()._drives, *task]

    def condensed(self, rows: Array) -> Array:
        """Return at most p rows whose square is the mean over all predictions of a task."""
        if not self.task:
            return rows
        flat = rows.reshape(-1, rows.shape[-1]) / math.sqrt(len(rows))
        _, sizes, directions = np.linalg.svd(flat, full_matrices=False)
        # What is rounding would ask for combinations that no prediction needs; of a regression that changes
        # none, a row of zeros is left.
        large = sizes > rounding_of(flat) * sizes[0]
        large[0] = True
        return np.asarray((sizes[:, None] * directions)[large][None])

    @property
    def meaning(self) -> str:
        """Minus a variance; the scaling of the parameters does not change it."""
        if not self.task:
            return super().meaning
        drives = count(len(self.task), "drive")
        return f"minus the mean variance of the {self.quantity} predicted all along {drives} of the task"

    def shares(self, matrix: Array, gradient: Array | None = None) -> Array:
        """All count alike."""
        return np.full(len(self.rows[0]), 1.0 / len(self.rows[0]))

    def judge(self, information: Sequence[SquareRoot]) -> Array:
        """Minus the mean variance."""
        return np.asarray(-self.variances(information).mean(axis=-1))

    def epigraph(self, matrices: Sequence[Expression]) -> Epigraph:
        """Maximise minus the mean variance of F_b = L_b L_b'."""
        return factored(
            _raised(matrices), lambda factors: -sum(self.symbolic_variances(factors)) / len(self.rows[0])
        )


def _inverse(matrix: Array) -> Array:
    # Of what is identifiable, in whatever units.
    sizes = np.sqrt(np.clip(np.diag(matrix), 0.0, None))
    sizes[sizes == 0] = 1.0
    square = np.outer(sizes, sizes)
    return np.asarray(np.linalg.pinv(matrix / square, hermitian=True) / square)


def _raised(matrices: Sequence[Expression]) -> list[Expression]:
    # A little more than F, which has a factor in any case.
    return [matrix + FAINT * ca.SX.eye(matrix.shape[0]) for matrix in matrices]


def _nested(values: Any) -> Any:
    # Nested tuples, so that the criterion stays hashable.
    return tuple(map(_nested, values)) if isinstance(values, list) else values
