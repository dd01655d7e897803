"""
Identification of an underwater vehicle's plant from timed samples.

Only numpy and the standard library: no ROS, no file formats, no clock.
"""

COMPILED = not __file__.endswith(('.py', '.pyc'))
"""Whether mypyc has compiled it (``ROVID_COMPILE=1 pip install .``): the same bits, sooner."""
