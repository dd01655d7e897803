"""The filter of one degree of freedom."""
