"""Hundreds of dives: where they are, a row for each and DOF, and what changes between them."""
