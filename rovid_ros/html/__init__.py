"""The report of ``rovid compare``, one HTML file."""
