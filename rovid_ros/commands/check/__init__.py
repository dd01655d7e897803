"""``rovid check``: what is wrong with a configuration."""
