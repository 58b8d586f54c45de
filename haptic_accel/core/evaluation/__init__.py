"""Metrics of a trial: error, regression, delay, bands, statistics."""
