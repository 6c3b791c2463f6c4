"""Systems as expressions: signals, rollouts, and bounds of expressions over stretches of time."""
