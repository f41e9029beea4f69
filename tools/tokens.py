"""Count the tokens of the project's Python outside tests/, without comments and docstrings.

python tools/tokens.py [CHECKOUT]
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

SKIPPED = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


def docstring_places(tree: ast.AST) -> set[tuple[int, int]]:
    """Return where the strings start that stand alone as statements."""
    return {
        (node.value.lineno, node.value.col_offset)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    }


def tokens_of(text: str) -> int:
    """Return the number of tokens of one source text."""
    documented = docstring_places(ast.parse(text))
    return sum(
        token.type not in SKIPPED and token.start not in documented
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
    )


def main() -> None:
    """Print tokens by folder at the top."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "checkout", nargs="?", type=Path, default=Path(__file__).resolve().parents[1]
    )
    root = parser.parse_args().checkout.resolve()
    counts: Counter[str] = Counter()
    for path in sorted(root.rglob("*.py")):
        top = path.relative_to(root).parts[0]
        if not top.startswith((".", "tests", "build", "runs")):
            counts[top] += tokens_of(path.read_text(encoding="utf-8"))
    for top, count in sorted(counts.items()):
        print(f"{top:<14} {count:8,d}")
    print(f"{'all':<14} {counts.total():8,d}")


if __name__ == "__main__":
    main()
