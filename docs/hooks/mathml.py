"""Write the formulas of pages as MathML, which browsers draw without a script or a network."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_DISPLAY = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_ROLE = re.compile(r":(?:meth|func|class|attr|mod):(?=<code>)")
_TAG = re.compile(r"\\tag\{(.*?)\}")


def on_page_content(text: str, /, **_: object) -> str:
    """Replace each formula by MathML, with the equation number at its right."""

    def display(found: re.Match[str]) -> str:
        formula = html.unescape(found[1])
        number = _TAG.search(formula)
        right = (
            f'<span class="equation-number">({number[1].replace("--", "–")})</span>'
            if number
            else ""
        )
        shown = convert(_TAG.sub("", formula), display="block")
        return f'<div class="equation">{shown}{right}</div>'

    text = _ROLE.sub("", text)  # roles of Sphinx in docstrings
    return _DISPLAY.sub(display, _INLINE.sub(lambda found: convert(html.unescape(found[1])), text))
