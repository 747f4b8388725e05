"""Closed paths of a frame: shapes, waypoints, polylines and orientations."""
