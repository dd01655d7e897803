"""What a log says about its vehicle: which topic is what, and what follows from the data."""
