"""Progress reports of long computations: a bar on stderr, or a callback."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .errors import InputError, needed

Report = Callable[[str, float], None]
"""Progress callback (step, fraction): the current step, and the completed fraction, 0 to 1."""


def silent(what: str, share: float) -> None:
    """Do nothing: the progress callback for computations that report no progress.

    ``what`` names the current step, and ``share`` is the completed fraction, 0 to 1.
    """


@contextmanager
def reporter(progress: bool | Report) -> Iterator[Report]:
    """Context manager that provides a progress callback (step: str, fraction: float from 0 to 1).

    ``progress`` is False for a callback that does nothing, True for a bar on stderr, or the user's
    callback. The bar requires tqdm, and is removed at the end.
    """
    if not callable(progress) and not isinstance(progress, bool):
        raise InputError(
            "must be True, False or a callback (step, fraction), "
            f"not of type {type(progress).__name__}",
            argument="progress",
        )
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
