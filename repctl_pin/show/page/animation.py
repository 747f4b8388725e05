"""Animation of motions: save it, open it in the browser, or show it in a notebook.

J⁺ is the pseudoinverse, the usual controller of a study.
"""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np

from ...base.arguments import Array, file_name, positive, require_type
from ...base.errors import InputError
from ...base.files import prepare_folder, write_whole
from ...motion import Motion
from ...paths.several_paths import paths_of
from ...studies.quantities import KEYS
from ...studies.study_result import Study
from ..notebook import frame, table_and_figures
from ..palette import BLUE, COLOURS, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from ..study_files import study_page
from .playback import TracedChain, playback_of, playback_page, traced_chains

_WARM, _COOL = (VERMILLION, ORANGE, PURPLE), (BLUE, GREEN, SKY)
_BACK = 0.01
"""Drift, as a share of the largest one, up to which a motion counts as closed; 1e-6 always does."""


@dataclass(frozen=True)
class Animation:
    """A page that shows motions side by side. Create it with :func:`animation`.

    A notebook cell shows the page and, for a study, the table and the figures below it.

    Attributes
    ----------
    page : str
        The page's HTML: self-contained, with no network access.
    study : Study or None
        The study whose motions the page shows; None for other motions.

    Examples
    --------
    >>> page = rp.animation({"ours": motion})
    >>> "<html" in page.page
    True
    """

    page: str
    study: Study | None = None

    def save(self, file: str | Path) -> Path:
        """Write the page to a file atomically, and return the path of the file.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        file = file_name(file)
        prepare_folder(file.parent)
        return write_whole(file, self.page)

    def show(self) -> Path:
        """Write the page to a file in a new temporary folder, and open it in the browser.

        Return the path of the file.
        """
        file = self.save(Path(tempfile.mkdtemp(prefix="repctl-")) / "animation.html")
        webbrowser.open(file.as_uri())
        return file

    def _repr_html_(self) -> str:
        page = frame(self.page)
        return page if self.study is None else f"{page}\n{table_and_figures(self.study)}"

    def __repr__(self) -> str:
        return f"Animation(a page of {len(self.page) / 1e6:.1f} MB)"


def animation(motions: Mapping[str, Motion] | Study, *, seconds: float | None = None) -> Animation:
    """Make a page that shows motions of one robot side by side, with their paths and traces.

    The page also has the drift after each cycle. Nothing is shown until :meth:`Animation.show` is
    called, or a notebook cell ends with the result.

    Motions named as in a study, such as J⁺, have the colours of a study. Other motions have a warm
    colour if they drift, and a cool colour if they are closed.

    Parameters
    ----------
    motions
        The motions by name, all with the same number of cycles and of steps; or a study.
    seconds
        Duration of a cycle at normal speed, s; by default the period of the first motion.

    Returns
    -------
    Animation
        The page, to save, to show or to see in a notebook's cell.

    Raises
    ------
    InputError
        If there is no motion, or the motions differ in robot, number of cycles or number of steps.

    Examples
    --------
    >>> page = rp.animation({"ours": motion})
    >>> page.save("ours.html").name
    'ours.html'
    """
    seconds = None if seconds is None else positive(seconds, "seconds", "s")
    if isinstance(motions, Study):
        return Animation(study_page(motions, seconds=seconds), motions)
    named = "motions by name, as in {'mine': motion}, or a study"
    require_type(motions, Mapping, "motions", named)
    if not motions:
        raise InputError("an animation requires motions, but motions is empty; give at least one")
    for name, motion in motions.items():
        require_type(
            motion, Motion, f"motions[{name!r}]", "a motion, such as rp.follow(control, path, q0)"
        )
    every = list(motions.values())
    robot = every[0].task.robot
    other = next(
        (m.task.robot for m in every if m.task.robot.joint_names != robot.joint_names), None
    )
    if other is not None:
        raise InputError(
            f"an animation shows one robot, but the motions are of {robot.name} and {other.name}; "
            "make one animation per robot"
        )
    colours = _colours({name: motion.drift[-1] for name, motion in motions.items()})
    tracks = [
        playback_of(name, motion, colour)
        for (name, motion), colour in zip(motions.items(), colours, strict=True)
    ]
    chains: dict[str, TracedChain] = {}
    paths: list[Array] = []
    for motion in every:
        for chain in traced_chains(motion.task, motion.q[0]):
            chains.setdefault(chain.task.frame, chain)
        for path in paths_of(motion.path):
            points = path.points()
            if not any(np.array_equal(points, known) for known in paths):
                paths.append(points)
    name = " and ".join(dict.fromkeys(motion.path.name for motion in every))
    return Animation(
        playback_page(list(chains.values()), tracks, paths=paths, name=name, seconds=seconds)
    )


def _colours(drifts: Mapping[str, float]) -> list[str]:
    """Choose a colour ``#rrggbb`` for each motion, in the order of ``drifts``.

    ``drifts`` maps the name of each motion to its final drift. A name that is the label of a
    controller of a study, such as J⁺, has that controller's colour. Other motions have a warm
    colour if they drift, and a cool one if they are closed.
    """
    limit = max(_BACK * max(drifts.values()), 1e-6)
    known = {name: COLOURS[KEYS[name]] for name in drifts if name in KEYS}
    warm, cool = (
        cycle([c for c in colours if c not in known.values()] or colours)
        for colours in (_WARM, _COOL)
    )
    return [
        known.get(name) or next(cool if drift <= limit else warm) for name, drift in drifts.items()
    ]
