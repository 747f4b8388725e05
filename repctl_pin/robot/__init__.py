"""URDF to kinematics. The only room where Pinocchio computes."""
