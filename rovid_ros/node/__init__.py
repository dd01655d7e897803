"""The live node; the only modules that import rclpy."""
