"""Keys and kinds that studies no longer have, and what to write instead."""

REMOVED = {
    "cmaes": "there is no CMA-ES any more: use `kind: genetic`",
    "crossover": "the genetic search has one crossover, simulated binary: leave this out",
    "differential_evolution": "there is no differential evolution any more: use `kind: genetic`",
    "mutation": "the genetic search has one mutation, polynomial: leave this out",
    "stated": "use `specified`",
    "tube": "there is no tube any more: use `kind: chance`, or `kind: scenarios` for wide ranges",
}
"""Remedies by key or kind; a key that a part has is never looked up here."""
