"""Catalogue of known robots, and reading and validation of URDF files."""
