"""Position-to-position coupling of the two arms."""
