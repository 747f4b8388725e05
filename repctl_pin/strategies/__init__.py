"""Control strategies on a task: ways to turn a task velocity ẋ into joint velocities q̇."""

from .arm_angle import ArmAngle
from .custom import CustomInverse
from .extended import ExtendedJacobian
from .function import FunctionStrategy
from .impedance import LeafImpedance
from .limits import LimitWeight
from .posture import PostureControl
from .pseudoinverse import Pseudoinverse, WeightedInverse
from .repeatable import RepeatableInverse
from .strategy import Inverse, OnLeaves, Strategy

__all__ = [
    "ArmAngle",
    "CustomInverse",
    "ExtendedJacobian",
    "FunctionStrategy",
    "Inverse",
    "LeafImpedance",
    "LimitWeight",
    "OnLeaves",
    "PostureControl",
    "Pseudoinverse",
    "RepeatableInverse",
    "Strategy",
    "WeightedInverse",
]
