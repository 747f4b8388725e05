"""Point links that leave the documentation at the repository, whose address is in mkdocs.yml only.

Without an address, such a link becomes its text."""

from __future__ import annotations

import posixpath
import re
from typing import Any

_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+[^)#\s]+)\)")


def on_page_markdown(text: str, /, *, page: Any, config: Any, **_: object) -> str:
    """Replace the links of a page to files outside ``docs``."""
    folder = posixpath.dirname(f"docs/{page.file.src_uri}")

    def pointed(link: re.Match[str]) -> str:
        file = posixpath.normpath(posixpath.join(folder, link[2]))
        if file.startswith("docs/"):
            return link[0]
        if not config.repo_url:
            return link[1]
        return f"[{link[1]}]({config.repo_url.rstrip('/')}/blob/HEAD/{file})"

    return _LINK.sub(pointed, text)
