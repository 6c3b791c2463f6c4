"""A drive for a real robot, in the forms that robots take."""
