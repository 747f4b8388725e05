"""Repeatable control for redundant robot arms.

Load any URDF, measure how far the arm drifts on a closed path, and design a controller that does
not drift. ``__init__.pyi`` lists the public names. A name's module is imported when the name is
first used.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
