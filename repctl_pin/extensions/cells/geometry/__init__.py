"""Cells and sectors as sets of poses: their coordinates, and the symmetries that shorten them."""
