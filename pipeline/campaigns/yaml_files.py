"""YAML that a user writes: loaded safely, with the line of every key.

Duplicate keys are refused; error messages name the line.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.model import M, parse
from auvid.data_schemas.errors import CampaignError, ManyFaults, PipelineError
from auvid.data_schemas.yaml_text import Loader
from auvid.pipeline.campaigns.yaml_words import yaml_fault
from auvid.pipeline.store.atomic_files import document_bytes

NO_TEXT = re.compile("[\0\ud800-\udfff]")
SAVE_AS_UTF_8 = "Save the file as UTF-8 in the editor."
LONGEST = 100
"""Characters of a number."""
MOST_REPEATED = 10_000
"""Values that all aliases of a file together may stand for."""


@dataclass(frozen=True)
class YamlFile:
    """A loaded file: path, value, and the line (from 1) of every dotted key."""

    path: Path
    value: Any
    lines: dict[str, int] = field(default_factory=dict)

    def line(self, path: str | None) -> int | None:
        """Return the line of a key, or of the nearest thing around it."""
        while path:
            if path in self.lines:
                return self.lines[path]
            path = path.rpartition("[")[0] if path.endswith("]") else path.rpartition(".")[0]
        return None

    def located(self, fault: PipelineError) -> PipelineError:
        """Return the same fault with this file and its line, if the field is there."""
        if isinstance(fault, ManyFaults):
            return ManyFaults([self.located(each) for each in fault.faults], file=self.path)
        fault.file = self.path if fault.file is None else fault.file
        if fault.row is None and fault.field is not None and fault.file == self.path:
            fault.row = self.line(fault.field)
        fault.args = (str(fault),)
        return fault

    def parse(self, kind: type[M]) -> M:
        """Return the value as a checked model."""
        return parse(kind, self.value, file=self.path, row=self.line)

    def check(self, schema: str) -> None:
        """Check the value against a document schema."""
        try:
            check_document(self.value, schema, file=self.path)
        except PipelineError as fault:
            raise self.located(fault) from None


def load_yaml(path: Path, *, named_in: object = None, what: str = "file") -> YamlFile:
    """Load a YAML file.

    `named_in` and `what` say which entry of which file asked for it.

    Raises `CampaignError` for text that is no YAML or holds a key twice,
    `PipelineError` for a file that cannot be read.
    """
    file = named_in if named_in is not None else path
    return yaml_of(path, document_bytes(path, file=file, what=what))


def yaml_of(path: Path, content: bytes) -> YamlFile:
    """Return what the content of a file says. Raises `CampaignError` as `load_yaml`."""
    if not content.strip(b"\0") and content:
        raise CampaignError(
            "nothing but zero bytes, as of a file that a power cut left empty",
            file=path,
            remedy="Write it again, or take a copy.",
        )
    if b"\0" in content[:4]:
        raise CampaignError("UTF-16 text", file=path, allowed="UTF-8", remedy=SAVE_AS_UTF_8)
    try:
        text = content.decode("utf-8")
        loader = Loader(text)
        node = loader.get_single_node()
        lines: dict[str, int] = {}
        _walk(node, "", lines, path, set())
        _refuse_bombs(node, path)
        value = None if node is None else loader.construct_document(node)
    except UnicodeDecodeError as fault:
        raise CampaignError(
            "not UTF-8 text",
            file=path,
            row=content[: fault.start].count(b"\n") + 1,
            remedy=SAVE_AS_UTF_8,
        ) from None
    except (yaml.MarkedYAMLError, yaml.reader.ReaderError) as fault:
        mark = getattr(fault, "problem_mark", None)
        problem = getattr(fault, "problem", None) or str(fault).splitlines()[0]
        if mark is None:
            raise CampaignError(f"not valid YAML: {problem}", file=path) from None
        row, cause, remedy = yaml_fault(text, mark.line + 1, problem)
        line = text.splitlines()[row - 1].strip() if text else ""
        raise CampaignError(
            f"not valid YAML: {cause}", file=path, row=row, value=line[:60], remedy=remedy
        ) from None
    except (ValueError, TypeError, RecursionError) as fault:
        raise CampaignError(f"not valid YAML: {fault}", file=path) from None
    return YamlFile(path, {} if value is None else value, lines)


def _walk(
    node: yaml.Node | None, path: str, lines: dict[str, int], file: Path, visited: set[int]
) -> None:
    if node is None or id(node) in visited:
        return
    visited.add(id(node))
    lines[path] = node.start_mark.line + 1
    if isinstance(node, yaml.ScalarNode):
        _check_scalar(node, path, file)
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            _walk(item, f"{path}[{index}]", lines, file, visited)
    elif isinstance(node, yaml.MappingNode):
        keys: set[Hashable] = set()
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else str(key)
            if name in keys and name != "<<":
                raise CampaignError(
                    "this key stands twice",
                    file=file,
                    row=key.start_mark.line + 1,
                    field=f"{path}.{name}" if path else name,
                )
            keys.add(name)
            if isinstance(key, yaml.ScalarNode):
                _check_scalar(key, path, file)
            inner = f"{path}.{name}" if path else name
            _walk(value, inner, lines, file, visited)
            lines[inner] = key.start_mark.line + 1


def _check_scalar(node: yaml.ScalarNode, path: str, file: Path) -> None:
    """Refuse texts that no page can hold, and numbers that no float holds."""
    faults = {
        "a character that no text may hold": NO_TEXT.search(node.value),
        "a number too long": node.tag.endswith((":int", ":float")) and len(node.value) > LONGEST,
    }
    for words, applies in faults.items():
        if applies:
            row = node.start_mark.line + 1
            raise CampaignError(words, file=file, row=row, field=path or None, value=node.value)


def _refuse_bombs(root: yaml.Node | None, file: Path) -> None:
    """Refuse aliases within themselves, or beyond `MOST_REPEATED` times the file."""
    sizes: dict[int, int] = {}
    repeated = 0

    def size(node: yaml.Node) -> int:
        nonlocal repeated
        count = sizes.get(id(node))
        if count == 0:
            raise CampaignError(
                "an alias stands in what it names", file=file, row=node.start_mark.line + 1
            )
        if count is None:
            sizes[id(node)] = 0
            inner = node.value if isinstance(node, yaml.CollectionNode) else ()
            pairs = isinstance(node, yaml.MappingNode)
            parts = (part for item in inner for part in (item if pairs else (item,)))
            count = sizes[id(node)] = 1 + sum(map(size, parts))
        else:
            repeated += count
        if repeated > MOST_REPEATED or count > MOST_REPEATED + len(sizes):
            raise CampaignError(
                "aliases repeat too much",
                file=file,
                row=node.start_mark.line + 1,
                allowed=f"{MOST_REPEATED} values",
                remedy="Write out what is meant.",
            )
        return count

    if root is not None:
        size(root)
