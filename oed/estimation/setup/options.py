"""How parameters are estimated from logs, and other robots that may explain these: the study's key
`calibration`, and `models` in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, field_validator, model_serializer, model_validator
from pydantic_core import CoreSchema

from oed.estimation.setup.unknowns import PLACE, PlaceName
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Issue
from oed.foundation.quantities import Duration
from oed.robots.models import MODELS, Model

Method = Literal["joint", "likelihood", "gls", "two_stage"]
Loss = Literal["linear", "soft_l1", "huber", "cauchy"]
"""What large residuals count for in least squares: their squares, or less."""
CovarianceName = Literal["information", "drift", "sandwich", "bootstrap"]


class Alternative(Component):
    """A robot that is fitted for comparison: the same keys as the study's `robot`, and these.

    Attributes:
        robot: with nominal values to start from.
        name: in tables; its kind by default.
        estimate: the parameters that are fitted, all of its own by default; the others are nominal.
    """

    robot: Annotated[Model, OneOf(MODELS)]
    name: Annotated[str, Field(min_length=1)] | None = None
    estimate: Annotated[tuple[str, ...], Field(min_length=1)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _own_keys(cls, given: Any) -> Any:
        # In a study the robot's keys stand beside the others.
        if isinstance(given, Model):
            return {"robot": given}
        if not isinstance(given, dict) or "robot" in given:
            return given
        own = {key: given[key] for key in ("name", "estimate") if key in given}
        return {**own, "robot": {key: value for key, value in given.items() if key not in own}}

    @model_serializer(mode="plain")
    def _as_given(self) -> dict[str, Any]:
        own: dict[str, Any] = {} if self.name is None else {"name": self.name}
        if self.estimate is not None:
            own["estimate"] = list(self.estimate)
        return {**OneOf(MODELS).as_data(self.robot), **own}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A robot's keys, for editors: which there are depends on its kind."""
        kinds = [kind.model_fields["kind"].default for kind in MODELS]
        return {
            "type": "object",
            "description": "A robot to compare with: the keys of `robot`, and name and estimate.",
            "properties": {
                "kind": {"enum": kinds},
                "name": {"type": "string"},
                "estimate": {"type": "array", "items": {"type": "string"}, "minItems": 1},
            },
        }

    @property
    def label(self) -> str:
        """Its name in tables."""
        return self.name or str(self.robot.kind)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of those that are fitted."""
        return self.estimate or tuple(parameter.name for parameter in self.robot.parameters)

    @property
    def fitted_robot(self) -> Model:
        """The robot with these parameters: itself, or the same in terms of its coefficients."""
        return self.robot.estimating(self.parameters)

    def issues(self, inputs: Sequence[str]) -> list[str]:
        """Why it cannot be fitted to logs of those inputs; [] where it can."""
        missing = [name for name in self.robot.input_names if name not in inputs]
        if missing:
            return [f"{self.label} needs the inputs {', '.join(missing)}; logged are {', '.join(inputs)}"]
        own = [parameter.name for parameter in self.robot.parameters]
        coefficients = [name for row in self.robot.coefficient_names for name in row]
        wanted = self.parameters
        if len(set(wanted)) < len(wanted):
            return [f"{self.label}: a parameter to estimate is listed twice"]
        if set(wanted) <= set(own) or set(wanted) <= set(coefficients):
            return []
        choices = ", ".join(own) + (f", or {', '.join(coefficients)}" if coefficients else "")
        return [f"{self.label}: expected some of its parameters ({choices}), got {', '.join(wanted)}"]


def alternative_issues(robot: Model, models: Iterable[Alternative]) -> list[Issue]:
    """Why robots cannot be compared with a study's own.

    Args:
        robot: the study's own, to whose inputs the logs belong.
        models: the others.
    """
    known, issues = {str(robot.kind)}, []
    for index, one in enumerate(models):
        place = ("calibration", "models", index)
        if one.label in known:
            text = f"a second model named {one.label}; give each a `name` of its own"
            issues.append(Issue((*place, "name") if one.name else place, text))
        known.add(one.label)
        issues += [Issue(place, text) for text in one.issues(robot.input_names)]
    return issues


class CalibrationOptions(Component):
    """Estimation from logs; the defaults suit a first look at any log.

    Attributes:
        method: joint (nonlinear least squares on all poses of each segment, its start unknown), likelihood
            (the most likely path of whole logs of a robot that drifts, with the sizes of noise, drift, and of
            errors that pass or last by restricted likelihood: F^-1 under drift; of poses of robots that are
            moved by their inputs alone), gls (motion
            between the ends of windows, weighted by their correlated noise; of logs of x and y alone, all
            positions of each segment so weighted) or two_stage (the paper's: first the headings, then the
            positions, unweighted).
        segment: length of a segment or window [s]; "log" takes whole logs; auto takes the longest in which no
            drift shows, of windows 2 s.
        covariance: information (F^-1), drift (of a fit to a robot whose pose is a random walk about what its
            inputs say, at the rates that the logs show, or that are usual where they show none), sandwich, or
            moving-block bootstrap; auto takes F^-1 where the logs show that there is no drift that would make
            its standard errors a quarter larger, the bootstrap of eight or more whole logs, else drift or the
            bootstrap, whichever says larger errors; of windows the bootstrap where there are enough.
        block: length of the bootstrap's blocks and of the sandwich's correlations [s]; auto takes whole
            logs where there are eight or more, a fifth of each else.
        replicates: of the bootstrap.
        sensor_place: which coordinates of the pose sensor's place on the robot are nuisance parameters.
        clock_offset: whether the offset between the clocks of wheels and poses is estimated, for each file.
        noise: estimated from the residuals as sigma^2 = sigma0^2 + (k_v V)^2 + (k_w Omega)^2 at speed V and
            yaw rate Omega, each growth only where the likelihood leaves no doubt (that with Omega only
            where it shows from reading to reading as well); estimated as constant
            (where what grows is the model's error, not the sensor's), as correlated (white noise and a
            Gauss-Markov process beside it, as positions by satellites have), or as the measurement specifies.
            Where whole logs are likelier to have correlated noise than drift, auto segments find that.
        loss: of a residual in units of the noise; other than "linear" it bounds the influence of outliers.
        models: other robots, fitted to the same logs and compared with the study's own.
    """

    method: Method = "joint"
    segment: Annotated[Duration, Field(gt=0)] | Literal["auto", "log"] = "auto"
    covariance: CovarianceName | Literal["auto"] = "auto"
    block: Annotated[Duration, Field(gt=0)] | Literal["auto"] = "auto"
    replicates: Annotated[int, Field(ge=100, le=10_000_000)] = 2000
    sensor_place: tuple[PlaceName, ...] = PLACE
    clock_offset: bool = True
    noise: Literal["estimated", "constant", "correlated", "specified"] = "estimated"
    loss: Loss = "linear"
    models: tuple[Alternative, ...] = ()

    @property
    def by_readings(self) -> bool:
        """Whether each reading is fitted, not motion between two."""
        return self.method in ("joint", "likelihood")

    @field_validator("models")
    @classmethod
    def _named_apart(cls, models: tuple[Alternative, ...]) -> tuple[Alternative, ...]:
        labels = [one.label for one in models]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"two models named {', '.join(twice)}; give each a `name` of its own")
        return models
