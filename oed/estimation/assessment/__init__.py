"""What a fit is worth: error bars, tests, cross-validation, model selection."""
