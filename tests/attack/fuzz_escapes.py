"""Terminal escapes in every text of every file that is read, all inside a private folder.

Each text of a saved design of either kind, a URDF, an SRDF, a motion and a list of waypoints is
replaced by, and extended with, sequences that would clear a screen, set a title, ring or forge a
line, with and without a checksum that fits. Whatever command reads the file: nothing that it prints
controls a terminal or stands on a line of its own.

    python tests/attack/fuzz_escapes.py [--seed 0] [--count 2000]
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_files import entries

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1]))
from commands import main as cli
from design_file import checksum

PAYLOADS = (
    "\x1b[2J\x1b[H",
    "\x1b]0;title\x07",
    "\x07",
    "\x9b2J",
    "a\rb",
    "a\tb",
    "a\nFORGED\n",
    "\u202eabc",
    "\u2028FORGED",
    "\x7f\x08\x08",
    "\x1bPq\x1b\\",
    "\x00",
)
Case = tuple[str, str, str, list[list[str]]]
"""What is changed, the file's name and content, and the commands that read it."""


def json_cases(name: str, good: dict[str, Any], commands: list[list[str]]) -> Iterator[Case]:
    """Every text, key and number of a saved design."""
    for place in entries(good):
        holder: Any = good
        for key in place:
            holder = holder[key]
        if isinstance(holder, (dict, list)):
            continue
        text = isinstance(holder, str)
        for payload in PAYLOADS if text else PAYLOADS[:1]:
            for value in (payload, f"{holder}{payload}") if text else (payload,):
                for fits in (True, False):
                    content = copy.deepcopy(good)
                    part: Any = content
                    for key in place[:-1]:
                        part = part[key]
                    part[place[-1]] = value
                    if fits and place[0] != "checksum":
                        content["checksum"] = checksum(content)
                    yield (
                        f"{name} {'/'.join(map(str, place))} + {payload!r}",
                        name,
                        json.dumps(content),
                        commands,
                    )
            content = copy.deepcopy(good)
            part = content
            for key in place[:-1]:
                part = part[key]
            if isinstance(part, dict) and text:
                part[payload] = part.pop(place[-1])
                yield (f"{name} key {place} = {payload!r}", name, json.dumps(content), commands)


def text_cases(
    name: str, good: str, pattern: str, commands: list[list[str]], *, xml: bool
) -> Iterator[Case]:
    """Every match of a pattern's group 1: the words of a text file."""
    for found in re.finditer(pattern, good):
        for payload in PAYLOADS:
            written = (
                "".join(f"&#{ord(c)};" if ord(c) < 0x20 else c for c in payload) if xml else payload
            )
            for value in {written, found[1] + written, payload}:
                content = good[: found.start(1)] + value + good[found.end(1) :]
                yield f"{name} {found[1][:30]!r} + {payload!r}", name, content, commands


def cases(folder: Path) -> list[Case]:
    """Make the files, and all their changes."""
    robot = "examples/my_arm.urdf"
    urdf = (Path(__file__).parents[2] / robot).read_text(encoding="utf-8")
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    small = ["--cycles", "1", "--steps", "40", "--region", "0.3", "--quiet"]
    assert cli(["study", "arm.urdf", *small, "--out", "made"]) == 0
    task = rp.Robot.load("planar4r").task(kind="xy")
    cell = rp.Cell(task, task.placement(task.reference), 0.05)
    rp.save(
        rp.nearest_inverse_function(
            rp.Pseudoinverse(task), cell, degree=1, options=rp.FitOptions(samples=256, held_out=64)
        ),
        "cell.json",
    )
    control = json.loads((folder / "made" / "control.json").read_text())
    motion = "\n".join((folder / "made" / "motion.csv").read_text().splitlines()[:3]) + "\n"
    room = (
        '<robot name="room"><link name="post"><collision><origin xyz="5 5 0"/><geometry><sphere '
        'radius="0.1"/>'
        "</geometry></collision></link></robot>"
    )
    square = "x,y,z\n0.3,0,0.4\n0.3,0.1,0.4\n0.4,0.1,0.4\n0.3,0,0.4\n"
    follow = [
        "follow",
        "arm.urdf",
        "--strategy",
        "pseudoinverse",
        "--steps",
        "40",
        "--allow-violations",
    ]
    attributes = r'\b[a-z_]+="([^"]*)"'
    read = [["follow", "control.json", "--robot", "arm.urdf"], ["check", "control.json"]]
    shown = [["animate", "arm.urdf", "--motion", "m.csv"]]
    return [
        *json_cases("control.json", control, read),
        *json_cases(
            "cell.json",
            json.loads(Path("cell.json").read_text()),
            [["export", "cell.json", "--out", "c"]],
        ),
        *text_cases(
            "b.urdf",
            urdf,
            attributes,
            [["inspect", "b.urdf"], ["inspect", "b.urdf", "--json"]],
            xml=True,
        ),
        *text_cases("b.urdf", urdf, r"<([a-z]+)", [["inspect", "b.urdf"]], xml=False),
        *text_cases(
            "room.urdf", room, attributes, [[*follow, "--surroundings", "room.urdf"]], xml=True
        ),
        *text_cases("m.csv", motion, r"(?m)(?:^|,)([^,\n]+)", shown, xml=False),
        *text_cases("p.csv", square, r"([^,\n]+)", [[*follow, "--path", "p.csv"]], xml=False),
    ]


def prints(command: list[str]) -> tuple[int, str]:
    """Run a command here: its exit code, and all that it printed."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            code = cli(command)
        except SystemExit as error:
            code = int(error.code or 0)
    return code, out.getvalue()


def main() -> int:
    """Run a sample, print what reached the terminal and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=2000)
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as private:
        os.chdir(private)
        every = cases(Path(private))
        groups = [
            [case for case in every if case[1] == name]
            for name in dict.fromkeys(case[1] for case in every)
        ]
        rng = np.random.default_rng(options.seed)
        drawn = [
            group[i]
            for group in groups
            for i in rng.permutation(len(group))[: options.count // len(groups)]
        ]
        for what, name, content, commands in drawn:
            Path(name).write_text(content, encoding="utf-8", errors="surrogatepass", newline="")
            for command in commands:
                code, text = prints(command)
                wrong = [c for c in text if not c.isprintable() and c != "\n"]
                forged = any(line.startswith("FORGED") for line in text.splitlines())
                fault = code not in (0, 2) or (code == 2 and text.count("\n") != 1)
                counts["escaped" if wrong or forged else "fault" if fault else f"exit {code}"] += 1
                if wrong or forged or fault:
                    print(f"{what}, {command[0]}: {code} {text[-300:]!r}", flush=True)
        os.chdir("/")
    print(dict(counts), "from", len(drawn), "of", len(every), "files")
    return int(bool(counts["escaped"] or counts["fault"]))


if __name__ == "__main__":
    sys.exit(main())
