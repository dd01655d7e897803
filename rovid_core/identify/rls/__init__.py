"""Recursive least squares on filtered regressors."""
