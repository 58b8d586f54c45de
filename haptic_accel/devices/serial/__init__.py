"""An accelerometer, and at the master a voice coil, behind a microcontroller on USB serial."""
