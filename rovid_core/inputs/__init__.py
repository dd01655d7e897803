"""What is believed of an input: outliers, stuck values, wrong units and signs."""
