"""The keys of a study of a robot: its drives, its sensors, its limits, and what its logs are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Optional

from pydantic import BeforeValidator, Field, ValidationInfo, create_model, field_validator
from pydantic_core import PydanticCustomError

from oed.estimation import CalibrationOptions, alternative_issues
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Issue
from oed.kernel.problem import Problem
from oed.logs import AnyLogForm
from oed.robots.baselines import try_baselines
from oed.robots.limits import LIMITS, Limit, PythonLimit
from oed.robots.models import MODELS, Model
from oed.robots.presets import with_preset
from oed.robots.sensors import MEASUREMENTS, Measurement, Sensor
from oed.robots.space import DesignSpace
from oed.simulation.trial import Trial, trial_issues
from oed.study.cross_checks import file_issues, robot_issues
from oed.study.parts import AnyBaseline, AnyPrior
from oed.study.study_file import StudyFile


def _limit_table() -> Any:
    fields: dict[str, Any] = {
        name: (Optional[kind], None)  # noqa: UP045
        for name, kind in LIMITS.items()
    }
    fields["own"] = (Optional[tuple[Annotated[Limit, OneOf((PythonLimit,))], ...]], None)  # noqa: UP045
    said = "Limits by name; all optional."
    return create_model("Limits", __base__=Component, __doc__=said, __module__=__name__, **fields)


Limits = _limit_table()


def sensor_list(value: Any) -> Any:
    """A study's measurement: several sensors are given as a list of them."""
    return {"kind": "several", "sensors": value} if isinstance(value, list) else value


USUAL = DesignSpace(duration=20.0)
"""The drives of a study that designs none: as long and as often read as any."""


class RobotStudyFile(StudyFile):
    """The keys of a study file of a robot.

    Attributes:
        trajectory: the drives to choose from; without it nothing is designed, and parameters are estimated
            from logs alone.
        limits: of a drive that is designed.
    """

    domain: ClassVar[str] = "robots"
    robot: Annotated[Model, OneOf(MODELS)]
    trajectory: DesignSpace | None = None
    measurement: Annotated[Sensor | Measurement, OneOf(MEASUREMENTS), BeforeValidator(sensor_list)]
    prior: AnyPrior | None = None
    limits: Annotated[Limits | None, Field(validate_default=True)] = None  # type: ignore[valid-type]
    baselines: tuple[AnyBaseline, ...] = ()
    same_length: bool = False
    log: AnyLogForm | None = None
    calibration: CalibrationOptions | None = None
    physics: Trial | None = None

    @field_validator("limits")
    @classmethod
    def _limits_of_a_drive(cls, limits: Any, info: ValidationInfo) -> Any:
        if limits is None and info.data.get("trajectory") is not None:
            raise PydanticCustomError("missing", "Field required")
        return limits

    @classmethod
    def completed(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """A study's keys with its robot's preset filled in.

        Raises:
            ProblemError: an unknown preset.
        """
        return with_preset(data)

    @property
    def model(self) -> Model:
        """The robot."""
        return self.robot

    @property
    def called(self) -> str:
        """By the robot's kind."""
        return self.robot.kind

    @property
    def space(self) -> DesignSpace:
        """The drives to choose from, or any where none is designed."""
        return USUAL if self.trajectory is None else self.trajectory

    @property
    def every_limit(self) -> tuple[Limit, ...]:
        """By their names, then those of somebody's own."""
        given = [getattr(self.limits, name, None) for name in LIMITS]
        return (*(limit for limit in given if limit is not None), *(getattr(self.limits, "own", None) or ()))

    @property
    def designs(self) -> bool:
        """Whether drives are designed."""
        return self.trajectory is not None

    def issues(self) -> list[Issue]:
        """Why its keys do not go together; [] where they do."""
        issues = [*file_issues(self), *robot_issues(self)]
        if self.calibration is not None:
            issues += alternative_issues(self.robot, self.calibration.models)
        return issues

    def problem_issues(self, problem: Problem) -> list[Issue]:
        """Why baselines cannot be driven, or a trial cannot be made.

        Raises:
            ProblemError: baselines that do not suit the problem.
        """
        if not self.designs:
            return []
        try_baselines(problem, self.baselines)
        return trial_issues(problem, self.physics)
