"""Optimal experiment design for the kinematic calibration of mobile robots.

The names below are the public interface; they are loaded when first used, so that importing `oed` (and
`oed --help`) costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from oed.lazy import loader

if TYPE_CHECKING:
    from oed.bounds import Certificate as Certificate
    from oed.bounds import bound as bound
    from oed.calibration import Calibration as Calibration
    from oed.calibration import CalibrationOptions as CalibrationOptions
    from oed.calibration_record import EstimateRecord as EstimateRecord
    from oed.calibration_record import load_estimate as load_estimate
    from oed.criteria import A as A
    from oed.criteria import Criterion as Criterion
    from oed.criteria import D as D
    from oed.criteria import E as E
    from oed.criteria import G as G
    from oed.criteria import I as I
    from oed.criteria import ModifiedE as ModifiedE
    from oed.departures import Leaving as Leaving
    from oed.departures import leaving as leaving
    from oed.driven import score_path as score_path
    from oed.errors import Failure as Failure
    from oed.errors import LogError as LogError
    from oed.errors import OedError as OedError
    from oed.errors import ProblemError as ProblemError
    from oed.errors import StudyError as StudyError
    from oed.errors import UserMistake as UserMistake
    from oed.estimation import estimate as estimate
    from oed.estimators import Estimate as Estimate
    from oed.estimators import Estimator as Estimator
    from oed.estimators import Nonlinear as Nonlinear
    from oed.estimators import Regression as Regression
    from oed.estimators import make_estimator as make_estimator
    from oed.evaluation import Evaluation as Evaluation
    from oed.evaluation import Margin as Margin
    from oed.evaluation import evaluate as evaluate
    from oed.exporters import diff_drive_parameters as diff_drive_parameters
    from oed.exporters import export as export
    from oed.identifiability import ambiguities as ambiguities
    from oed.limits import BodySpeed as BodySpeed
    from oed.limits import Circle as Circle
    from oed.limits import CircularObstacle as CircularObstacle
    from oed.limits import EndHeading as EndHeading
    from oed.limits import EndPosition as EndPosition
    from oed.limits import LateralAcceleration as LateralAcceleration
    from oed.limits import Limit as Limit
    from oed.limits import Obstacle as Obstacle
    from oed.limits import Obstacles as Obstacles
    from oed.limits import PathLength as PathLength
    from oed.limits import Polygon as Polygon
    from oed.limits import PolygonalObstacle as PolygonalObstacle
    from oed.limits import Rectangle as Rectangle
    from oed.limits import Rows as Rows
    from oed.limits import SteeringAngle as SteeringAngle
    from oed.limits import SteeringRate as SteeringRate
    from oed.limits import TurningRadius as TurningRadius
    from oed.limits import WheelAcceleration as WheelAcceleration
    from oed.limits import WheelJerk as WheelJerk
    from oed.limits import WheelSpeed as WheelSpeed
    from oed.limits import Workspace as Workspace
    from oed.logs import BagForm as BagForm
    from oed.logs import CsvForm as CsvForm
    from oed.logs import Log as Log
    from oed.logs import LogForm as LogForm
    from oed.logs import read_logs as read_logs
    from oed.measurements import AbsoluteNoise as AbsoluteNoise
    from oed.measurements import Block as Block
    from oed.measurements import Displacements as Displacements
    from oed.measurements import LeverArm as LeverArm
    from oed.measurements import Measurement as Measurement
    from oed.measurements import Moment as Moment
    from oed.measurements import Nuisance as Nuisance
    from oed.measurements import PoseNoise as PoseNoise
    from oed.measurements import PosePrior as PosePrior
    from oed.measurements import Poses as Poses
    from oed.measurements import Ranges as Ranges
    from oed.measurements import Sensor as Sensor
    from oed.measurements import Several as Several
    from oed.measurements import YawRate as YawRate
    from oed.measurements import regression as regression
    from oed.models import Ackermann as Ackermann
    from oed.models import DifferentialDrive as DifferentialDrive
    from oed.models import Input as Input
    from oed.models import Mecanum as Mecanum
    from oed.models import Model as Model
    from oed.models import OffsetDrive as OffsetDrive
    from oed.models import OmniThree as OmniThree
    from oed.models import Parameter as Parameter
    from oed.models import SkidSteer as SkidSteer
    from oed.models import SkidSteerIcr as SkidSteerIcr
    from oed.models import SkidSteerSlip as SkidSteerSlip
    from oed.models import TractorTrailer as TractorTrailer
    from oed.models import Tricycle as Tricycle
    from oed.next_drive import NextDrive as NextDrive
    from oed.next_drive import next_drive as next_drive
    from oed.path_file import read_trajectory as read_trajectory
    from oed.path_file import write_trajectory as write_trajectory
    from oed.prior import Prior as Prior
    from oed.problem import Problem as Problem
    from oed.record import Record as Record
    from oed.record import load_record as load_record
    from oed.record import save_record as save_record
    from oed.report import animate as animate
    from oed.report import write_estimate as write_estimate
    from oed.report import write_report as write_report
    from oed.robust import Robust as Robust
    from oed.rollout import Drive as Drive
    from oed.runner import run as run
    from oed.solution import Solution as Solution
    from oed.solution import Status as Status
    from oed.solvers import Cluster as Cluster
    from oed.solvers import CmaEs as CmaEs
    from oed.solvers import DifferentialEvolution as DifferentialEvolution
    from oed.solvers import Genetic as Genetic
    from oed.solvers import Ipopt as Ipopt
    from oed.solvers import Solver as Solver
    from oed.solvers import solve as solve
    from oed.study import Study as Study
    from oed.study import load_study as load_study
    from oed.study import parse_study as parse_study
    from oed.trajectory import DesignSpace as DesignSpace
    from oed.trajectory import Spline as Spline
    from oed.trajectory import StartPose as StartPose
    from oed.trajectory import Trajectory as Trajectory
    from oed.uncertainty import Uncertainty as Uncertainty
    from oed.validation import Validation as Validation
    from oed.validation import validate as validate

_HOMES = {
    "oed.bounds": ("Certificate", "bound"),
    "oed.calibration": (
        "Calibration",
        "CalibrationOptions",
    ),
    "oed.calibration_record": (
        "EstimateRecord",
        "load_estimate",
    ),
    "oed.criteria": (
        "A",
        "Criterion",
        "D",
        "E",
        "G",
        "I",
        "ModifiedE",
    ),
    "oed.departures": (
        "Leaving",
        "leaving",
    ),
    "oed.driven": ("score_path",),
    "oed.errors": (
        "Failure",
        "LogError",
        "OedError",
        "ProblemError",
        "StudyError",
        "UserMistake",
    ),
    "oed.estimation": ("estimate",),
    "oed.estimators": (
        "Estimate",
        "Estimator",
        "Nonlinear",
        "Regression",
        "make_estimator",
    ),
    "oed.evaluation": (
        "Evaluation",
        "Margin",
        "evaluate",
    ),
    "oed.exporters": (
        "diff_drive_parameters",
        "export",
    ),
    "oed.identifiability": ("ambiguities",),
    "oed.limits": (
        "BodySpeed",
        "Circle",
        "CircularObstacle",
        "EndHeading",
        "EndPosition",
        "LateralAcceleration",
        "Limit",
        "Obstacle",
        "Obstacles",
        "PathLength",
        "Polygon",
        "PolygonalObstacle",
        "Rectangle",
        "Rows",
        "SteeringAngle",
        "SteeringRate",
        "TurningRadius",
        "WheelAcceleration",
        "WheelJerk",
        "WheelSpeed",
        "Workspace",
    ),
    "oed.logs": (
        "BagForm",
        "CsvForm",
        "Log",
        "LogForm",
        "read_logs",
    ),
    "oed.measurements": (
        "AbsoluteNoise",
        "Block",
        "Displacements",
        "LeverArm",
        "Measurement",
        "Moment",
        "Nuisance",
        "PoseNoise",
        "PosePrior",
        "Poses",
        "Ranges",
        "Sensor",
        "Several",
        "YawRate",
        "regression",
    ),
    "oed.models": (
        "Ackermann",
        "DifferentialDrive",
        "OffsetDrive",
        "Input",
        "Mecanum",
        "Model",
        "OmniThree",
        "Parameter",
        "SkidSteer",
        "SkidSteerIcr",
        "SkidSteerSlip",
        "TractorTrailer",
        "Tricycle",
    ),
    "oed.next_drive": (
        "NextDrive",
        "next_drive",
    ),
    "oed.path_file": (
        "read_trajectory",
        "write_trajectory",
    ),
    "oed.prior": ("Prior",),
    "oed.problem": ("Problem",),
    "oed.record": (
        "Record",
        "load_record",
        "save_record",
    ),
    "oed.report": (
        "animate",
        "write_estimate",
        "write_report",
    ),
    "oed.robust": ("Robust",),
    "oed.rollout": ("Drive",),
    "oed.runner": ("run",),
    "oed.solution": (
        "Solution",
        "Status",
    ),
    "oed.solvers": (
        "Cluster",
        "CmaEs",
        "DifferentialEvolution",
        "Genetic",
        "Ipopt",
        "Solver",
        "solve",
    ),
    "oed.study": (
        "Study",
        "load_study",
        "parse_study",
    ),
    "oed.trajectory": (
        "DesignSpace",
        "Spline",
        "StartPose",
        "Trajectory",
    ),
    "oed.uncertainty": ("Uncertainty",),
    "oed.validation": (
        "Validation",
        "validate",
    ),
}
__all__ = sorted(name for names in _HOMES.values() for name in names)
__getattr__ = loader(__name__, _HOMES)


def __dir__() -> list[str]:
    """The public names."""
    return __all__
