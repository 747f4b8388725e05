"""Control strategies on a task: ways to turn a task velocity ẋ into joint velocities q̇."""

from .posture import PostureControl
from .pseudoinverse import Pseudoinverse, WeightedInverse
from .repeatable import RepeatableInverse
from .strategy import Inverse, Strategy

__all__ = ["Inverse", "PostureControl", "Pseudoinverse", "RepeatableInverse", "Strategy", "WeightedInverse"]
