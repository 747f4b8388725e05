"""The examples on stable surfaces and on the Panda, run at reduced resolution: what they say is what is true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from loading import example


def test_stable_surfaces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cases = example("stable_surfaces").main(tmp_path, samples=64)
    has = {(case.name, case.coordinates): len(case.found.stable) > 0 for case in cases}
    assert has == {
        ("slide and two links", "absolute"): True,
        ("slide and two links", "relative"): False,
        ("three unit links", "relative"): False,
        ("three unit links", "absolute"): True,
        ("links 1, 1, 1, 1", "absolute"): True,
        ("links 1, 1, 2, 2", "absolute"): True,
        ("links 1, 1, 2, 2, 1", "absolute"): True,
        ("links 1, 1.3, 1.7", "absolute"): False,
        ("links 1, 1, 1.4, 1.8", "absolute"): False,
        ("links 1, 1, 1.5, 2, 2", "absolute"): False,
    }
    assert all(len(case.found.points) for case in cases)
    text = capsys.readouterr().out
    assert text.count("stable surfaces") == 5 and text.count("none is stable") == 5
    assert (tmp_path / "stable_surfaces.png").stat().st_size > 20_000


def test_nearest_panda(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = example("nearest_panda").main(tmp_path, degrees=(1, 2), steps=80, count=7)
    plain, repeatable = found.verdicts
    assert not plain and repeatable and plain.defect > 1
    off = np.abs(found.measured / found.predicted - 1)
    assert off[0] < 0.02 and (np.diff(off) > 0).all()  # the smaller the loop, the better the prediction
    assert found.repeatable.max() < 1e-8 < 1e-4 < found.measured.min()
    assert found.defect.min() > 1 and found.defect_repeatable.max() < 1e-12
    assert found.designs[2].cost < found.designs[1].cost < 0.6
    text = capsys.readouterr().out
    assert "6.986 rad/m²" in text and "not repeatable" in text
    assert (tmp_path / "nearest_panda.png").stat().st_size > 20_000
