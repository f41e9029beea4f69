"""Names and docstrings: one class per name, names that say what a value is, one line first."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support.source_trees import statements, tree_of

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("data_schemas", "hydro", "stages", "export", "pipeline")
AROUND = ("auvid", "benchmarks", "campaigns", "tools")
"""What users and maintainers call, beside the floors."""
DOCUMENTS = ("data_schemas/documents/", "data_schemas/records/")
"""Fields here are keys of YAML and JSON."""
SAYS_NOTHING = {
    "found",
    "told",
    "held",
    "said",
    "says",
    "shown",
    "asked",
    "alone",
    "beside",
    "apart",
    "known",
    "whole",
    "wanted",
    "given",
    "made",
    "seen",
    "sent",
}
"""A name says what a value is; these say how somebody came by it."""
PER_STAGE = {"Inputs", "Params", "Outputs"}
"""Every stage has its own."""
WIDTH = 88

Module = tuple[str, str]


def modules(folders: Iterable[str] = PRODUCT) -> Iterator[Module]:
    """Yield path and source of every file of these folders."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


TEXT = re.compile(r'("""|\'\'\')(?s:.*?)\1|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|#[^\n]*')
"""Strings and comments, in which no name is."""
PERHAPS_CLASS = re.compile(r"\bclass +([^\W_]\w*)")
QUOTES = r"(?:\"{3}|'{3})"
PERHAPS_LONG = re.compile(
    rf"(?:\A(?:#[^\n]*\n)*|:[ \t]*(?:#[^\n]*)?\n)\s*r?{QUOTES}(?:\n|(?:(?!{QUOTES}).)+\n[ \t]*\S)"
)
PERHAPS_WIDE = re.compile(
    rf"(?:\A(?:#[^\n]*\n)*|:[ \t]*(?:#[^\n]*)?\n)(?=\s*r?[\"'])[^\n]{{{WIDTH + 1}}}"
)
"""What is looked for in the text, which takes a tenth of the time, before it is parsed."""
PERHAPS_EMPTY = re.compile(rf"\b_*({'|'.join(sorted(SAYS_NOTHING))})_*\b", re.IGNORECASE)


@cache
def statements_of(source: str) -> tuple[ast.AST, ...]:
    """Return all statements of a source text and the text itself, read once."""
    tree = tree_of(source)
    return (tree, *statements(tree))


@cache
def names_of(source: str) -> tuple[tuple[int, str], ...]:
    """Return line and name of the values, arguments, functions and classes of a text."""
    names = []
    for node in ast.walk(tree_of(source)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append((node.lineno, node.id))
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.append((node.lineno, node.name))
        elif isinstance(node, ast.arg):
            names.append((node.lineno, node.arg))
    return tuple(names)


def empty_names(files: Iterable[Module]) -> list[str]:
    """Return names of files, values, arguments, functions and classes that say nothing."""
    offenders = []
    for path, source in files:
        if Path(path).stem in SAYS_NOTHING:
            offenders.append(path)
        if not PERHAPS_EMPTY.search(TEXT.sub("", source)):
            continue  # a tenth of the time of its syntax tree
        for line, name in names_of(source):
            if name.lower().strip("_") in SAYS_NOTHING:
                offenders.append(f"{path}:{line} {name}")
    return offenders


def repeated_classes(files: Iterable[Module]) -> set[str]:
    """Return the public class names that occur more than once."""
    files = list(files)
    perhaps = Counter(name for _, source in files for name in PERHAPS_CLASS.findall(source))
    several = {name for name, count in perhaps.items() if count > 1}
    files = [item for item in files if not several.isdisjoint(PERHAPS_CLASS.findall(item[1]))]
    counts = Counter(
        node.name
        for _, source in files
        for node in statements_of(source)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    return {name for name, count in counts.items() if count > 1} - PER_STAGE


def long_summaries(files: Iterable[Module]) -> list[str]:
    """Return the docstrings whose summary takes more than one line of `WIDTH` columns."""
    offenders = []
    for path, source in files:
        lines = source.split("\n")
        if not (PERHAPS_LONG.search(source) or PERHAPS_WIDE.search(source)):
            continue
        for node in statements_of(source):
            if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                continue
            text = ast.get_docstring(node)
            if text is None:
                continue
            row = node.body[0].lineno
            goes_on = "\n" in text and text.split("\n")[1].strip() != ""
            if goes_on or len(lines[row - 1]) > WIDTH:
                offenders.append(f"{path}:{row} {lines[row - 1].strip()}")
    return offenders


def test_no_name_says_nothing() -> None:
    files = modules((*PRODUCT, *AROUND, "tests"))
    assert empty_names(item for item in files if not item[0].startswith(DOCUMENTS)) == []


def test_a_class_name_has_one_meaning() -> None:
    assert repeated_classes(modules()) == set()


def test_docstrings_begin_with_one_line() -> None:
    assert long_summaries(modules()) == []


@pytest.mark.parametrize(
    "source",
    [
        "found = 1",
        "def told(): ...",
        "def name(held): ...",
        "class Shown: ...",
        "for said in (): ...",
    ],
)
def test_each_kind_of_empty_name_is_an_offence(source: str) -> None:
    assert len(empty_names([("stages/x.py", source)])) == 1
    assert len(empty_names([("stages/shown.py", "")])) == 1


@pytest.mark.parametrize("name", sorted(SAYS_NOTHING))
def test_each_empty_name_is_an_offence(name: str) -> None:
    assert len(empty_names([("stages/x.py", f"{name} = 1")])) == 1


def test_a_class_in_two_files_is_an_offence() -> None:
    files = [("stages/x.py", "class Limits: ..."), ("hydro/y.py", "class Limits: ...")]
    assert repeated_classes(files) == {"Limits"}


@pytest.mark.parametrize(
    "source",
    ['"""One\ntwo."""', 'def f():\n    """One\n    two.\n    """', f'"""{"w" * WIDTH}"""'],
)
def test_a_summary_of_two_lines_or_too_wide_is_an_offence(source: str) -> None:
    assert len(long_summaries([("stages/x.py", source)])) == 1
