"""README and docs/: links lead somewhere, commands exist, YAML passes, pages are current."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from auvid.data_schemas.documents import model_of
from auvid.data_schemas.documents.model import meanings
from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.campaigns.yaml_files import load_yaml
from tests.support.documents import (
    GENERATED,
    ROOT,
    anchors,
    blocks,
    commands,
    documents,
    inline_commands,
    links,
)
from tests.support.tools import load_tool

tool = load_tool("reference")
SCHEMA_OF = {"kind: ": "campaign", "stream: attitude": "column_map", "radius_ceiling": "apparatus"}
"""Text of a YAML block -> the document it is; others are parts of one."""
OUTSIDE = re.compile(r"(?:/(?:root|home|work|tmp)/|pypi|pythonhosted|file://)", re.IGNORECASE)
MOST_WORDS = 1200
"""Of README."""


@pytest.mark.parametrize("document", documents())
def test_links_lead_somewhere(document: str) -> None:
    here = (ROOT / document).parent
    broken = []
    for target in links(documents()[document]):
        path, _, anchor = target.partition("#")
        if path.startswith(("http:", "https:")):
            continue
        file = here / path if path else ROOT / document
        if not file.exists() or (anchor and anchor not in anchors(file)):
            broken.append(target)
    assert broken == []


@pytest.mark.parametrize("path", tool.PAGES)
def test_reference_pages_are_what_the_code_declares(path: str) -> None:
    assert (ROOT / path).read_text(encoding="utf-8") == tool.PAGES[path](), (
        f"{path} is out of date: run make declarations"
    )
    assert GENERATED in tool.PAGES[path]()


@pytest.mark.parametrize("name", [*tool.DOCUMENTS, "model_file"])
def test_every_key_says_what_it_is(name: str) -> None:
    for kind in tool.parts_of(model_of(name), (), []):
        assert set(meanings(kind)) == set(kind.model_fields), kind.__name__


def test_every_command_has_a_section_in_a_group() -> None:
    page = tool.commands_page()
    for name in command_tree():
        assert f"### auvid {name}\n" in page
    assert "## Others" not in page, "a new command needs a group in tools/reference.py"


@cache
def command_tree() -> dict[str, Any]:
    """Return every command by its words, built once."""
    tree: dict[str, Any] = tool.command_tree()
    return tree


def options_of(words: list[str]) -> set[str]:
    """Return the options of a command; fail if there is none of that name."""
    tree = command_tree()
    if words[0] == "new":
        words = ["new campaign" if words[1:2] == ["campaign"] else "new workspace"]
    if words[0] == "fleet":
        words = [" ".join(words[:2])]
    return {option for item in tree[words[0]].params for option in item.opts} | {"--help"}


@pytest.mark.parametrize("document", documents())
def test_commands_and_options_exist(document: str) -> None:
    text = documents()[document]
    lines = [command.line for command in commands(document)]
    lines += [] if GENERATED in text else inline_commands(text)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for line in lines:
        program, *words = line.split()
        if program == "auvid" and re.fullmatch(r"[a-z]+", words[0]):
            options = {word.partition("=")[0] for word in words[1:] if word.startswith("-")}
            assert options <= options_of(words), line
        elif program == "make" and document != "pipeline/templates/README.md":
            assert re.search(rf"^(?:.* )?{words[0]}(?: .*)?:", makefile, re.MULTILINE), line


YAML = [
    (document, block) for document, text in documents().items() for block in blocks(text, "yaml")
]


@pytest.mark.parametrize(
    ("document", "block"), YAML, ids=[f"{name}-{n}" for n, (name, _) in enumerate(YAML)]
)
def test_yaml_is_that_of_its_document(document: str, block: str, tmp_path: Path) -> None:
    """Whole documents pass their schema; parts of a campaign pass with the rest added."""
    path = tmp_path / "document.yaml"
    if "in part" in block:
        block += (
            "kind: identification\nvehicle: x\nlogs: [{id: a, file: b}]\nlegs: [{id: c, log: a}]\n"
        )
    path.write_text(block, encoding="utf-8")
    parsed = load_yaml(path)
    for text, schema in SCHEMA_OF.items():
        if re.search(rf"^(?:.*[\s{{])?{text}", block, re.MULTILINE) and text in block:
            parsed.check(schema)
            return


def test_a_wrong_key_in_a_document_is_noticed(tmp_path: Path) -> None:
    block = next(block for _, block in YAML if "kind: identification" in block)
    with pytest.raises(PipelineError, match="unknown key"):
        test_yaml_is_that_of_its_document("", block.replace("legs:", "lags:"), tmp_path)


def test_nothing_of_the_machine_or_of_a_registry() -> None:
    for document, text in documents().items():
        assert OUTSIDE.findall(text) == [], document


def test_readme_is_short() -> None:
    assert len(documents()["README.md"].split()) <= MOST_WORDS


def test_every_page_is_in_the_contents() -> None:
    """The site's list of contents names every page, or a pattern for its folder."""
    docs = ROOT / "docs"
    contents = documents()["docs/index.md"] + documents()["docs/decisions/index.md"]
    named = {line.strip() for line in contents.splitlines()}
    for path in docs.rglob("*.md"):
        name = str(path.relative_to(docs).with_suffix(""))
        folder = path.parent.name
        assert (
            name in named
            or folder in ("decisions",)
            or name == "index"
            or (name.startswith("gallery/"))
        ), name
