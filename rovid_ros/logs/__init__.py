"""Recorded logs of several formats, read and written."""
