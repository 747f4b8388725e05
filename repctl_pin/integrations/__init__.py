"""Integrations with other packages: JAX, LeRobot, pink, and ROS 2 with MoveIt."""
