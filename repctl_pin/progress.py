"""Say how far a long run has come: a bar on stderr, or a function of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .errors import needed

Report = Callable[[str, float], None]
"""Takes what is being done, and what share of it is done (0 to 1)."""


def silent(what: str, share: float) -> None:
    """Report nothing."""


@contextmanager
def reporter(progress: bool | Report) -> Iterator[Report]:
    """Make a report function: silent, a bar, or the user's own."""
    if callable(progress) or not progress:
        yield progress if callable(progress) else silent
        return
    needed("tqdm", by="a progress bar")
    from tqdm import tqdm

    with tqdm(
        total=1.0, bar_format="{desc:32.32} {percentage:3.0f}%|{bar}| {elapsed}", leave=False
    ) as bar:

        def report(what: str, share: float) -> None:
            bar.set_description_str(what, refresh=False)
            bar.n = share
            bar.refresh()

        yield report
