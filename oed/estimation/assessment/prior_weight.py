"""What is known from before, and logs of a robot that drifts: each weighs as much as it is sure.

The fit weighs readings as if they were independent. Beside nothing else that is of little matter, but beside
a prior it is: a drifting log would outweigh what is known better, and the estimate would be worse than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from oed.estimation.assessment.covariance import Covariance
from oed.estimation.methods.fit import Fit, combinations
from oed.estimation.setup.unknowns import inverse_of_identifiable, inverse_of_sum
from oed.foundation.arrays import Array

COUNTS = 1e-3
"""Share of all information that a prior has at least in some direction where it counts."""


def weighted_with_prior(
    fit: Fit, covariances: Sequence[Covariance]
) -> tuple[Fit, tuple[Covariance, ...], tuple[str, ...]]:
    """The estimate by generalised least squares of a fit's logs, with the covariance that drift gives their
    scores, and of its prior; and its covariances by the ways of the fit's.

    With H the logs' curvature, g their scores, M the covariance of these and K the prior's information, one
    step from the fit's solution, at which the prior pulls as hard as the logs do: with J = H M^-1 H,
    (J + K) d = (H M^-1 - 1) g.

    Args:
        fit: of logs and a prior.
        covariances: of its unknowns, by name.

    Returns:
        The fit at these values, its covariances, and what there is to note; all as they were where the prior
        is of no weight, or nothing is known of drift.
    """
    known = {one.name: one for one in covariances}
    if "drift" not in known or not _counts(fit):
        return fit, tuple(covariances), ()
    curvature = fit.curvature.sum(axis=0)
    total = curvature + fit.knowledge
    scores = {name: total @ one.matrix @ total - fit.knowledge for name, one in known.items()}
    weight = curvature @ inverse_of_identifiable(scores["drift"])
    inverse = inverse_of_sum(weight @ curvature, fit.knowledge)
    pull = fit.scores.sum(axis=0)
    moved = inverse @ (weight @ pull - pull)
    gain, before = inverse @ weight, inverse @ fit.knowledge @ inverse
    own = len(fit.unknowns.parameters)
    found = tuple(_of_logs(one, gain @ scores[one.name] @ gain.T, before, own) for one in covariances)
    text = "logs weigh beside what was known before by how sure drift leaves them"
    return replace(fit, values=fit.values + moved), found, (text,)


def _counts(fit: Fit) -> bool:
    # Whether what was known before is of any weight for the parameters.
    own = slice(len(fit.unknowns.parameters))
    shares = np.diag(fit.inverse @ fit.knowledge)[own]
    return bool(np.any(shares > COUNTS))


def _of_logs(one: Covariance, logs: Array, before: Array, own: int) -> Covariance:
    # Only the logs' part is as unsure as their number makes it [Satterthwaite: An approximate distribution of
    # estimates of variance components, 1946].
    matrix = logs + before
    mine, whole = logs[:own, :own], matrix[:own, :own]
    single = _degrees(one.degrees, mine, whole, np.eye(own))
    least = min(single, _degrees(one.degrees_together, mine, whole, combinations(whole)))
    return replace(one, matrix=matrix, degrees=single, least_degrees=least)


def _degrees(degrees: float, logs: Array, whole: Array, ways: Array) -> float:
    # Of combinations, as columns, of which the logs leave that share of the variance.
    parts, every = (np.einsum("au,ab,bu->u", ways, one, ways) for one in (logs, whole))
    share = float((parts / np.maximum(every, np.finfo(float).tiny)).max(initial=0.0))
    return degrees / max(share, 1e-3) ** 2
