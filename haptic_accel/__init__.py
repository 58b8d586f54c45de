"""Teleoperation with high-frequency acceleration feedback."""

__version__ = "0.2.0"
