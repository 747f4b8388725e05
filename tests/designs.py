"""Designs with another region or other potentials: their parts are changed together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import repctl_pin as rp
from repctl_pin.design.evaluation import evaluate_design
from repctl_pin.paths import Cycle as Cycle  # of a design that a test saves


def over(design: rp.Design, region: Any, **changes: Any) -> rp.Design:
    """The same potentials over another region."""
    potentials = design.inverse.potentials
    inverse = rp.RepeatableInverse(design.task, potentials, region=region)
    return replace(design, region=region, inverse=inverse, **changes)


def with_potentials(design: rp.Design, potentials: Any, A: np.ndarray, **changes: Any) -> rp.Design:
    """Other potentials over the same region."""
    inverse = rp.RepeatableInverse(design.task, potentials.weighted(A), region=design.region)
    parts = {"inverse": inverse, "potentials": potentials, "coefficients": A}
    return replace(design, **parts, **changes)


def judged(design: rp.Design) -> Any:
    """Evaluate a design once more, on its held-out nodes."""
    return evaluate_design(
        design.inverse, design.desired, design.region, samples=design.held_out, seed=design.seed + 1
    )
