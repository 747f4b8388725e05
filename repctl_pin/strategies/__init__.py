"""Control strategies on a task: joint velocities q̇ for a task velocity ẋ."""

from ..potentials.arm_angle import ArmAngle as ArmAngle
from .custom import CustomInverse as CustomInverse
from .custom import FunctionStrategy as FunctionStrategy
from .extended import ExtendedJacobian as ExtendedJacobian
from .limit_weight import LimitWeight as LimitWeight
from .pseudoinverse import PostureControl as PostureControl
from .pseudoinverse import Pseudoinverse as Pseudoinverse
from .pseudoinverse import WeightedInverse as WeightedInverse
from .repeatable import Bounded as Bounded
from .repeatable import RepeatableInverse as RepeatableInverse
from .strategy import Inverse as Inverse
from .strategy import Strategy as Strategy
