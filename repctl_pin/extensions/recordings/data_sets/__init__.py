"""Data sets of robot learning, read as tables: LeRobot's folders, robomimic's HDF5 files."""
