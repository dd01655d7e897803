"""The thrust to drive next, by the Cramer-Rao bound, within limits."""
