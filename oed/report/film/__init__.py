"""Films of drives: the robot in its room, and in simulated physics."""
