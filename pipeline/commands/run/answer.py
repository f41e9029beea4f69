"""What a run says in words, whether its page is drawn or not."""

from __future__ import annotations

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.execution.runner import Place, Run
from auvid.pipeline.graph import ONCE
from auvid.stages import report
from auvid.stages.report.summary.answer_text import answer_text


def answer_of(run: Run) -> str:
    """Return what the report says in words; empty where a stage before it lacks."""
    try:
        task = run.task(run.graph.stage("report"), Place(ONCE))
    except PipelineError:
        return ""
    inputs = report.Inputs(**{name: source.load() for name, source in task.sources.items()})
    return answer_text(report.collect(inputs).summary)
