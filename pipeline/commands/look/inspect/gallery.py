"""`make gallery`: run its cases, take their pictures, and write its pages."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import CampaignError, PipelineError, UsageError, nearest
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.commands.look.inspect.inspect_command import find_subject, photograph
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.run_command import execute
from auvid.pipeline.store.atomic_files import write_atomically

FOLDER = Path("docs/gallery")
CASES, PAGE, PICTURE = "cases.yaml", "README.md", "picture.png"
KEYS = {"id", "title", "target", "log", "tab", "see"}
MAX_BYTES = 225_000


def read_cases(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Return the cases by id. Raises `CampaignError` for unknown or missing keys."""
    file = load_yaml(folder / CASES)
    for index, case in enumerate(file.value):
        for key in case:
            if key not in KEYS:
                raise CampaignError(
                    "unknown key",
                    file=file.path,
                    field=f"[{index}].{key}",
                    allowed=sorted(KEYS),
                    remedy=nearest(key, KEYS),
                )
        for key in ("id", "title", "target", "see"):
            if key not in case:
                raise CampaignError("missing key", file=file.path, field=f"[{index}].{key}")
    return {str(case["id"]): case for case in file.value}


def command_of(case: Mapping[str, Any]) -> str:
    """Return the command that shows a case."""
    options = "".join(f" --{name} {case[name]}" for name in ("log", "tab") if name in case)
    return f"auvid inspect {case['target']}{options}"


def _words(case: Mapping[str, Any]) -> str:
    return " ".join(str(case["see"]).split())


def page_of(case: Mapping[str, Any]) -> str:
    """Return the page of a case in Markdown."""
    words = _words(case)
    return (
        f"# {case['title']}\n\n    auvid run {case['target']}\n   "
        f" {command_of(case)}\n\n![{case['title']}]({PICTURE})\n\n{words}\n"
    )


def index_of(cases: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page that leads to all cases."""
    lines = [
        "# Gallery",
        "",
        "What auvid shows, case by case. `make gallery` takes the pictures again.",
        "",
    ]
    for name, case in cases.items():
        lines += [
            f"## [{case['title']}]({name}/{PAGE})",
            "",
            f"{_words(case).partition('. ')[0].rstrip('.')}.",
            "",
            f"[![{case['title']}]({name}/{PICTURE})]({name}/{PAGE})",
            "",
        ]
    return "\n".join(lines)


def main(names: Sequence[str]) -> None:
    """Write pages and pictures of these cases, of all if none is named."""
    cases = read_cases(FOLDER)
    for name in names:
        if name not in cases:
            raise UsageError(
                "no such case", value=name, allowed=list(cases), remedy=nearest(name, cases)
            )
    for name in names or cases:
        case = cases[name]
        run = open_run(str(case["target"]))
        execute(run, run.graph.stages)
        subject = find_subject(
            str(case["target"]), log=case.get("log"), tab=str(case.get("tab") or "")
        )
        picture = photograph(subject.preview())
        if len(picture) > MAX_BYTES:
            raise PipelineError(
                "the picture is too large",
                value=f"{len(picture)} bytes",
                allowed=f"{MAX_BYTES} bytes",
            )
        write_atomically(FOLDER / name / PICTURE, picture)
        write_atomically(FOLDER / name / PAGE, page_of(case).encode())
        print(f"{FOLDER / name / PICTURE}  {len(picture) / 1e3:.0f} kB")
    write_atomically(FOLDER / PAGE, index_of(cases).encode())


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except PipelineError as fault:
        sys.exit(f"error: {fault}")
