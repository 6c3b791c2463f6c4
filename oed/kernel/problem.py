"""A design problem: system + design space + measurement + limits + criterion. It knows no solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from oed.foundation.arguments import called_in_words
from oed.foundation.errors import Issue, ProblemError
from oed.kernel.consistency import parts_of, problem_issues, unbounded
from oed.kernel.criteria import Criterion
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import Limit
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.prior import Prior
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.selection import Selection
from oed.kernel.statement import Statement
from oed.kernel.tightening import ParameterUncertainty, Tightening


class Problem(Statement):
    """Design problem: a system, the drives allowed, a measurement, limits and a criterion.

    Attributes:
        model: the system, as the design space drives it.
        design: all drives allowed.
        measurement: measurement of the drive; several sensors may be given as a list of them.
        limits: limits that a drive must keep to.
        criterion: optimality criterion; one that needs no options may be given by its name, "E".
        name: shown in reports.
        estimate: the parameters to estimate, those of the system or others that it is known by; all that
            the measurement is informative about by default. Other parameters are taken as known. Constants
            of sensors that are nuisances else may be named as well.
        prior: prior knowledge of the parameters.
        uncertainty: distribution of the system's parameters; that of the prior if None.
        robust: treatment of the limits under that uncertainty; only the nominal system keeps them if None.
        excess: share of its size by which every limit, and what the design space asks, may be exceeded; see
            `widened`.
        selection: selection of the readings, where not all of them are taken.
        designed: drives are designed. Else parameters are only estimated, inputs need no bounds, and
            the design space is any.

    Raises:
        ProblemError: the parts do not fit together; every reason is listed.
    """

    @called_in_words
    def __init__(
        self,
        model: System,
        design: Space,
        measurement: Measurement | Sensor | Sequence[Sensor],
        limits: Limit | Sequence[Limit],
        criterion: Criterion | str,
        name: str = "",
        estimate: str | Sequence[str] | None = None,
        prior: Prior | None = None,
        uncertainty: ParameterUncertainty | None = None,
        robust: Tightening | None = None,
        excess: float = 0.0,
        selection: Selection | None = None,
        designed: bool = True,
    ) -> None:
        """Take lists and names for what they stand for, and check that the parts fit together."""
        arguments = locals()
        for field in fields(self):
            object.__setattr__(self, field.name, arguments[field.name])
        for key, part in parts_of(self).items():
            object.__setattr__(self, key, part)
        object.__setattr__(self, "model", self.design.driving(self.model))
        issues = problem_issues(self)
        if isinstance(measurement, Sensor):
            # It was given without a list to number it in.
            first = "measurement", 0
            issues = [
                Issue((*first[:1], *issue.key[2:]), issue.message) if issue.key[:2] == first else issue
                for issue in issues
            ]
        if issues:
            raise ProblemError(issues)

    def require_designed(self) -> None:
        """Refuse a problem of which no drive can be designed.

        Raises:
            ProblemError: says what is missing.
        """
        if not self.designed:
            text = "missing, and so no drive is designed: say how long it takes, e.g. {duration: 20 s}"
            raise ProblemError([Issue(("trajectory",), text), *unbounded(self)])
