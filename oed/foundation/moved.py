"""Modules that were elsewhere, attributes that had other names: asking by an old name fails, and says the
new one.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

ROOMS = {
    "cli.terminal": "console messages",
    "estimation.prediction": "regressors segments",
    "foundation": "component errors extras files quantities shown",
    "foundation.work": "folders locks signals",
    "kernel": "between coarser criteria evaluation finiteness identifiability problem solution",
    "kernel.dynamics": "direct_call enclosures expression intervals rollout spline trajectory",
    "kernel.measurement": "information matrices prior square_root",
    "records": "path_file record recorded_study stored",
    "robots": "baselines limits models presets",
    "simulation": "trial",
    "study": "starter study_errors yaml_source",
    "uncertainty": "departures robust",
    "workflow": "driven experiments next_drive robustness runner saving sweep",
}
"""Modules and folders of the top level by the room that each has moved to."""
RENAMED = {
    "calibration": "estimation",
    "calibration_record": "records.record",
    "cli.animate": "cli.record_commands",
    "cli.bound": "cli.study_commands",
    "cli.check": "cli.study_commands",
    "cli.commands": "cli.program",
    "cli.estimate": "cli.log_commands",
    "cli.evaluate": "cli.study_commands",
    "cli.export": "cli.record_commands",
    "cli.init": "cli.study_commands",
    "cli.next": "cli.log_commands",
    "cli.report": "cli.record_commands",
    "cli.run": "cli.design_commands",
    "cli.schema": "cli.study_commands",
    "cli.solve": "cli.design_commands",
    "cli.sweep": "cli.design_commands",
    "cli.terminal.streams": "cli.terminal.messages",
    "cli.validate": "cli.record_commands",
    "commands": "cli.program",
    "estimation.assessment.cross_validation": "estimation.assessment.dead_reckoning",
    "estimation.assessment.model_scores": "estimation.assessment.model_selection",
    "estimation.assessment.weak_directions": "estimation.assessment.diagnostics",
    "estimation.methods.errors_in_variables": "estimation.methods.measured_headings",
    "estimation.methods.estimate": "estimation.methods.estimator",
    "estimation.methods.knowledge": "estimation.setup.unknowns",
    "estimation.methods.losses": "estimation.methods.gauss_newton",
    "estimation.methods.replicated": "estimation.methods.measured_headings",
    "estimation.prediction.further_starts": "estimation.prediction.logged_readings",
    "estimation.prediction.logged_states": "estimation.prediction.segments",
    "estimation.prediction.sensor_frame": "estimation.methods.two_stage",
    "estimation.preprocessing.clocks": "estimation.preprocessing.moves",
    "estimation.preprocessing.thinning": "estimation.preprocessing.preprocess",
    "estimation.setup.alternatives": "estimation.setup.options",
    "estimators": "estimation.methods",
    "exporters.controller_limits": "exporters.two_sides",
    "exporters.recorded": "exporters.vehicle",
    "foundation.names": "foundation.files",
    "foundation.own.modules": "foundation.own.code",
    "foundation.own.place": "foundation.own.code",
    "measurements": "robots.sensors",
    "names": "foundation.files",
    "physics_film": "report.film.physics",
    "problem_tables": "records.outcomes",
    "readings": "estimation.prediction.drive_readings",
    "report.estimate.gist": "report.estimate.parameters",
    "report.estimate.page": "report.estimate",
    "report.estimate.provenance": "report.parts.provenance",
    "report.estimate.terminal": "report.estimate.parameters",
    "report.figures.residuals": "report.figures.calibration",
    "report.figures.time": "report.figures.chart",
    "report.parts.rounding": "foundation.text",
    "report.parts.tables": "report.parts.section",
    "robots.baselines.suitability": "robots.baselines.paths",
    "robots.limits.outline": "robots.limits.shapes",
    "robots.limits.path_length": "robots.limits.body_motion",
    "robots.limits.python_limit": "robots.own_parts",
    "robots.limits.trailer_angle": "robots.limits.body_motion",
    "robots.models.ackermann": "robots.models.steered",
    "robots.models.mecanum": "robots.models.omnidirectional",
    "robots.models.offset_drive": "robots.models.differential_drive",
    "robots.models.omni_three": "robots.models.omnidirectional",
    "robots.models.skid_steer_icr": "robots.models.skid_steer",
    "robots.models.tractor_trailer": "robots.models.differential_drive",
    "robots.models.tricycle": "robots.models.steered",
    "robots.models.tryout": "robots.models.python_robot",
    "robots.sensors.python_sensor": "robots.own_parts",
    "robots.sensors.ranges": "robots.sensors.mapped",
    "robots.sensors.trailer_angle": "robots.sensors.biased",
    "robots.sensors.yaw_rate": "robots.sensors.biased",
    "robots.tried": "robots.own_parts",
    "simulation.physics.four_wheels": "simulation.physics.robot",
    "simulation.physics.rendering": "simulation.physics.driving",
    "simulation.physics.sizing": "simulation.physics.robot",
    "simulation.physics.two_wheels": "simulation.physics.robot",
    "simulation.physics.variation": "simulation.physics.robot",
    "simulation.tally": "simulation.checks",
    "simulation.trial.paths": "simulation.trial.options",
    "simulation.trial.statistics": "simulation.trial.outcome",
    "solvers": "optimize",
    "streams": "cli.terminal.messages",
    "validation": "simulation",
}
"""Folders and modules by where they are now, under another name or as part of another."""


NAMES = {"leaving": "violation_probability", "Leaving": "Violation", "Flaw": "Issue"}
"""Public names by those that they had."""


def renamed(old: str) -> str:
    """The public name that was `old`; warns of the old one, which goes on working until 2.0."""
    # Loaded where it is needed: once for each process at most.
    import warnings

    new = NAMES[old]
    warnings.warn(f"oed.{old} is now oed.{new}; the old name ends with 2.0", DeprecationWarning, stacklevel=3)
    return new


class Moved:
    """A finder of `sys.meta_path` that says where a module is that was elsewhere."""

    # No heir of importlib.abc.MetaPathFinder: that module takes longer to load than all else here.

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Nothing of other modules.

        Raises:
            ModuleNotFoundError: of one that has moved; with its new name.
        """
        package, _, module = name.partition(".")
        if package != "oed" or module not in PLACES:
            return None
        text = f"{name} is now oed.{PLACES[module]}; public names are imported from oed itself"
        raise ModuleNotFoundError(text, name=name)


PLACES = RENAMED | {name: f"{room}.{name}" for room, names in ROOMS.items() for name in names.split()}


def watch() -> None:
    """Answer imports by old names from now on."""
    if not any(isinstance(one, Moved) for one in sys.meta_path):
        # First, or folders that an older version left behind would be taken for packages.
        sys.meta_path.insert(0, Moved())


ESTIMATOR = {"promised": "covariance", "replicate": "simulate"}
ATTRIBUTES = {
    "Calibration": {"left_out": "cross_validation", "untold": "weak_directions"},
    "Certificate": {"caps": "bounds"},
    "DrivenPath": {"share_of_best": "efficiency"},
    "Evaluation": {"poses": "states"},
    "FileError": {"flaws": "issues"},
    "Margin": {"kept": "satisfied"},
    "ProblemError": {"flaws": "issues"},
    "Problem": {"robot": "system", "judged_robots": "judged_systems", "told": "judging"},
    "Robust": {"kept": "added_scenarios"},
    "Solution": {"leaving": "violation"},
    "Nonlinear": ESTIMATOR,
    "Regression": ESTIMATOR,
    "Validation": {"promised": "predicted"},
}
"""New names of classes' attributes by old ones."""


METHODS = {"flaws": "issues"}
"""New names of methods that parts of the user's own may have, by old ones."""


def require_new_methods(kind: type) -> None:
    """Make sure that a class has none under a name that nobody calls any more.

    Raises:
        TypeError: it has; with the new name.
    """
    for old, new in METHODS.items():
        if old in vars(kind):
            raise TypeError(f"{kind.__qualname__}.{old} is now called {new}: rename it, or nobody calls it")


class OldName:
    """An attribute's old name on a class; reading it fails and says the new name."""

    def __init__(self, new: str) -> None:
        """Keep the new name."""
        self.new = new

    def __set_name__(self, owner: type, name: str) -> None:
        """Keep the old name."""
        self.old = name

    def __get__(self, instance: object, owner: type) -> Any:
        """Raise AttributeError with the new name."""
        raise AttributeError(
            f"{owner.__name__!r} object has no attribute {self.old!r}: it is now {self.new!r}"
        )


class Renamed:
    """Base of classes whose attributes had other names: those of `ATTRIBUTES`.

    It has no `__getattr__`: that would also answer for properties whose code raises AttributeError.
    """

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Put the old names on the class."""
        super().__init_subclass__(**keywords)
        for old, new in ATTRIBUTES.get(cls.__name__, {}).items():
            name = OldName(new)
            name.__set_name__(cls, old)
            setattr(cls, old, name)
