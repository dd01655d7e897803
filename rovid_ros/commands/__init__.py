"""The command ``rovid``."""
