"""Control strategies on a task: joint velocities q̇ for a task velocity ẋ.

n joints move a frame with m task coordinates; r = n − m is the redundancy. J (m, n) is the
Jacobian. A study does not use ``custom``, ``extended`` and ``limit_weight``, so they are not
imported here.
"""

from .posture import PostureControl as PostureControl
from .pseudoinverse import Pseudoinverse as Pseudoinverse
from .pseudoinverse import WeightedInverse as WeightedInverse
from .repeatable import Bounded as Bounded
from .repeatable import RepeatableInverse as RepeatableInverse
from .strategy import Inverse as Inverse
from .strategy import Strategy as Strategy
