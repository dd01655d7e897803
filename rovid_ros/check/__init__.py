"""A configuration by itself, against a log, or against the live graph."""
