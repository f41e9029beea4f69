"""params.yaml and dvc.yaml, generated from the declarations of the stages."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.graph import ONCE, AnyStage, Graph, stages_of_kind
from auvid.stages.base import make_params

COMMENT_AT = 44
CODE = "runs/.code"
INPUTS = f"{CODE}/${{item}}"
KEPT = "{cache: false, persist: true}"
HEADER = """\
# One entry per stage, for each campaign that has it. A stage whose inputs differ between
# kinds of campaigns has an entry for each: STAGE-KIND, or STAGE-simulated for twins.
# `auvid run CAMPAIGN` does the same in one process; either may follow the other, for what
# is fresh is decided by the manifests under runs/. The hash of a stage's code (its own
# imports and schemas) stands in a small file that `code` brings up to date each time: an
# edited equation reruns what uses it. `inputs` does the same for what each stage reads of
# manifest, logs, vehicle and parameters: a changed key reruns the stages that read it.
# A stage leaves its folder, for some of what lies in it depends on settings and logs.
stages:
  code:
    desc: Hash of the code of each stage
    cmd: auvid code
    always_changed: true
    outs:"""


def default_of(item: Field[Any]) -> Any:
    """Return the default of a parameter, tuples as lists."""
    value = item.default if item.default_factory is MISSING else item.default_factory()
    return list(value) if isinstance(value, tuple) else value


def bounds(meta: Mapping[str, Any]) -> str:
    """Return the allowed values of a parameter in words; empty if any."""
    if meta.get("allowed"):
        return ", ".join(str(value) for value in meta["allowed"])
    low, high = meta.get("low"), meta.get("high")
    if low is None and high is None:
        return ""
    return (
        f"{low:g} to {high:g}"
        if low is not None and high is not None
        else f"at least {low:g}"
        if low is not None
        else f"at most {high:g}"
    )


def params_yaml(
    stages: Sequence[AnyStage],
    campaigns: Sequence[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """Return params.yaml: each parameter's value, unit, bounds and meaning.

    values: by stage and parameter; the default where there is none.
    """
    lines = [
        (
            "# Defaults of every stage parameter, one section per stage. A campaign sets what"
            " differs under `stages:` in its manifest."
        ),
        "# The comment gives unit, allowed values and meaning; `auvid stages` prints the same.",
        "",
        "campaigns:                                  # those that dvc repro runs",
        *(f"  - {name}" for name in campaigns),
    ]
    for stage in stages:
        lines += [
            "",
            f"# {stage.summary}",
            f"{stage.name}:" if fields(stage.params) else f"{stage.name}: {{}}",
        ]
        for item in fields(stage.params):
            unit, allowed = item.metadata["unit"], bounds(item.metadata)
            default = default_of(item)
            value = ((values or {}).get(stage.name) or {}).get(item.name, default)
            notes = [
                *([f"[{unit}]"] if unit != "1" else []),
                item.metadata["meaning"],
                *([f"({allowed})"] if allowed else []),
                *([f"(default {_scalar(default)})"] if value != default else []),
            ]
            lines.append(
                f"  {item.name}: {_scalar(value)}".ljust(COMMENT_AT - 1) + f" # {' '.join(notes)}"
            )
    return "\n".join(lines) + "\n"


def _scalar(value: Any) -> str:
    """Return a YAML scalar or flow list: JSON, but for words that need no quotes."""
    if (
        isinstance(value, str)
        and value.isidentifier()
        and value not in ("null", "true", "false", "yes", "no", "on", "off")
    ):
        return value
    return json.dumps(value, ensure_ascii=False)


def dvc_yaml(
    stages: Sequence[AnyStage], kinds: Mapping[str, tuple[str, ...]], campaigns: Mapping[str, str]
) -> str:
    """Return dvc.yaml: an entry per stage, over the campaigns that have it.

    Campaigns are given as name -> kind.

    Where a stage has other inputs in another kind of campaign, it has an entry of its
    own there: `STAGE-simulated` for the kinds that simulate their logs, else
    `STAGE-KIND`.
    """
    graphs = {
        kind: Graph(stages_of_kind(stages, kinds, kind))
        for kind in kinds
        if kind in campaigns.values()
    }
    lines = [HEADER, *(f"      - {CODE}/{stage.name}.txt: {KEPT}" for stage in stages)]
    lines += [
        "",
        "  inputs:",
        "    foreach: ${campaigns}",
        "    do:",
        "      desc: Hash of what each stage reads of manifest, logs, vehicle and parameters",
        "      cmd: auvid code ${item}",
        "      always_changed: true",
        "      outs:",
        f"        - {INPUTS}: {KEPT}",
    ]
    for stage in stages:
        bodies: dict[tuple[str, ...], list[str]] = {}
        for kind, graph in graphs.items():
            if stage.name in kinds[kind]:
                bodies.setdefault(tuple(_entry(graph, stage)), []).append(kind)
        for index, (body, of) in enumerate(bodies.items()):
            simulated = len(of) > 1 and all("simulate" in kinds[kind] for kind in of)
            suffix = "" if index == 0 else "-simulated" if simulated else f"-{of[0]}"
            names = [name for name, kind in campaigns.items() if kind in of]
            each = "${campaigns}" if len(names) == len(campaigns) else f"[{', '.join(names)}]"
            lines += ["", f"  {stage.name}{suffix}:", f"    foreach: {each}", *body]
    metrics = [
        f"  - {path}" for name, kind in campaigns.items() for path in _metrics(graphs[kind], name)
    ]
    lines += ["", "metrics:", *metrics] if metrics else []
    return "\n".join(lines) + "\n"


def _entry(graph: Graph, stage: AnyStage) -> list[str]:
    """Return what an entry does for each of its campaigns."""
    feeds = graph.feeds(stage)
    producers = {port.stage.name for feed in feeds for port in feed.producers}
    if stage.maps_over == "segment":
        producers |= {other.name for other in graph.stages if other.yields == "segment"}
    deps = [f"{CODE}/{stage.name}.txt", f"{INPUTS}/{stage.name}.txt"]
    deps += [_folder(other) for other in graph.stages if other.name in producers]
    keys = [f"{stage.name}.{item.name}" for item in fields(stage.params)]
    lines = [
        "    do:",
        f"      desc: {stage.summary}",
        f"      cmd: auvid run ${{item}} --only {stage.name}",
        "      deps:",
        *(f"        - {path}" for path in deps),
    ]
    lines += ["      params:", *(f"        - {key}" for key in keys)] if keys else []
    lines += ["      outs:", f"        - {_folder(stage)}: {{persist: true}}"]
    return lines


def _folder(stage: AnyStage) -> str:
    """Return the folder of a stage, which it leaves whatever its settings."""
    return f"runs/${{item}}/{stage.name}"


def _metrics(graph: Graph, campaign: str) -> list[str]:
    """Return files of figures of a campaign, which `dvc metrics` shows."""
    return [
        f"runs/{campaign}/{port.stage.name}/{port.path(ONCE)}"
        for port in graph.outputs
        if port.schema.endswith("_metrics") and port.level == ONCE
    ]


def campaign_kinds(root: Path, campaigns: Sequence[str]) -> dict[str, str]:
    """Return the kind of each campaign, from its manifest."""
    from auvid.pipeline.campaigns.yaml_files import load_yaml

    return {
        name: str(load_yaml(root / "campaigns" / name / "campaign.yaml").value["kind"])
        for name in campaigns
    }


def _kept(stages: Sequence[AnyStage], document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the values of a params.yaml that its stages still have, checked."""
    defaults = {
        stage.name: {item.name: default_of(item) for item in fields(stage.params)}
        for stage in stages
    }
    kept: dict[str, dict[str, Any]] = {}
    for name, section in document.items():
        for key, value in (section or {}).items() if name != "campaigns" else ():
            if key not in defaults.get(name, {}):
                print(f"params.yaml: {name}.{key} is no parameter; left out, was {value!r}")
                continue
            kept.setdefault(name, {})[key] = value
            if value != defaults[name][key]:
                print(f"params.yaml: {name}.{key} stays {value!r}, default {defaults[name][key]!r}")
    for stage in stages:
        make_params(stage.params, kept.get(stage.name, {}), stage=stage.name, file="params.yaml")
    return kept


def main(names: Sequence[str] = ("params.yaml", "dvc.yaml")) -> None:
    """Write declarations of this folder; campaigns and values of params.yaml stay.

    Values that differ from the default are named, and so are those of parameters that
    are no more, which are left out. Raises `CampaignError` for a value that is not valid.
    """
    from auvid.pipeline.campaigns.yaml_files import load_yaml
    from auvid.pipeline.store.atomic_files import write_atomically
    from auvid.stages.registry import KINDS, STAGES

    params = Path("params.yaml")
    document = load_yaml(params).value if params.is_file() else {}
    campaigns = sorted(
        document["campaigns"] or []
        if params.is_file()
        else [path.parent.name for path in Path("campaigns").glob("*/campaign.yaml")]
    )
    texts = {
        "params.yaml": params_yaml(STAGES, campaigns, _kept(STAGES, document)),
        "dvc.yaml": dvc_yaml(STAGES, KINDS, campaign_kinds(Path(), campaigns)),
    }
    for name in names:
        write_atomically(Path(name), texts[name].encode())


if __name__ == "__main__":
    try:
        main(*([sys.argv[1:]] if sys.argv[1:] else []))
    except PipelineError as fault:
        sys.exit(str(fault))
