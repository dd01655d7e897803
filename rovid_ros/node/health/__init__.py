"""What the node says of itself: /diagnostics and the console."""
