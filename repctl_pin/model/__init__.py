"""Robot models: a URDF checked and read, its kinematics by Pinocchio, tasks and bodies.

A task is a frame with the coordinates to control and the joints that move it; bodies are the
collision shapes.
"""
