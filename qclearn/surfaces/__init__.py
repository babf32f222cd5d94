"""Surfaces in space: checked once, cut open, measured, mapped conformally to the disk."""
