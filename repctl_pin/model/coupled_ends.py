"""Other end effectors that the joints of a task move, too.

On a robot with two arms on one waist, the task of one arm also moves the other arm; a study reports
that displacement.
"""

from __future__ import annotations

from .arm_links import arm_links, moves
from .end_effectors import arm_ends, is_sensor, task_links
from .task import Task


def other_ends(task: Task) -> tuple[str, ...]:
    """List the end effectors that the task's joints move, but that are not on the task's own arm.

    Return one link per end, the one with the best name for an end effector, in the order of the
    file. Sensors are left out.
    """
    own = arm_links(task)
    ends = [task_links(body)[0] for body in arm_ends(task.robot.description)]
    return tuple(end for end in ends if end not in own and not is_sensor(end) and moves(task, end))
