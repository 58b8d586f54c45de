"""The simulated rig: its mechanics, its instruments and the hand that explores with it."""
