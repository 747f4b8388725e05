"""The pictures of the README: made by their script, small, and of what they should show."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browser import require_browser
from PIL import Image

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "examples" / "pictures"


@pytest.mark.slow
def test_the_script_makes_a_picture(tmp_path: Path) -> None:
    require_browser()
    command = [sys.executable, str(ROOT / "docs" / "pictures.py"), "ppr", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"wrote .*ppr\.png \(\d+ kB\)\n", done.stdout)
    images = [Image.open(folder / "ppr.png").convert("RGB") for folder in (tmp_path, PICTURES)]
    # the script shrinks a picture until its file is small enough, which may end at two sizes
    size = (490, 422)
    assert all(abs(image.width / image.height - size[0] / size[1]) < 0.01 for image in images)
    made, kept = (np.asarray(image.resize(size), float) for image in images)
    # another machine draws edges and letters a little differently, not another picture
    assert np.mean(np.abs(made - kept).max(axis=-1) > 60) < 0.03


def test_kept_pictures_are_small_and_show_both_arms() -> None:
    """Side by side, or one above the other."""
    files = sorted(PICTURES.glob("*.png"))
    assert "panda" in [file.stem for file in files]
    orange, blue = (0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)
    for file in files:
        assert file.stat().st_size <= 150_000, file.name
        if file.stem in ("live_viewer", "notebook"):  # whole windows
            continue
        image = np.asarray(Image.open(file).convert("RGB"), int)
        where = [np.argwhere(np.abs(image - colour).max(axis=-1) < 24) for colour in (orange, blue)]
        assert min(map(len, where)) > 0.0005 * image.shape[0] * image.shape[1], file.name
        apart = (where[1].mean(axis=0) - where[0].mean(axis=0)) / image.shape[:2]
        assert apart.max() > 0.2, file.name


def test_an_unknown_picture_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["pictures.py", "pandda"])
    with pytest.raises(SystemExit) as stopped:
        runpy.run_path(str(ROOT / "docs" / "pictures.py"), run_name="__main__")
    assert stopped.value.code == 2
    assert "no picture 'pandda'" in capsys.readouterr().err
