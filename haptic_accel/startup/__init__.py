"""How the graph starts: its executables, parameters and topics, and what supervises them."""
