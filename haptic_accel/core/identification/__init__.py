"""Identification of the handle: excite it, estimate its response, fit models to that."""
