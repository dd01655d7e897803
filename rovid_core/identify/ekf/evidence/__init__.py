"""What the innovations and scores of a filter say of it, of its model and of the vehicle."""
