"""Work that takes long: processes, progress, signals, locks, folders that are replaced whole."""
