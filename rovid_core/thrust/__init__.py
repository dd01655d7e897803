"""The force on the body over time, from thruster commands."""
