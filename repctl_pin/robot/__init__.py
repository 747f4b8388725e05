"""Kinematics from a URDF, by Pinocchio."""
