"""What everything stands on: errors, units, checked parts, files, and work in processes."""
