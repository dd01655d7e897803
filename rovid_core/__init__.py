"""
Identification of an underwater vehicle's plant from timed samples.

Only numpy and the standard library: no ROS, no file formats, no clock.
"""
