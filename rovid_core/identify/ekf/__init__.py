"""The extended Kalman filter on one degree of freedom."""
