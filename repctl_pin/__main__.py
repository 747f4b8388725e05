"""``python -m repctl_pin`` is the command ``repctl``."""

import sys

from .cli import main

sys.exit(main())
