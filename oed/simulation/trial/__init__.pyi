from .candidates import trial_flaws as trial_flaws
from .options import Trial as Trial
from .run import require_ready as require_ready
from .run import run_trial as run_trial
