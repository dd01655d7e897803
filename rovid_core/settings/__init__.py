"""Everything that a run depends on, as frozen values."""
