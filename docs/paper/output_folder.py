"""Command line of a script on the paper: the folder of its figures."""

from __future__ import annotations

import argparse
from pathlib import Path


def output_folder(description: str, default: str = "repctl-out") -> Path:
    """Read ``--out``; the first paragraph of the script's docstring stands in ``--help``."""
    parser = argparse.ArgumentParser(description=description.partition("\n\n")[0])
    text = "folder of the figures (default: %(default)s)"
    parser.add_argument("--out", type=Path, default=Path(default), help=text)
    return parser.parse_args().out
