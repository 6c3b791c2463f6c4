"""The founding paper's real experiment in simulation: which drive calibrates a robot that slips best.

A simulated robot drives along the optimal drive of every model and along everyday paths; every model is
calibrated from each drive alone and predicts, by its encoders, where other drives end.
"""

from typing import TYPE_CHECKING

from oed.foundation.lazy import loader

if TYPE_CHECKING:
    from oed.simulation.trial.candidates import trial_flaws as trial_flaws
    from oed.simulation.trial.options import Trial as Trial
    from oed.simulation.trial.run import require_ready as require_ready
    from oed.simulation.trial.run import run_trial as run_trial

_HOMES = {
    "oed.simulation.trial.candidates": ("trial_flaws",),
    "oed.simulation.trial.options": ("Trial",),
    "oed.simulation.trial.run": (
        "require_ready",
        "run_trial",
    ),
}
__getattr__ = loader(__name__, _HOMES)

__all__ = ["Trial", "require_ready", "run_trial", "trial_flaws"]
