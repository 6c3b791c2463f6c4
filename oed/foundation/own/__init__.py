"""Code of the user's own: found where it stands, run with care, and named in studies."""
