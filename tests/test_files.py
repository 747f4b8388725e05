"""Files: whole or not at all, never in place of a device or a pipe, never by a name that somebody
can foresee."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from repctl_pin import InputError
from repctl_pin.base.files import (
    check_folder,
    not_left_empty,
    prepare_folder,
    read_whole,
    write_whole,
    written_together,
)

ZERO, NULL, FULL = os.makedev(1, 5), os.makedev(1, 3), os.makedev(1, 7)


def device(path: Path, number: int) -> Path:
    """A device node of the test's own, in its own folder."""
    try:
        os.mknod(path, 0o600 | stat.S_IFCHR, number)
        with path.open("rb"):
            return path
    except OSError as error:
        pytest.skip(f"no device nodes here: {os.strerror(error.errno or errno.EPERM)}")


def test_a_device_is_written_through_and_stays_one(tmp_path: Path) -> None:
    node = device(tmp_path / "motion.csv", NULL)
    (tmp_path / "link").symlink_to(node)
    for name in ("motion.csv", "link"):
        assert write_whole(tmp_path / name, "text") == node
    assert stat.S_ISCHR(node.stat().st_mode) and sorted(p.name for p in tmp_path.iterdir()) == [
        "link",
        "motion.csv",
    ]
    full = device(tmp_path / "full", FULL)
    with pytest.raises(InputError, match="cannot write .*full: No space left"):
        write_whole(full, "text")
    assert stat.S_ISCHR(full.stat().st_mode)


def test_a_pipe_is_written_through(tmp_path: Path) -> None:
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_whole(pipe, "x" * 300_000)
    reader.join(20)
    assert got == [b"x" * 300_000] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_link_is_followed_and_stays(tmp_path: Path) -> None:
    for there in (True, False):  # what it leads to is there already, or not yet
        target = tmp_path / f"target{there}"
        if there:
            target.write_text("old")
            target.chmod(0o640)
        link = tmp_path / f"link{there}"
        link.symlink_to(target.name)
        assert (
            write_whole(link, "new") == target and link.is_symlink() and target.read_text() == "new"
        )
    assert stat.S_IMODE((tmp_path / "targetTrue").stat().st_mode) == 0o640  # as it was


def test_the_temporary_name_cannot_be_foreseen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, opened = [], os.open

    def watching(path, flags, *mode, **more) -> int:
        if flags & os.O_CREAT:
            assert flags & os.O_EXCL, "a planted link would be written through"
            seen.append(Path(path))
        return opened(path, flags, *mode, **more)

    monkeypatch.setattr(os, "open", watching)
    for _ in range(8):
        write_whole(tmp_path / "file", "text")
    assert len(set(seen)) == 8 and {p.parent for p in seen} == {tmp_path}


def test_eight_threads_save_to_one_name(tmp_path: Path) -> None:
    """Every save succeeds, and every read sees one of them whole."""
    file, texts = tmp_path / "file", [str(k) * 50_000 for k in range(8)]
    write_whole(file, texts[0])

    def save(text: str) -> None:
        for _ in range(15):
            write_whole(file, text)
            assert file.read_text() in texts

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(save, texts))
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("name", ["", ".", "folder", "/", "no\0name", "none/file"])
def test_what_is_no_name_of_a_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot write"):
        write_whole(name, "text")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


LIMITED = """
import resource, signal
from repctl_pin import InputError
from repctl_pin.base.files import write_whole
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_whole("file", "new" * 1000)
except InputError as error:
    print(error)
"""


def test_where_it_does_not_fit_the_old_file_stays(tmp_path: Path) -> None:
    pytest.importorskip("resource")
    (tmp_path / "file").write_text("old")
    done = subprocess.run(
        [sys.executable, "-c", LIMITED], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "cannot write file: File too large; choose another file\n", done.stderr
    assert (tmp_path / "file").read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_only_files_are_read_and_only_of_a_size_that_is_meant(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(b"x" * 1001)
    (tmp_path / "bytes").write_bytes(b"\xff\xfe")
    (tmp_path / "fits").write_bytes(b"\xef\xbb\xbf" + b"x" * 997)
    assert read_whole(tmp_path / "fits", 1000) == "x" * 997
    for name, words in {
        "pipe": "a device or a pipe",
        ".": "a folder",
        "large": "larger than 0.001 MB",
        "bytes": "not UTF-8 text",
        "none": "No such file",
    }.items():
        with pytest.raises(InputError, match=f"cannot read .*{words}"):
            read_whole(tmp_path / name, 1000)
    (tmp_path / "x.json").symlink_to(device(tmp_path / "zero", ZERO))
    with pytest.raises(InputError, match="a device or a pipe"):
        read_whole(tmp_path / "x.json", 1000)


def test_files_are_replaced_together_or_not_at_all(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    (tmp_path / "b").chmod(0o640)
    with pytest.raises(KeyboardInterrupt), written_together(tmp_path) as staged:
        write_whole(staged / "a", "new")
        raise KeyboardInterrupt
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"a": "old", "b": "old"}
    with written_together(tmp_path) as staged:
        for name in ("a", "b", "c"):
            write_whole(staged / name, "new")
        assert (tmp_path / "a").read_text() == "old"
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {
        "a": "new",
        "b": "new",
        "c": "new",
    }
    assert stat.S_IMODE((tmp_path / "b").stat().st_mode) == 0o640
    (tmp_path / "d").mkdir()
    with (
        pytest.raises(InputError, match="cannot write .*d: the path is a folder"),
        written_together(tmp_path) as staged,
    ):
        write_whole(staged / "a", "newer")
        write_whole(staged / "d", "newer")
    assert (tmp_path / "a").read_text() == "new" and not list(tmp_path.glob(".repctl*"))


def test_two_that_write_together_never_mix(tmp_path: Path) -> None:
    names = [f"file{k}" for k in range(8)]

    def run(k: int) -> None:
        for _ in range(20):
            with written_together(tmp_path) as staged:
                for name in names:
                    write_whole(staged / name, str(k))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(run, range(4)))
    assert len({(tmp_path / name).read_text() for name in names}) == 1


def test_interrupted_while_it_writes_no_file_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "whole.txt", "half")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_there_only_if_it_holds_something(tmp_path) -> None:
    """What is made for a run that fails goes again; what a person made stays, and what holds a
    file."""
    for failure in (RuntimeError, KeyboardInterrupt):
        with pytest.raises(failure), not_left_empty(check_folder(tmp_path / "a" / "b")) as folder:
            assert not folder.parent.exists()  # looking does not make it
            prepare_folder(folder)
            raise failure
        assert list(tmp_path.iterdir()) == []
    (tmp_path / "a").mkdir()
    with not_left_empty(tmp_path / "a" / "b") as folder:
        prepare_folder(folder)
    assert [p.name for p in tmp_path.rglob("*")] == ["a"]
    with pytest.raises(KeyboardInterrupt), not_left_empty(tmp_path / "a" / "b" / "c") as folder:
        write_whole(prepare_folder(folder) / "file", "text")
        raise KeyboardInterrupt
    assert (tmp_path / "a" / "b" / "c" / "file").read_text() == "text"


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="a folder is never closed to root"
)
def test_a_closed_folder_is_seen_before_the_work(tmp_path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        check_folder(tmp_path / "new")


def test_a_link_that_leads_back_to_itself_is_refused(tmp_path: Path) -> None:
    """Issue 52, item 26.18: as the name of a file, and as that of a folder."""
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "there").symlink_to("back")
    (tmp_path / "back").symlink_to("there")
    for name in ("loop", "there"):
        with pytest.raises(InputError, match=f"cannot write .*{name}: Too many levels"):
            write_whole(tmp_path / name, "text")
        with pytest.raises(InputError, match=f"cannot write into .*{name}: Too many levels"):
            check_folder(tmp_path / name)
    assert all(path.is_symlink() for path in tmp_path.iterdir())


def test_a_full_disk_leaves_no_folder_and_names_the_user_s_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 52, item 26.18: the disk is full after some bytes, or at once."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for module, name in ((os, "fsync"), (tempfile, "mkdtemp")):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, full)
            with (
                pytest.raises(InputError) as caught,
                written_together(tmp_path / "new" / "c") as staged,
            ):
                write_whole(staged / "arm.h", "text")
        said = str(caught.value)
        assert "No space left" in said and str(tmp_path / "new" / "c") in said
        assert ".repctl-" not in said and not list(tmp_path.iterdir())


PIPED = """
import sys
from repctl_pin.base.files import write_whole
print("before")
write_whole("/dev/stdout", "text\\n" * 3)
print("after")
"""


@pytest.mark.skipif(not os.path.exists("/dev/stdout"), reason="there is no /dev/stdout")
def test_standard_output_is_a_file_name(tmp_path: Path) -> None:
    """Issue 52, item 26.18: a pipe, and a file that the shell opened, which is not replaced."""
    command = [sys.executable, "-c", PIPED]
    for file in (None, tmp_path / "out"):
        with open(file or os.devnull, "wb") as output:
            to = {"stdout": output} if file else {"stdout": subprocess.PIPE}
            done = subprocess.run(command, stderr=subprocess.PIPE, timeout=60, **to)
        said = file.read_bytes() if file else done.stdout
        assert done.returncode == 0, done.stderr
        assert said.split() == [b"before", b"text", b"text", b"text", b"after"]
