"""Control loops: the governor, the torque law, and export to C.

A control loop asks for one command per tick of a few milliseconds. The governor stays within the
limits at every tick, whatever targets arrive. The torque law is for robots that are commanded by
torques.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"export": "export_command"})
