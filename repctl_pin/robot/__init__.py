"""Robots, tasks and collision bodies from a URDF, with kinematics by Pinocchio."""
