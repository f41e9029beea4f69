"""Syntax trees of source texts, parsed once for all tests that look at them."""

import ast
from functools import cache


@cache
def tree_of(source: str) -> ast.Module:
    """Return the syntax tree of a source text."""
    return ast.parse(source)
