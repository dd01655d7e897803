"""The plant, the names of its parts, and the values that go down the pipeline."""
