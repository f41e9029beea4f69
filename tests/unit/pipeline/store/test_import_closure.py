"""The imports of sources, found without Python's own parser."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from auvid.pipeline.store.import_closure import scan
from tests.support.source_trees import executed, tree_of

ROOT = Path(__file__).resolve().parents[4]
BEGIN = re.compile(rb"^[ \t]*(?:from|import)[ \t][^\n]*", re.MULTILINE)


def test_scan_finds_the_imports_that_the_parser_of_python_finds() -> None:
    """What it finds are lines that begin so; where it finds all of them nothing is parsed."""
    for path in sorted(
        path
        for floor in ("data_schemas", "hydro", "stages", "export", "pipeline")
        for path in (ROOT / floor).rglob("*.py")
    ):
        lines = BEGIN.findall(path.read_bytes())
        if len(scan(path).imports) == len(lines) and b";" not in b"".join(lines):
            continue
        nodes = executed(tree_of(path.read_text(encoding="utf-8")))
        imports = [
            ast.dump(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)
        ]
        assert sorted(map(ast.dump, scan(path).imports)) == sorted(imports), path


def test_scan_sees_no_import_in_texts_comments_and_for_type_checkers_only(tmp_path: Path) -> None:
    source = tmp_path / "source.py"
    source.write_text(
        '"""Text with a quote\\""" in it.\n\nimport no_1\n"""\n'
        "import a, b as c  # import no_2\n"
        "x = '# no comment'; y = '''\nimport no_3\n'''\n"
        "if TYPE_CHECKING:\n    from no_4 import (\n        d,\n    )\n\n    import no_5\n"
        "from .e import (  # why (g)\n    f,\n)\n"
        "def run():\n    from h import i, \\\n        j\n    return 'notes/k.yaml', f'{x}.yaml'\n",
        encoding="utf-8",
    )
    first, second, third = scan(source).imports
    assert ast.unparse(first) == "import a, b as c"
    assert ast.unparse(second) == "from .e import f"
    assert ast.unparse(third) == "from h import i, j"
    assert "k.yaml" in scan(source).data_names
