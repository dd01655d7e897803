"""The filter of surge and sway together, in water that moves."""
