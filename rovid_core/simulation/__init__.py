"""A simulated vehicle with thrusters and sensors."""
