"""Better settings from a log, by cross-validation, all candidates side by side."""
