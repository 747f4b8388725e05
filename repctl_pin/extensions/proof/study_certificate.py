"""Certificate of a study's design; its proof gets a fraction of the study's processor time.

A certificate is a successful :class:`.Proof` that is stored in the design. The leaf margin is the
distance from an algorithmic singularity, at which the controller fails. A tube is the set of
configurations near a sampled motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ...base.errors import InputError
from ...design import Design
from ...native import library
from .boxes import cover, enclosing
from .certify import study_proof
from .potentials import features_of

_PROVED = 0.9
"""Leaf margin that a study tries to prove, as a fraction of the smallest one found by sampling."""

_PROVING, _LEAST_PROVING = 0.05, 0.2
"""Processor time for that proof: as a fraction of the time spent so far, and its minimum, s."""

_PATIENCE = 0.25
"""Share of that time after which the proof is given up if no part of Ω is proved yet."""

_CLOSING = 5.0
"""Minimum processor time for the closing radius along the path, s."""


def with_certificate(design: Design, spent: float, say: Callable[[str], None]) -> Design:
    """Add a certificate to a design; return it unchanged if the proof of its leaf margin fails.

    If Ω, the region of joint space of the design, is a tube, the certificate has a closing radius:
    the distance from the path within which closed paths end in their start configuration. ``spent``
    is the processor time of the study so far, s. The proof of the leaf margin may take 5 % of
    ``spent``, or 0.2 s if that is longer; it is given up after a quarter of this time if nothing is
    proved by then. The closing radius may take 5 % of ``spent``, or 5 s if that is longer.
    ``say(text)`` displays to the user what is being done.
    """
    say("proving its leaf margin and closing radius")
    seconds = max(_LEAST_PROVING, _PROVING * spent)
    margin = _PROVED * design.leaf_margin
    try:
        proof = study_proof(design, margin, seconds, max(_CLOSING, seconds), _PATIENCE)
    except InputError:  # bounds of these potentials, or the region's shape, are not known
        return design
    return replace(design, proof=proof) if proof else design


def unproved_note(design: Design) -> list[str]:
    """Write a note that a study's time did not suffice for a certificate, and how to get one.

    The list has this one note. The list is empty if the design has a certificate, if its potentials
    are of a kind about which nothing can be proved, or if there is no native library, the compiled
    C code of this package.
    """
    if design.proof is not None or library() is None:
        return []
    try:
        low, high = cover(design.region)
        box = enclosing(low, high)
        features_of(design.inverse.potentials, design.task.n, box)
    except InputError:  # such a proof does not exist
        return []
    return [
        "closed paths near this one: not proved within the time of a study; "
        "for more time, use repctl check control.json --prove"
    ]
