"""Messages of any type, by field path, to samples."""
