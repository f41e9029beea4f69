"""Parameters of the stages: params.yaml, and what a campaign sets on top."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from auvid.data_schemas.errors import CampaignError, ManyFaults, PipelineError, nearest
from auvid.pipeline.campaigns.campaign import Campaign
from auvid.pipeline.campaigns.workspace import PARAMS_FILE, Workspace
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml
from auvid.stages.base import Stage, make_params


def load_defaults(
    workspace: Workspace, stages: Sequence[Stage[Any, Any, Any]], names: Sequence[str] = ()
) -> YamlFile:
    """Read params.yaml, checked against the stages; empty outside any workspace.

    `names`: of all stages that it may have sections of, where `stages` are those that a
    campaign runs. Raises `CampaignError` for unknown sections or parameters.
    """
    if not (workspace.root / PARAMS_FILE).exists() and (workspace.root / "campaign.yaml").is_file():
        return YamlFile(workspace.root / PARAMS_FILE, {})
    file = load_yaml(workspace.root / PARAMS_FILE)
    if not isinstance(file.value, Mapping):
        raise CampaignError("needs one section per stage", file=file.path)
    names = names or [stage.name for stage in stages]
    for name, section in file.value.items():
        if name == "campaigns":
            continue
        if name not in names:
            raise file.located(
                CampaignError(
                    "unknown stage", file=file.path, field=str(name), remedy=nearest(name, names)
                )
            )
        if not isinstance(section, Mapping):
            raise file.located(
                CampaignError(
                    "not a mapping of parameters", file=file.path, field=str(name), value=section
                )
            )
    for stage in stages:
        try:
            make_params(stage.params, file.value.get(stage.name) or {}, stage=stage.name)
        except PipelineError as fault:
            raise _located(file, fault) from None
    return file


def _located(file: YamlFile, fault: PipelineError) -> PipelineError:
    """Return a fault of a parameter with its row in params.yaml."""
    if isinstance(fault, ManyFaults):
        return ManyFaults([_located(file, each) for each in fault.faults], file=file.path)
    fault.row = file.line((fault.field or "").removeprefix("stages."))
    return file.located(fault)


def stage_params(stage: Stage[Any, Any, Any], defaults: YamlFile, campaign: Campaign) -> Any:
    """Return the parameters of a stage: params.yaml, and what the campaign sets on top.

    Raises `CampaignError` for those that cannot be, alone or together.
    """
    own = (campaign.document.get("stages") or {}).get(stage.name) or {}
    try:
        params = make_params(
            stage.params,
            {**(defaults.value.get(stage.name) or {}), **own},
            stage=stage.name,
            file=campaign.file.path,
        )
        if stage.check is not None:
            stage.check(params, campaign.vehicle, campaign.priors)
    except PipelineError as fault:
        raise campaign.file.located(fault) from None
    return params
