"""Optimal experiment design for the kinematic calibration of mobile robots.

The names below are the public interface; they are loaded when first used, so that importing `oed` (and
`oed --help`) costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from oed.foundation import moved
from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.bounds import Certificate as Certificate
    from oed.bounds import bound as bound
    from oed.estimation import Calibration as Calibration
    from oed.estimation import CalibrationOptions as CalibrationOptions
    from oed.estimation.methods import Estimate as Estimate
    from oed.estimation.methods import Estimator as Estimator
    from oed.estimation.methods import Nonlinear as Nonlinear
    from oed.estimation.methods import Regression as Regression
    from oed.estimation.methods import make_estimator as make_estimator
    from oed.exporters import diff_drive_parameters as diff_drive_parameters
    from oed.exporters import export as export
    from oed.foundation.errors import Failure as Failure
    from oed.foundation.errors import LogError as LogError
    from oed.foundation.errors import OedError as OedError
    from oed.foundation.errors import ProblemError as ProblemError
    from oed.foundation.errors import StudyError as StudyError
    from oed.foundation.errors import UserMistake as UserMistake
    from oed.kernel.criteria import A as A
    from oed.kernel.criteria import Criterion as Criterion
    from oed.kernel.criteria import D as D
    from oed.kernel.criteria import E as E
    from oed.kernel.criteria import G as G
    from oed.kernel.criteria import I as I
    from oed.kernel.criteria import ModifiedE as ModifiedE
    from oed.kernel.dynamics.rollout import Drive as Drive
    from oed.kernel.dynamics.trajectory import DesignSpace as DesignSpace
    from oed.kernel.dynamics.trajectory import Spline as Spline
    from oed.kernel.dynamics.trajectory import StartPose as StartPose
    from oed.kernel.dynamics.trajectory import Trajectory as Trajectory
    from oed.kernel.evaluation import Evaluation as Evaluation
    from oed.kernel.evaluation import Margin as Margin
    from oed.kernel.evaluation import evaluate as evaluate
    from oed.kernel.identifiability import ambiguities as ambiguities
    from oed.kernel.measurement.prior import Prior as Prior
    from oed.kernel.problem import Problem as Problem
    from oed.kernel.solution import Solution as Solution
    from oed.kernel.solution import Status as Status
    from oed.logs import BagForm as BagForm
    from oed.logs import CsvForm as CsvForm
    from oed.logs import Log as Log
    from oed.logs import LogForm as LogForm
    from oed.logs import read_logs as read_logs
    from oed.optimize import Cluster as Cluster
    from oed.optimize import CmaEs as CmaEs
    from oed.optimize import DifferentialEvolution as DifferentialEvolution
    from oed.optimize import Genetic as Genetic
    from oed.optimize import Ipopt as Ipopt
    from oed.optimize import Solver as Solver
    from oed.optimize import solve as solve
    from oed.records.calibration_record import EstimateRecord as EstimateRecord
    from oed.records.calibration_record import load_estimate as load_estimate
    from oed.records.path_file import read_trajectory as read_trajectory
    from oed.records.path_file import write_trajectory as write_trajectory
    from oed.records.record import Record as Record
    from oed.records.record import load_record as load_record
    from oed.records.record import save_record as save_record
    from oed.report import animate as animate
    from oed.report import write_estimate as write_estimate
    from oed.report import write_report as write_report
    from oed.robots.limits import BodySpeed as BodySpeed
    from oed.robots.limits import Circle as Circle
    from oed.robots.limits import CircularObstacle as CircularObstacle
    from oed.robots.limits import EndHeading as EndHeading
    from oed.robots.limits import EndPosition as EndPosition
    from oed.robots.limits import LateralAcceleration as LateralAcceleration
    from oed.robots.limits import Limit as Limit
    from oed.robots.limits import Obstacle as Obstacle
    from oed.robots.limits import Obstacles as Obstacles
    from oed.robots.limits import PathLength as PathLength
    from oed.robots.limits import Polygon as Polygon
    from oed.robots.limits import PolygonalObstacle as PolygonalObstacle
    from oed.robots.limits import Rectangle as Rectangle
    from oed.robots.limits import Rows as Rows
    from oed.robots.limits import SteeringAngle as SteeringAngle
    from oed.robots.limits import SteeringRate as SteeringRate
    from oed.robots.limits import TurningRadius as TurningRadius
    from oed.robots.limits import WheelAcceleration as WheelAcceleration
    from oed.robots.limits import WheelJerk as WheelJerk
    from oed.robots.limits import WheelSpeed as WheelSpeed
    from oed.robots.limits import Workspace as Workspace
    from oed.robots.models import Ackermann as Ackermann
    from oed.robots.models import DifferentialDrive as DifferentialDrive
    from oed.robots.models import Input as Input
    from oed.robots.models import Mecanum as Mecanum
    from oed.robots.models import Model as Model
    from oed.robots.models import OffsetDrive as OffsetDrive
    from oed.robots.models import OmniThree as OmniThree
    from oed.robots.models import Parameter as Parameter
    from oed.robots.models import SkidSteer as SkidSteer
    from oed.robots.models import SkidSteerIcr as SkidSteerIcr
    from oed.robots.models import SkidSteerSlip as SkidSteerSlip
    from oed.robots.models import TractorTrailer as TractorTrailer
    from oed.robots.models import Tricycle as Tricycle
    from oed.robots.sensors import AbsoluteNoise as AbsoluteNoise
    from oed.robots.sensors import Block as Block
    from oed.robots.sensors import Displacements as Displacements
    from oed.robots.sensors import LeverArm as LeverArm
    from oed.robots.sensors import Measurement as Measurement
    from oed.robots.sensors import Moment as Moment
    from oed.robots.sensors import Nuisance as Nuisance
    from oed.robots.sensors import PoseNoise as PoseNoise
    from oed.robots.sensors import PosePrior as PosePrior
    from oed.robots.sensors import Poses as Poses
    from oed.robots.sensors import Ranges as Ranges
    from oed.robots.sensors import Sensor as Sensor
    from oed.robots.sensors import Several as Several
    from oed.robots.sensors import YawRate as YawRate
    from oed.robots.sensors import regression as regression
    from oed.simulation import Validation as Validation
    from oed.simulation import validate as validate
    from oed.study.study import Study as Study
    from oed.uncertainty.departures import Leaving as Leaving
    from oed.uncertainty.departures import leaving as leaving
    from oed.uncertainty.robust import Robust as Robust
    from oed.uncertainty.uncertainty import Uncertainty as Uncertainty
    from oed.workflow.driven import score_path as score_path
    from oed.workflow.estimate_logs import estimate as estimate
    from oed.workflow.next_drive import NextDrive as NextDrive
    from oed.workflow.next_drive import next_drive as next_drive
    from oed.workflow.runner import run as run

_HOMES = {
    "oed.bounds": ("Certificate", "bound"),
    "oed.estimation": (
        "Calibration",
        "CalibrationOptions",
    ),
    "oed.records.calibration_record": (
        "EstimateRecord",
        "load_estimate",
    ),
    "oed.kernel.criteria": (
        "A",
        "Criterion",
        "D",
        "E",
        "G",
        "I",
        "ModifiedE",
    ),
    "oed.uncertainty.departures": (
        "Leaving",
        "leaving",
    ),
    "oed.workflow.driven": ("score_path",),
    "oed.foundation.errors": (
        "Failure",
        "LogError",
        "OedError",
        "ProblemError",
        "StudyError",
        "UserMistake",
    ),
    "oed.workflow.estimate_logs": ("estimate",),
    "oed.estimation.methods": (
        "Estimate",
        "Estimator",
        "Nonlinear",
        "Regression",
        "make_estimator",
    ),
    "oed.kernel.evaluation": (
        "Evaluation",
        "Margin",
        "evaluate",
    ),
    "oed.exporters": (
        "diff_drive_parameters",
        "export",
    ),
    "oed.kernel.identifiability": ("ambiguities",),
    "oed.robots.limits": (
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
    "oed.robots.sensors": (
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
    "oed.robots.models": (
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
    "oed.workflow.next_drive": (
        "NextDrive",
        "next_drive",
    ),
    "oed.records.path_file": (
        "read_trajectory",
        "write_trajectory",
    ),
    "oed.kernel.measurement.prior": ("Prior",),
    "oed.kernel.problem": ("Problem",),
    "oed.records.record": (
        "Record",
        "load_record",
        "save_record",
    ),
    "oed.report": (
        "animate",
        "write_estimate",
        "write_report",
    ),
    "oed.uncertainty.robust": ("Robust",),
    "oed.kernel.dynamics.rollout": ("Drive",),
    "oed.workflow.runner": ("run",),
    "oed.kernel.solution": (
        "Solution",
        "Status",
    ),
    "oed.optimize": (
        "Cluster",
        "CmaEs",
        "DifferentialEvolution",
        "Genetic",
        "Ipopt",
        "Solver",
        "solve",
    ),
    "oed.study.study": ("Study",),
    "oed.workflow.studies": (
        "load_study",
        "parse_study",
    ),
    "oed.kernel.dynamics.trajectory": (
        "DesignSpace",
        "Spline",
        "StartPose",
        "Trajectory",
    ),
    "oed.uncertainty.uncertainty": ("Uncertainty",),
    "oed.simulation": (
        "Validation",
        "validate",
    ),
}
__all__ = sorted(name for names in _HOMES.values() for name in names)
__getattr__ = loader(__name__, _HOMES)
moved.watch()


def __dir__() -> list[str]:
    """The public names."""
    return __all__
