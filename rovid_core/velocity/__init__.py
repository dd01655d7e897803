"""Body velocity from position, depth, attitude, a DVL or a gyro."""
