"""Events in the order of their stamps, and what stamps say that cannot be right."""
