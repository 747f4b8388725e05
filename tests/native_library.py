"""The native library: tests that call its kernels are left out where it was not built."""

import pytest

from repctl_pin.native import library

REQUIRED = pytest.mark.skipif(library() is None, reason="there is no native library")
