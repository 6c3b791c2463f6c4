from .candidates import trial_issues as trial_issues
from .options import Trial as Trial
from .run import require_ready as require_ready
from .run import run_trial as run_trial
