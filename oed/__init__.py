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
`oed init` in a terminal writes a first study; `help(oed.solve)` and the like say more.

Mistakes of the user are `oed.UserMistake`, what cannot be done is `oed.Failure`; both are `oed.OedError`.
"""

# The public names are those of `__init__.pyi`; they are loaded when first used, so that importing `oed` (and
# `oed --help`) costs nothing.

import sys

import lazy_loader

from oed.foundation import moved, plots

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """The class or function of a public name, or the version.

    Raises:
        AttributeError: there is none of this name; Python adds the most similar one.
    """
    if name == "__version__":
        from oed.foundation.extras import package_version

        return package_version(__name__)
    if name not in __all__:
        new = moved.NAMES.get(name)
        hint = f": it is now {__name__}.{new}" if new else ""
        text = f"module {__name__!r} has no attribute {name!r}{hint}"
        raise AttributeError(text, name=name, obj=sys.modules[__name__])
    return _public(name)


moved.watch()
plots.drawn_by(f"{__name__}.report.plots")
