"""What saved files hold, key by key: checked once when they are read, so that readers can rely on it."""
