"""The table of the keys, and the YAML that sets them."""
