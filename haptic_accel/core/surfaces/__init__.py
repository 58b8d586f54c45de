"""Virtual surfaces: textures, taps, shapes, contact, and the tool that touches them."""
