"""Settings of the site: `make docs` builds it into build/docs.

Nothing on its pages comes from the network: Furo brings its own style, fonts are those
of the reader's system, and equations are MathML.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

import auvid

project = "auvid"
author = "the authors of auvid"
version = release = auvid.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "notebooks"]
html_theme = "furo"
html_title = "auvid"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(Path(__file__).with_name("scorer.js"))
html_show_search_summary = False  # a page that is opened as a file may not read others
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
myst_enable_extensions = ["dollarmath", "deflist", "attrs_block"]
myst_heading_anchors = 4
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_use_ivar = True
suppress_warnings = ["misc.highlighting_failure"]

HERE = Path(__file__).parent
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((\.\./[^)\s]+)\)")


def drop_links_into_the_code(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace links to files of the repository, which the site does not hold, by code."""
    folder = (HERE / page).parent

    def plain(link: re.Match[str]) -> str:
        target = os.path.normpath(folder / link[2].partition("#")[0])
        return link[0] if Path(target).is_relative_to(HERE) else f"`{link[1].strip('`')}`"

    source[0] = LINK.sub(plain, source[0])


def inline_math(translator: Any, node: nodes.math) -> None:
    """Write an equation within a line as MathML."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block_math(translator: Any, node: nodes.math_block) -> None:
    """Write an equation on a line of its own as MathML."""
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer of equations and the change of links."""
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
    app.connect("source-read", drop_links_into_the_code)
