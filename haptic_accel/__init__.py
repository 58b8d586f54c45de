"""Teleoperation with high-frequency acceleration feedback."""
