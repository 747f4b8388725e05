"""Text of a URDF: expansion of xacro, safe parsing to a plain XML tree, labels for messages.

An argument ``notes`` is a list of texts for the user on ignored content, to which a function adds.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from lxml import etree

from ..base.errors import UrdfError
from .packages import package_folder

_MAX_NESTING = 64  # depth of nested XML elements
_MAX_ATTRIBUTES = 100  # per element; libxml2 lists them in quadratic time
_LAST_LINE = 65535  # maximum line number of libxml2

_OTHERS = {
    "sdf": "this is SDF (Gazebo), not URDF; export the robot as URDF first",
    "mujoco": "this is MJCF (MuJoCo), not URDF; export the robot as URDF first",
    "html": "this is a web page, not a URDF; download the raw file",
    "collada": "this is a COLLADA mesh, not a URDF; give the .urdf that uses it",
}
_XACRO = (
    "this is xacro, not URDF; name the file .xacro, or run `xacro file.xacro > robot.urdf` first"
)
_DOCTYPE = "has a <!DOCTYPE>, which a URDF does not need; delete it and the entities it declares"
_HARMLESS = {
    "ERR_UNKNOWN_VERSION": "ignored: the version in <?xml version=…?>; read as 1.0",
    "ERR_RESERVED_XML_NAME": "ignored: <?xml …?> that is not at the start of the file",
}
"""Parser errors that change no element, with the note to add for each."""

_PROLOG = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*<(?:(?=\?).*?\?>|!(?=--).*?-->))*\s*", re.DOTALL)
"""Start of an XML file: byte order mark, declaration, processing instructions, comments."""

_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def parse(data: bytes, notes: list[str]) -> etree._Element:
    """Parse a URDF to an XML tree of links, joints and materials, without namespaces and comments.

    Parameters
    ----------
    data
        Content of the file.
    notes
        List to which a text is added per kind of ignored content, which Pinocchio ignores too: an
        unknown XML version, undeclared prefixes, leftover xacro elements, NUL bytes at the end.

    Raises
    ------
    UrdfError
        If the bytes are not XML, are another kind of XML, such as a xacro file, or exceed the
        limits on nesting and attributes; or if an attribute contains ``${…}`` or ``$(…)``, which
        xacro would have replaced.
    """
    whole = data.rstrip(b"\0") if not data.startswith(_UTF16) else data
    if whole != data:
        notes.append("ignored: zero bytes at the end of the file")
    _refuse_other_files(whole)
    root = _read_xml(whole, notes)
    if root.getroottree().docinfo.doctype:
        raise UrdfError(_DOCTYPE)
    _check_root(root)
    _note_foreign(root, notes)
    robot = _plain(root)
    for child in list(robot):
        nameless = child.tag == "material" and not child.get("name")  # no shape can refer to it
        if child.tag not in ("link", "joint", "material") or nameless:
            robot.remove(child)
    for element in robot.iter():
        if any("${" in value or "$(" in value for value in element.attrib.values()):
            raise bad(element, f"a value contains ${{…}} or $(…); {_XACRO}")
    return robot


def _read_xml(data: bytes, notes: list[str]) -> etree._Element:
    """Parse XML, and raise UrdfError for a parser error that could change an element.

    Other parser errors add a note to ``notes``. Nothing is fetched from the network.
    """
    parser = etree.XMLParser(
        recover=True, resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise _not_xml(error.lineno, error.msg) from error
    for entry in parser.error_log:
        if entry.type_name not in _HARMLESS and entry.domain_name != "NAMESPACE":
            raise _not_xml(entry.line, entry.message)
    if root is None:
        raise _not_xml(1, None)
    found = {entry.type_name for entry in parser.error_log}
    notes += [note for name, note in _HARMLESS.items() if name in found]
    return root


def _not_xml(where: int, what: str | None) -> UrdfError:
    return UrdfError(
        f"line {where}: not well-formed XML ({what or 'unreadable'}); "
        "check that the file is complete"
    )


def _note_foreign(root: etree._Element, notes: list[str]) -> None:
    """Add notes on ignored xacro elements, whose content is missing, and undeclared prefixes.

    The prefixes are those of XML namespaces.
    """
    elements = [e for e in root.iter() if isinstance(e.tag, str)]
    xacro = [e for e in elements if _prefix(e) == "xacro"]
    if xacro:
        tags = _some(f"<xacro:{_local(e)}>" for e in xacro)
        notes.append(
            f"ignored: {tags} in {line(xacro[0])}, left over from xacro; "
            "run xacro to add the missing elements"
        )
    names = [e.tag for e in elements] + [name for e in elements for name in e.attrib]
    undeclared = [
        name.split(":")[0] for name in names if ":" in name and not name.startswith(("{", "xacro:"))
    ]
    if undeclared:
        notes.append(
            "ignored: elements and attributes with a prefix that the file does not declare: "
            + _some(f"{prefix}:" for prefix in undeclared)
        )


def _some(names: Iterable[str]) -> str:
    """Format the first three distinct names and the number of others: ``a, b, c and 2 more``."""
    different = [short(name)[1:-1] for name in dict.fromkeys(names)]
    more = f" and {len(different) - 3} more" if len(different) > 3 else ""
    return ", ".join(different[:3]) + more


def _prefix(element: etree._Element) -> str | None:
    """Return an element's namespace prefix, declared or not; None if it has none."""
    prefix, colon, _ = element.tag.partition(":")
    return prefix if colon and not element.tag.startswith("{") else element.prefix


def _local(element: etree._Element) -> str:
    return element.tag.rpartition("}")[2].rpartition(":")[2]


def _refuse_other_files(data: bytes) -> None:
    """Raise UrdfError for other kinds of files that are often given as a URDF.

    These are empty files, Git LFS pointers, binary files, web pages and other texts. The message
    names the kind of file, which an error of the XML parser would not.
    """
    if not data.strip():
        raise UrdfError("the file is empty; give a .urdf file")
    if data.startswith(b"version https://git-lfs"):
        raise UrdfError("this is a Git LFS pointer, not the file itself; run `git lfs pull` first")
    if data.startswith(_UTF16):
        return
    if b"\0" in data:
        raise UrdfError("this is a binary file, not a URDF; give a .urdf file")
    head = _PROLOG.sub(b"", data, count=1)[:64]
    if head.lower().startswith((b"<!doctype html", b"<html")):
        raise UrdfError(_OTHERS["html"])
    if head.upper().startswith(b"<!DOCTYPE"):
        raise UrdfError(_DOCTYPE)
    if not head.startswith(b"<"):
        raise UrdfError(
            f"not XML: the file starts with {short(head[:30].decode('latin-1'))}; give a .urdf file"
        )


def _check_root(root: etree._Element) -> None:
    """Raise UrdfError if the root is not ``<robot>``, or a file is built to exhaust memory.

    Such a file nests elements too deep, or has an element with too many attributes. xacro and SRDF
    files, whose root is ``<robot>`` too, are refused.
    """
    tag = _local(root)
    if tag.lower() in _OTHERS:
        raise UrdfError(_OTHERS[tag.lower()])
    if tag != "robot":
        raise UrdfError(
            f"{line(root)}: the root is <{tag[:40]}>; give a URDF, whose root is <robot>"
        )
    depth = 0
    for event, element in etree.iterwalk(root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        if depth > _MAX_NESTING:
            raise UrdfError(
                f"{line(element)}: elements are nested more than {_MAX_NESTING} deep; "
                "correct the file"
            )
        if len(element.attrib) > _MAX_ATTRIBUTES:
            raise UrdfError(
                f"{line(element)}: {len(element.attrib)} attributes in one element exceed "
                f"the maximum of {_MAX_ATTRIBUTES}; correct the file"
            )
    tags = {child.tag for child in root}
    xacro = next((e for e in root.iter() if isinstance(e.tag, str) and _prefix(e) == "xacro"), None)
    if "link" not in tags and xacro is not None:
        raise UrdfError(f"{line(xacro)}: <xacro:{_local(xacro)}>: {_XACRO}")
    if "link" not in tags and tags & {"group", "group_state"}:
        raise UrdfError("this is an SRDF (groups and poses), not a URDF; give the robot's .urdf")


def _plain(element: etree._Element) -> etree._Element:
    """Copy an element without namespaces, comments and elements of other namespaces.

    The line numbers in the file are kept.
    """
    attributes = {k: v for k, v in element.attrib.items() if not k.startswith("{") and ":" not in k}
    copy = etree.Element(_local(element), attributes)
    copy.sourceline = min(element.sourceline, _LAST_LINE)
    copy.extend([_plain(c) for c in element if isinstance(c.tag, str) and _prefix(c) is None])
    return copy


def bad(element: etree._Element, what: str) -> UrdfError:
    """Create the error ``line N: label: what``, where ``what`` is the fault of the element.

    The label is the element's name in messages, such as ``joint 'elbow'``.
    """
    return UrdfError(f"{line(element)}: {label(element)}: {what}")


def line(element: etree._Element) -> str:
    """Format the line number of an element in the file, such as ``line 12``."""
    return (
        f"line {element.sourceline}"
        if element.sourceline < _LAST_LINE
        else f"after line {_LAST_LINE - 1}"
    )


def label(element: etree._Element) -> str:
    """Describe an element for a message, such as ``joint 'elbow'``, ``<axis> of joint 'elbow'``."""
    owner = element
    while owner.getparent() is not None and owner.getparent().getparent() is not None:
        owner = owner.getparent()
    if owner.getparent() is None:
        return f"<{element.tag}>"
    name = short(owner.get("name")) if owner.get("name") else "without a name"
    return f"{owner.tag} {name}" if owner is element else f"<{element.tag}> of {owner.tag} {name}"


def short(text: str) -> str:
    """Quote a value for a message, cut to 60 characters."""
    return repr(text if len(text) <= 60 else text[:59] + "…")


# ---- xacro ----


_SECONDS = 20.0
"""Maximum time of an expansion, s."""

_EXPAND = """
import contextlib, os, resource, sys
sys.path.pop(0)  # do not import from the current folder
folders = sys.argv[2:]
del sys.argv[2:]
with contextlib.suppress(ValueError, OSError):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
import xacro
from xacro import substitution_args

def find(package):
    pairs = [folder.partition("=")[::2] for folder in folders]
    own = [folder for name, folder in pairs if name == package]
    inside = [os.path.join(folder, package) for name, folder in pairs]
    named = [folder for name, folder in pairs if os.path.basename(folder) == package]
    found = [folder for folder in own + inside + named if os.path.isdir(folder)]
    return found[0] if found else sys.exit(f"package {package!r} not found")

substitution_args._eval_find = substitution_args._eval_dict["find"] = find
xacro.main()
"""
"""Python program that expands xacro, with the folders for ``$(find package)`` as arguments."""


def expand(path: Path, most: int, package_dirs: Sequence[str] = ()) -> bytes:
    """Expand a xacro file to a URDF in a separate process, limited to 20 s and 1 GB.

    Parameters
    ----------
    path
        The xacro file.
    most
        Maximum size of the result, bytes; a longer result is cut to ``most`` + 1 bytes, by which
        the caller recognises it.
    package_dirs
        Folders in which ``$(find package)`` is looked up: packages, folders with packages, or the
        folder of one package as ``NAME=DIR``.

    Raises
    ------
    UrdfError
        If ``xacro`` is not installed, or cannot expand the file; the message quotes xacro's error.
    """
    if importlib.util.find_spec("xacro") is None:
        raise UrdfError(
            "a xacro file requires xacro, which is not installed; run `pip install xacro`, "
            "or run `xacro file.xacro > robot.urdf` on a machine with ROS"
        )
    # the command, in which packages are found by name
    named = map(package_folder, package_dirs)
    folders = [f"{name}={os.path.abspath(folder)}" for name, folder in named]
    command = [sys.executable, "-c", _EXPAND, str(path.absolute()), *folders]
    # a process of its own, within the time limit
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            text, complaints = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise UrdfError(
                f"xacro did not finish within {_SECONDS:g} s; look for a macro that calls itself"
            ) from None
        except BaseException:  # interrupted: do not wait for the process
            process.kill()
            raise
    # xacro's own reason, in one line
    if process.returncode != 0:
        said = [
            line for line in complaints.decode(errors="replace").splitlines() if line.strip()
        ] or ["no reason"]
        stated = [line.strip() for line in said if line.startswith(("package ", "error:"))]
        reason = (stated or said)[0][:200]
        remedy = (
            "give the folder that contains it (--package-dir, package_dirs=)"
            if reason.startswith("package ")
            else "correct it"
        )
        raise UrdfError(f"xacro cannot expand it ({reason}); {remedy}")
    return text[: most + 1]
