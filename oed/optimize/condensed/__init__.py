"""Condensed drives: information and limits by the chain rule over one-sample cells, in NumPy.

`differentiated` evaluates CasADi's functions and their derivatives on arrays; `runs` rolls cells out over all
samples and differentiates them by a run's unknowns; `information` adds up what samples gather and makes the
judged matrices of it; `whole` has the limits on whole runs; `point` is one evaluation of everything; `terms`
is what a search asks for.
"""
