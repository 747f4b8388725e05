"""Robot models: checked URDF files, kinematics by Pinocchio, tasks and collision bodies.

A task is a frame, its controlled coordinates, and the joints that move it.
"""
