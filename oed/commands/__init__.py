"""The commands of `oed`, each in a file of its own; a new one is a file and an entry here.

They compute nothing, and load what computes when they are run.
"""

from oed.commands.animate import ANIMATE
from oed.commands.bound import BOUND
from oed.commands.check import CHECK
from oed.commands.command import Command
from oed.commands.estimate import ESTIMATE
from oed.commands.evaluate import EVALUATE
from oed.commands.export import EXPORT
from oed.commands.init import INIT
from oed.commands.next import NEXT
from oed.commands.report import REPORT
from oed.commands.run import RUN
from oed.commands.schema import SCHEMA
from oed.commands.solve import SOLVE
from oed.commands.sweep import SWEEP
from oed.commands.validate import VALIDATE

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
