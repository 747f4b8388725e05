"""Recorded joint positions and poses: one configuration per pose, and audits of drift.

An audit measures from a log whether an arm is in the same configuration whenever its hand, the end
effector, is back at a pose. Relabelling replaces recorded joints by those of a function q = F(x),
which gives one configuration per pose. So the recording from which a policy learns never has
different joints at one pose.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"audit": "audit_command", "relabel": "relabel_command"})
