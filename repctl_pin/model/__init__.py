"""Robot models: a URDF checked and read, its kinematics by Pinocchio, tasks and bodies."""
