"""Virtual surfaces: textures, taps, shapes, and the tool that touches them."""
