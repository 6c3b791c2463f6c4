"""An independent scorer in NumPy: its own robots, motion, sensitivities, elimination, criteria and limits.

Nothing here imports the package. Derivatives are by the complex step [Squire and Trapp, Using complex
variables to estimate derivatives of real functions, 1998]: exact to rounding.
"""
