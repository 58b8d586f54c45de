"""Acceleration control: filters, compensation, controllers and their design."""
