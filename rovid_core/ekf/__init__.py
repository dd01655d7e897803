"""The extended Kalman filter on one degree of freedom, and what it is made of."""
