"""The command line `haptic-accel`."""
