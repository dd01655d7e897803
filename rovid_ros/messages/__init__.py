"""Messages of any type, to samples in body FLU / world ENU and SI units, and back."""
