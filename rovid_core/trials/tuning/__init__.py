"""Settings that a log is explained best by."""
