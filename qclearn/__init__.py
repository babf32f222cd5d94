"""Quasi-conformal registration of cortical surfaces: exact geometry first, networks second."""
