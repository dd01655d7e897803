"""The command line of ``rovid``."""
