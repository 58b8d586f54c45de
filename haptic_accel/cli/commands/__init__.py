"""The verbs of ``haptic-accel``: a file each, read when its verb is asked for."""
