"""Surfaces and values in the field's formats, fsaverage5, conte69, and provenance."""
