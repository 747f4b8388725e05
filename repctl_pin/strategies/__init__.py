"""Control strategies on a task: joint velocities q̇ for a task velocity ẋ.

A study does not use ``custom``, ``extended`` and ``limit_weight``, so they are not imported here.
"""

from .pseudoinverse import PostureControl as PostureControl
from .pseudoinverse import Pseudoinverse as Pseudoinverse
from .pseudoinverse import WeightedInverse as WeightedInverse
from .repeatable import Bounded as Bounded
from .repeatable import RepeatableInverse as RepeatableInverse
from .strategy import Inverse as Inverse
from .strategy import Strategy as Strategy
