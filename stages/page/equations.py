"""LaTeX as MathML, which browsers draw without any script."""

from __future__ import annotations

import re
from html import unescape
from xml.etree.ElementTree import Element, SubElement, tostring

LONGEST = 4000
"""A longer formula, or one that the library cannot read, is shown as its source."""


def mathml(latex: str) -> str:
    """Return a displayed equation; what is not LaTeX is shown as written.

    >>> mathml("u^2")
    '<math display="block" alttext="u^2"><mrow><msup><mi>u</mi><mn>2</mn></msup></mrow></math>'
    """
    # The library imports a client of HTTP: not where no page is written.
    from latex2mathml.converter import convert_to_element

    try:
        if len(latex) > LONGEST:
            raise ValueError("too long")
        lines = "&" in latex and r"\begin" not in latex
        source = rf"\begin{{align*}}{latex}\end{{align*}}" if lines else latex
        # Upright words as one element, not letter by letter.
        source = re.sub(r"\\mathrm\{([A-Za-z]{2,})\}", r"\\operatorname{\1}", source)
        root = convert_to_element(source, display="block")
        for grid in root.iter("mtable"):
            grid.set("class", "aligned" if lines else "matrix")
        root.attrib.pop("xmlns", None)
        for element in root.iter():
            element.text = unescape(element.text or "")
        root.set("alttext", latex)
        return tostring(root, encoding="unicode")
    except Exception:  # The library raises many classes, its own and Python's.
        root = Element("math", {"display": "block", "alttext": latex})
        SubElement(root, "mtext").text = latex
        return tostring(root, encoding="unicode")
