"""The straight line: ordered samples in, steps of each degree of freedom, estimates out."""
