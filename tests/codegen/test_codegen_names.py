"""Names of exported code beside those of real headers: each one is refused, or compiles."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from test_codegen_builds import needed

import repctl_pin as rp

C = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal
stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib string tgmath threads time
uchar wchar wctype aio arpa/inet cpio dirent dlfcn fcntl fmtmsg fnmatch ftw getopt glob grp
iconv langinfo libgen malloc monetary mqueue net/if netdb netinet/in netinet/tcp nl_types
poll pthread pwd regex sched search semaphore spawn strings sys/ipc sys/mman sys/msg
sys/resource sys/select sys/sem sys/shm sys/socket sys/stat sys/statvfs sys/time sys/times
sys/types sys/uio sys/un sys/utsname sys/wait syslog tar termios ulimit unistd utime utmpx
wordexp"""
CPP = """algorithm any array atomic bitset charconv chrono cmath complex cstddef cstdint cstdio
cstdlib cstring deque exception filesystem fstream functional future iomanip iostream
iterator limits list locale map memory mutex new numeric optional queue random ratio regex
set shared_mutex sstream stack stdexcept string string_view system_error thread tuple
type_traits unordered_map utility valarray variant vector"""
HEADERS = [*(f"{name}.h" for name in C.split()), *CPP.split()]
INCLUDED = "".join(f"#if __has_include(<{name}>)\n#include <{name}>\n#endif\n" for name in HEADERS)
NAME = re.compile("[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")


def refused(name: str, folder: Path) -> bool:
    """Whether the name is refused; nothing is written, because there is nothing to export."""
    with pytest.raises(rp.InputError) as error:
        rp.export_c(None, folder, name)
    return "a repeatable inverse" not in str(error.value)


@pytest.fixture
def planar() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return rp.RepeatableInverse(
        task, rp.Polynomial([0.3, 0.8, 0.8], 1, 1.0).weighted(np.ones((3, 1)))
    )


@pytest.mark.parametrize("name", ["sin", "index", "y1", "gamma", "Unistd", "co_await"])
def test_a_name_of_c_is_refused_with_one_that_is_not(name: str, tmp_path: Path) -> None:
    """Issue 37, item 9: the C++ header of such a name did not compile."""
    with pytest.raises(rp.InputError, match="reserved in C") as error:
        rp.export_c(None, tmp_path, name)
    assert not refused(str(error.value).split("'")[-2], tmp_path)
    assert refused("UR5", tmp_path) and not refused("ur5", tmp_path)


def compiled(code: str, folder: Path, *flags: str) -> str:
    """Give code to the C++ compiler; what it writes, errors included."""
    command = ["g++", "-std=gnu++17", "-w", "-xc++", "-I.", *flags, "-"]
    done = subprocess.run(
        command, cwd=folder, input=code, text=True, capture_output=True, check=False
    )
    return done.stdout + done.stderr


@pytest.mark.slow
def test_every_name_of_real_headers_is_refused_or_compiles(
    planar: rp.RepeatableInverse, tmp_path: Path
) -> None:
    """Issue 37, item 9: every identifier that the headers of C, POSIX and C++ contain becomes a
    name; so does what is left of one that ends like an identifier of the export."""
    needed("g++")
    text = compiled(INCLUDED, tmp_path, "-E") + compiled(INCLUDED, tmp_path, "-dM", "-E")
    found = set(re.findall(r"[A-Za-z]\w*", text))
    assert {"sin", "index", "y1", "gamma", "mkdir", "F_OK", "PRIu64"} <= found
    rp.export_c(planar, tmp_path, "zz")
    header = (tmp_path / "zz.h").read_text() + (tmp_path / "zz.hpp").read_text()
    ends = set(re.findall(r"\b(?:zz|ZZ)(_\w+)", header))
    outside = compiled(INCLUDED, tmp_path, "-E", "-dM") + (
        compiled("".join(f"#include <{x}.h>\n" for x in ("math", "unistd")), tmp_path, "-E")
    )
    begun = {
        name.removesuffix(end).lower()
        for name in re.findall(r"[A-Za-z]\w*", outside)
        for end in ends
        if name.endswith(end)
    }
    names = sorted(n for n in found | begun if NAME.fullmatch(n) and len(n) <= 40)
    taken = [name for name in names if not refused(name, tmp_path)]
    assert len(taken) > 1000 and not set(taken) & {"f", "r", "w", "x"}
    space = "".join(f"namespace {n} {{ inline constexpr int joints = 1; }}\n" for n in taken)
    assert "error" not in compiled(INCLUDED + space, tmp_path, "-fsyntax-only")
    use = '#include "zz.hpp"\nint main() { return (int)zz::joints - 3; }\n'
    assert "error" not in compiled(INCLUDED + use, tmp_path, "-fsyntax-only")
