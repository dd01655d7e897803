"""Messages between the node and ROS: subscriptions, waiting, publishers, encoding."""
