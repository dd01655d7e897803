"""Whole trials: offline methods and the score."""
