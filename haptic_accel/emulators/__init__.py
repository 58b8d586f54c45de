"""Emulated boards and drives behind pseudo-terminals, with fault injection."""
