"""The next thrust profile to drive."""
