"""Every method on every log, each model scored on every log."""
