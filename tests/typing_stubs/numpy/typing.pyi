from typing import Any

from numpy import dtype, ndarray
from typing_extensions import TypeVar

_Type = TypeVar("_Type", default=Any)
ArrayLike = Any
NDArray = ndarray[tuple[int, ...], dtype[_Type]]
