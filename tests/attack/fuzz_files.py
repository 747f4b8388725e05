"""Hostile design files, paths and surroundings of a process, all inside a private folder.

Every entry of a saved control is replaced by special values, with a checksum that fits: each file
is refused in one line, or loads, is saved again as it was, and then gives J G = I. Every command
gets every option that names a file with names and files that cannot serve, and runs where standard
streams, folders or environment variables are missing: it ends in a result or in one line, and every
device is still a device. Anything else, 20 s or 2 GB is a fault, and the exit code says so.

    python tests/attack/fuzz_files.py [--only json|names|places]
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import resource
import stat
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_urdf import fate

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1]))
from commands import main as cli
from design_file import checksum
from survey_urdfs import Outcome, load_libraries, run

SPECIALS: tuple[Any, ...] = (
    None,
    "",
    "x",
    "a\nb",
    "9" * 5000,
    -1,
    0,
    0.5,
    5e-324,
    1e308,
    1e-308,
    2**63,
    10**400,
    True,
    [],
    {},
    [[0.5]],
    [None],
)
DEVICES = {"null": os.makedev(1, 3), "zero": os.makedev(1, 5), "full": os.makedev(1, 7)}
STUDY = ["study", "planar3r", "--cycles", "1", "--steps", "40", "--region", "0.3"]
FOLLOW = ["follow", "ppr", "--strategy", "pseudoinverse", "--steps", "40", "--allow-violations"]
ONE_LINE = 6000


def entries(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The places of all entries of a file; of long lists the first alone."""
    if path:
        yield path
    if isinstance(value, dict):
        for key in value:
            yield from entries(value[key], (*path, key))
    if isinstance(value, list):
        for i in range(len(value) if len(value) < 8 else 1):
            yield from entries(value[i], (*path, i))


def changed_files(good: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Files with one entry that is special, and what it is."""
    for place in entries(good):
        if place[0] == "checksum":
            continue
        for special in SPECIALS:
            content = copy.deepcopy(good)
            holder: Any = content
            for key in place[:-1]:
                holder = holder[key]
            holder[place[-1]] = special
            content["checksum"] = checksum(content)
            yield f"{'/'.join(map(str, place))} = {str(special)[:20]!r}", content


def load_and_use(file: Path, again: Path) -> None:
    """Load a control, see that it is what the file says, and that it is an inverse."""
    design = rp.load(file)
    rp.save(design, again)
    said, kept = (json.loads(path.read_text()) for path in (file, again))
    said["task"]["file"] = kept["task"]["file"]  # of a catalogue's robot: for a person
    if isinstance(design, rp.CellDesign):  # null is what older files did not say
        kept["figures"] |= {name: None for name, value in said["figures"].items() if value is None}
    other = [
        part
        for part in said
        if part not in ("checksum", "written_by") and not alike(said[part], kept[part])
    ]
    if other:
        raise ArithmeticError(f"silently read as something else: {other}")
    task = design.task
    q = task.reference + 0.05
    if isinstance(design, rp.CellDesign):
        check_function(design)
        return
    try:
        away = task.jacobian(q) @ design.inverse(q) - np.eye(task.m)
    except rp.SingularityError:
        return
    if not np.abs(away).max() < 1e-6:
        raise ArithmeticError(f"J G is no identity: {np.abs(away).max():.3g}")


def check_function(design: rp.CellDesign) -> None:
    """See that the function of a cell reaches what it is asked for, or refuses."""
    F, task = design.function, design.task
    for u in np.vstack([np.zeros(F.cell.k), 0.4 * F.cell.corners()[:4]]):
        target = F.cell.at(u)
        try:
            q = F(target)
        except rp.RepctlError:
            continue
        if not np.abs(task.error(q, target)).max() < 1e-6:
            raise ArithmeticError(
                f"F misses its target by {np.abs(task.error(q, target)).max():.3g}"
            )


def alike(one: Any, other: Any) -> bool:
    """Whether two parts of files are the same, numbers but for rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(alike, one, other))
    numbers = (int, float)
    if isinstance(one, numbers) and isinstance(other, numbers):
        return one == other or abs(one - other) <= 1e-9 * max(1, abs(one))
    return bool(one == other)


def hostile_names(folder: Path) -> list[str]:
    """Make files and folders that cannot serve, and name them and others."""
    (folder / "folder").mkdir()
    for name, device in DEVICES.items():
        os.mknod(folder / name, 0o600 | stat.S_IFCHR, device)
        if name != "null":  # to write through; to read, all are refused
            for kind in ("urdf", "json", "csv"):
                (folder / f"{name}.{kind}").symlink_to(folder / name)
    for kind in ("urdf", "json", "csv"):
        os.mkfifo(folder / f"pipe.{kind}")
        (folder / f"loop.{kind}").symlink_to(folder / f"loop.{kind}")
        (folder / f"empty.{kind}").write_bytes(b"")
        (folder / f"latin.{kind}").write_bytes(b"<robot name='\xff'/>,\xfe")
        (folder / f"zeros.{kind}").write_bytes(bytes(1000))
        (folder / f"deep.{kind}").write_text("[" * 200_000)
        with (folder / f"huge.{kind}").open("wb") as file:
            file.truncate(3 << 30)  # a hole: no disk is used
    names = [
        "",
        ".",
        "/",
        "folder",
        "none/file",
        "~nosuchuser/x",
        "x" * 5000,
        "a\nb",
        os.fsdecode(b"\xff"),
        "-",
        "--",
        "null/file",
        "empty.csv/file",
        " ",
        "$(id)",
        "{}",
        "../" * 300,
        "/proc/nowhere/x",
    ]
    return names + sorted(p.name for p in folder.iterdir() if p.suffix)


def commands(name: str, out: bool) -> Iterator[list[str]]:
    """Commands that read (or write) a file of this name."""
    if out:
        yield [*FOLLOW, "--csv", name]
        yield [*FOLLOW, "--yaml", name]
        yield [*STUDY, "--out", name]
        yield ["design", "planar3r", "--region", "0.2", "--out", name]
        yield ["export", "control.json", "--out", name]
    else:
        for words in (["inspect"], ["study"], ["follow"], ["check"], ["export"]):
            yield [*words, name]
        yield [*FOLLOW, "--path", name]
        yield [*FOLLOW, "--surroundings", name]
        yield ["follow", "control.json", "--robot", name]
        yield ["animate", "ppr", "--motion", name]
        yield ["inspect", "panda", "--package-dir", name]


def judged(done: Outcome, folder: Path) -> str:
    """Say how a command ended."""
    for name, device in DEVICES.items():
        if not stat.S_ISCHR((state := (folder / name).stat()).st_mode) or state.st_rdev != device:
            return f"fault: the device {name} is none any more"
    if done.kind == "fault" or len(done.words) > ONE_LINE or done.lines > 1:
        return f"fault: {done.lines} lines: {done.words[:200]!r}"
    if done.gigabytes > 2 or done.seconds > 20:
        return f"fault: {done.seconds:.0f} s, {done.gigabytes:.1f} GB"
    return "refused" if done.kind == "sentence" else "read"


def places() -> Iterator[tuple[str, dict[str, str], str]]:
    """Surroundings of a process: a name, its environment, and lines of shell before it."""
    for variable, value in (
        ("HOME", ""),
        ("HOME", "/nowhere"),
        ("TMPDIR", "/nowhere"),
        ("MPLCONFIGDIR", "/dev/null"),
        ("LANG", "C"),
        ("LC_ALL", "xx_XX"),
        ("PYTHONIOENCODING", "ascii"),
        ("COLUMNS", "0"),
        ("COLUMNS", "-1"),
        ("COLUMNS", "x"),
        ("COLUMNS", "1"),
        ("COLUMNS", "9" * 20),
        ("TERM", ""),
        ("TERM", "dumb"),
        ("NO_COLOR", "1"),
        ("MPLBACKEND", "nonsense"),
        ("PYTHONUTF8", "0"),
        ("OMP_NUM_THREADS", "x"),
        ("OMP_NUM_THREADS", "0"),
        ("OPENBLAS_NUM_THREADS", "-1"),
        ("PYTHONWARNINGS", "error"),
        ("ROS_PACKAGE_PATH", "/nowhere:::"),
        ("PATH", ""),
        ("XDG_CACHE_HOME", "/dev/null"),
        ("PYTHONOPTIMIZE", "2"),
    ):
        yield f"{variable}={value}", {variable: value}, ""
    for lines in (
        "exec <&-",
        "exec >&-",
        "exec 2>&-",
        "exec <&- >&- 2>&-",
        "exec >full",
        "exec 2>full",
        "exec < zero",
        "ulimit -f 0",
        "ulimit -f 8",
        "ulimit -n 20",
        "mkdir g; cd g; rmdir ../g",
        "cd folder; chmod 0 .",
        "umask 777",
        "umask 0",
        "trap '' PIPE",
        "ulimit -v 3000000",
    ):
        yield lines, {}, lines


def in_place(command: list[str], folder: Path, environment: dict[str, str], lines: str) -> Outcome:
    """Run a command in a process of its own; where stderr is broken, a silent 2 is one line too."""
    program = f"{lines}\n" + 'exec "$0" -m repctl_pin "$@"'
    started = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        ["/bin/bash", "-c", program, sys.executable, *command],
        cwd=folder, env=os.environ | environment, capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = [line for line in done.stderr.decode(errors="replace").splitlines() if line]
    mute = "2>" in lines
    kind = "result" if done.returncode == 0 else "fault"
    if done.returncode == 2 and (mute or (said and said[-1].startswith("repctl: "))):
        kind = "sentence"
    shell = [line for line in said if line.startswith("/bin/bash")]
    words = said[-1] if said else f"ended with {done.returncode}"
    seconds = used.ru_utime + used.ru_stime - started.ru_utime - started.ru_stime
    return Outcome(kind, words, seconds, 0.0, len(said) - len(shell))


def main() -> int:
    """Run all, print the faults and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", choices=["json", "names", "places"])
    only = parser.parse_args().only
    counts: Counter[str] = Counter()

    def tell(part: str, name: str, how: str) -> None:
        counts[f"{part}: {how.partition(':')[0]}"] += 1
        if how.startswith("fault"):
            print(f"{part} {name[:150]}: {how}", flush=True)

    load_libraries()
    with tempfile.TemporaryDirectory() as private:
        folder = Path(private)
        os.chdir(folder)
        assert cli([*STUDY, "--out", "made", "--quiet"]) == 0
        (folder / "made" / "control.json").rename(folder / "control.json")
        if only in (None, "json"):
            task = rp.Robot.load("planar4r").task(kind="xy")
            cell = rp.Cell(task, task.placement(task.reference), 0.05)
            found = rp.nearest_inverse_function(
                rp.Pseudoinverse(task),
                cell,
                degree=1,
                options=rp.FitOptions(samples=64, held_out=64),
            )
            rp.save(found, "cell.json")
            for good in ("control.json", "cell.json"):
                for name, content in changed_files(json.loads(Path(good).read_text())):
                    Path("changed.json").write_text(json.dumps(content))
                    how = fate(lambda: load_and_use(Path("changed.json"), Path("again.json")))
                    tell("json", f"{good}: {name}", how)
        names = hostile_names(folder)
        cases: list[tuple[str, Callable[[], Outcome]]] = []
        if only in (None, "names"):
            # a pipe waits for its reader
            cases += [
                (f"names {' '.join(words)!r}", lambda words=words: run(words))
                for out in (False, True)
                for name in names
                for words in commands(name, out)
                if not (out and ("pipe" in name or "huge" in name))
            ]
        if only in (None, "places"):
            words = (["inspect", "ppr"], STUDY, [*FOLLOW, "--csv", "m.csv"])
            cases += [
                (
                    f"places {name!r} {one[0]}",
                    lambda c=one, e=env, s=lines: in_place(c, folder, e, s),
                )
                for name, env, lines in places()
                for one in words
            ]
        for name, case in cases:
            tell(name.partition(" ")[0], name, judged(case(), folder))
        os.chdir("/")
    print("; ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))
    return int(any(kind.endswith("fault") for kind in counts))


if __name__ == "__main__":
    sys.exit(main())
