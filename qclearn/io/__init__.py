"""Surfaces and values in the formats of the field, fsaverage5, conte69, and where figures come from."""
