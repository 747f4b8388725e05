"""The checksum of a design file, written down once more."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def checksum(content: dict[str, Any]) -> str:
    """SHA-256 of everything but the checksum: keys in order, no spaces, names as they are."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
