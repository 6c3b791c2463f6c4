"""The commands of `oed`, each in a file of its own; a new one is a file and an entry here.

They compute nothing, and load what computes when they are run.
"""

from oed.cli.animate import ANIMATE
from oed.cli.bound import BOUND
from oed.cli.check import CHECK
from oed.cli.estimate import ESTIMATE
from oed.cli.evaluate import EVALUATE
from oed.cli.export import EXPORT
from oed.cli.init import INIT
from oed.cli.next import NEXT
from oed.cli.report import REPORT
from oed.cli.run import RUN
from oed.cli.schema import SCHEMA
from oed.cli.solve import SOLVE
from oed.cli.sweep import SWEEP
from oed.cli.terminal.command import Command
from oed.cli.validate import VALIDATE

COMMANDS: tuple[Command, ...] = (
    INIT,
    RUN,
    CHECK,
    SOLVE,
    SWEEP,
    BOUND,
    EVALUATE,
    ESTIMATE,
    NEXT,
    REPORT,
    VALIDATE,
    EXPORT,
    ANIMATE,
    SCHEMA,
)
"""In the order of `oed --help`."""
