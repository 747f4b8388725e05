"""What a page shows against what a run gives: text to the last character, but for rounding errors,
and pictures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from PIL import Image

FIGURES = Path(__file__).parent.parent / "docs" / "paper" / "figures"


def steady(text: str) -> list[str]:
    """Take the lines of a text without what differs from machine to machine.

    Of a number below 1e-9 only its smallness is promised, so it becomes ``tiny``; and a table's
    columns are as wide as such numbers happen to be."""
    lines = (
        re.sub(r"\d(\.\d+)?e-(\d\d+)", lambda m: "tiny" if int(m[2]) >= 10 else m[0], text)
        .strip()
        .splitlines()
    )
    return [re.sub(r" +", " ", line).rstrip() for line in lines]


def written(text: str) -> set[str]:
    """The files that a command says it wrote; a study names those beside its page by name."""
    files = set(re.findall(r"^wrote (\S+)$", text, flags=re.MULTILINE))
    page = re.search(r"^open   (\S+)$", text, flags=re.MULTILINE)
    beside = re.search(r"^wrote  (.*) beside it$", text, flags=re.MULTILINE)
    if page is None or beside is None:
        return files
    names = beside[1].split(", ")
    return files | {page[1]} | {str(Path(page[1]).with_name(name)) for name in names}


def answered(text: str, quantity: str) -> list[str]:
    """A row of a study's short table: usual control, with posture, repeatable."""
    (row,) = re.findall(rf"^{quantity}.*?  +(.*)", text, flags=re.MULTILINE)
    return re.split(r"  +", row.strip())


def drifts(table: str, strategy: str) -> tuple[float, float]:
    """After the first cycle and after the last, from the table a study prints: J⁺ first, nearest
    repeatable last."""
    column = {"J⁺": 0, "nearest repeatable": -1}[strategy]
    rows = re.findall(r"^drift after .*?  +(.*)", table, flags=re.MULTILINE)
    first, last = (float(row.split()[column]) for row in rows)
    return first, last


def small(file: Path) -> Image.Image:
    """Make a figure small enough for a page: at most 1200 pixels wide, 256 colours."""
    picture = Image.open(file).convert("RGB")
    width = min(1200, picture.width)
    size = (width, round(width * picture.height / picture.width))
    return picture.resize(size, Image.Resampling.LANCZOS).quantize(256, dither=Image.Dither.NONE)


def likeness(file: Path, kept: Path) -> float:
    """Correlate a figure just made with the one that is kept, as seen from afar: 1 is the same.

    150 pixels wide, letters and hair lines no longer count, which every version of matplotlib draws
    a little elsewhere (0.97 and more between 3.8 and 3.11); another figure of the same layout has
    0.73."""
    there = Image.open(kept).convert("RGB")
    size = (150, round(150 * there.height / there.width))
    made = Image.open(file).convert("RGB")
    far = [
        np.asarray(image.resize(size, Image.Resampling.BOX), float).ravel()
        for image in (made, there)
    ]
    return float(np.corrcoef(far)[0, 1])


# python tests/shown.py repctl-out/figure_06.png …: keep these figures from now on
if __name__ == "__main__":
    for name in sys.argv[1:]:
        small(Path(name)).save(FIGURES / Path(name).name, optimize=True)
