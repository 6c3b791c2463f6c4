"""Optimal experiment design for the kinematic calibration of mobile robots.

What shall a robot drive so that its wheel radii, track, slip, ... can be estimated best, and what are they?

    import oed

    study = oed.load_study("study.yaml")                    # 1. the robot, its room and its sensors
    solution = oed.solve(study.problem, "ipopt")            # 2. the best drive
    record = oed.run(study, out="reports/mine")             # 3. or all at once, with a bound and a page
    oed.export("reports/mine", "csv")                       # 4. the drive for the robot
    estimate = oed.estimate(study, ["log.csv"])             # 5. the parameters from its logs

Whatever comes back says what matters of it: `print(solution)`, `solution.summary()`, `solution.plot()`,
`record.plot("paths")`, `record.to_dataframe()`; notebooks show it as a table. All numbers are SI.
`oed init` in a terminal writes a first study. `from oed import *` has the functions; all names, of which
`help(oed.solve)` and the like say more:

    Studies, runs and records
        load_study, parse_study, Study, run, Record, load_record, save_record, next_drive, NextDrive, loop,
        Loop, Command, estimate, EstimateRecord, load_estimate, score_path, DrivenPaths, Precision,
        read_trajectory, write_trajectory
    Problems, drives and their score
        Problem, evaluate, Evaluation, Margin, ambiguities, Ambiguity, Trajectory, Solution, Status,
        Violation, Baseline, Move, Drive, Space, SignalSpace, Spline, System, Input, Parameter
    Robots
        DifferentialDrive, SkidSteer, SkidSteerIcr, SkidSteerSlip, Tricycle, Ackermann, Mecanum, OmniThree,
        OffsetDrive, TractorTrailer, Unicycle, BicycleDynamic, Model, DesignSpace, StartPose
    Systems given by equations, what is read of them, and ranges of their inputs
        Equations, ContinuousSystem, Outputs, Rates, Responses, InputRange
    What their inputs may do
        Constant, PiecewiseConstant, PiecewiseLinear, SplineSignal, Fourier, Signal
    Sensors
        Poses, RelativePoses, Displacements, Ranges, Landmarks, Tags, YawRate, TrailerAngle, Several,
        AbsoluteNoise, Discrepancy, PoseNoise, SightNoise, LeverArm, CameraArm, Mounting, PosePrior, Prior,
        regression, Sensor, Measurement, Moment, Block, Nuisance
    Limits
        WheelSpeed, WheelAcceleration, WheelJerk, BodySpeed, YawRateLimit, LateralAcceleration, TurningRadius,
        SteeringAngle, SteeringRate, CommandedSpeed, CommandedAcceleration, CommandedYawRate,
        CommandedYawAcceleration, Throttle, ThrottleRate, TrailerAngleLimit, InputLimit, Workspace,
        Rectangle, Circle, Polygon, Obstacles, Obstacle, CircularObstacle, PolygonalObstacle, EndPosition,
        EndHeading, PathLength, Limit, BareLimit, PathLimit, Rows
    Criteria
        E, D, A, G, I, TaskDrive, ModifiedE, Criterion, Epigraph, Subject
    Searches
        solve, Ipopt, Genetic, Cluster, Workers, Progress, Solver,
        Context
    Which readings to take
        parts_of, Parts, budgets_of, Budget, Cost, best_weights, whole_weights, Weights, weight_bound
    Uncertain robots
        Uncertainty, Robust, violation_probability
    Bounds
        bound, Certificate, sensitivity_function
    Logs and estimation
        read_logs, Log, CsvForm, BagForm, TupleForm, LogForm, make_estimator, EstimatorName, Heading, Loss,
        Nonlinear, Regression, Estimator, Estimate, CalibrationOptions, Calibration
    Simulated experiments
        validate, Validation, Linearisation
    Reports and exports
        write_report, write_estimate, animate, MadeFilm, export, diff_drive_parameters
    Errors
        OedError, UserMistake, Failure, ProblemError, PartError, WrongKind, FileError, StudyError, LogError,
        RecordError, PathFileError, OwnCodeError, NotFinite, NotSaved, Issue, FileIssue

Mistakes of the user are `oed.UserMistake`, what cannot be done is `oed.Failure`; both are `oed.OedError`.
"""

# The public names are those of `__init__.pyi`; they are loaded when first used, so that importing `oed` (and
# `oed --help`) costs nothing.

import sys

from oed.foundation.work import start

# Before anything that takes time to load.
start.begin()

import lazy_loader  # noqa: E402

from oed.foundation import views  # noqa: E402

_public, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
# Of all names: `help(oed)` prints what each of these says of itself, and a star should bring no E, G or I.
__all__ = [name for name in _names if name.islower()]


def __getattr__(name: str) -> object:
    """The class or function of a public name, or the version.

    Raises:
        AttributeError: there is none of this name; Python adds the most similar one.
    """
    if name == "__version__":
        from oed.foundation.extras import package_version

        return package_version(__name__)
    if name not in _names:
        text = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(text, name=name, obj=sys.modules[__name__])
    return _public(name)


views.register(f"{__name__}.kernel.cards", "card", "table")
views.register(f"{__name__}.report.plots", "figure")
