"""Sources of the numbers: runs, versions, machines, hours; and missing results."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from apil_core.common.files import read_json
from apil_core.studies.bench.jobs import CELL
from apil_core.studies.report.models import Provenance, RunFacts, Unfinished
from apil_core.studies.report.settings import Key
from apil_core.studies.report.sources import Run, Sources


def provenance(sources: Sources) -> Provenance:
    """Collect the provenance."""
    facts = [_facts(run, _session(run, sources)) for run in sources.runs]
    versions: dict[str, list[str]] = {}
    for name, version in ((n, v) for each in facts for n, v in each.versions.items()):
        versions.setdefault(name, [])
        if version not in versions[name]:
            versions[name].append(version)
    return Provenance(
        directories=[*sources.benches, *_single_runs(sources)],
        matrices={path: matrix.model_dump(mode="json") for path, (_, matrix) in sources.benches.items()},
        runs=facts,
        versions=versions,
        git=sorted({each.git for each in facts} - {""}),
        hosts=sorted({each.host for each in facts} - {""}),
        hours=sum(each.hours for each in facts),
        steps=sum(each.steps for each in facts),
        written=time.strftime("%Y-%m-%d %H:%M:%S%z"),
        apil=metadata.version("apil"),
    )


def _single_runs(sources: Sources) -> list[str]:
    """Directories of runs that belong to no benchmark."""
    benches = [Path(path) for path in sources.benches]
    return [run.path for run in sources.runs if not any(b in Path(run.path).parents for b in benches)]


def _facts(run: Run, session: Mapping[str, Any]) -> RunFacts:
    last = run.dir.last_metrics()
    seconds = float(last.get("wall_seconds", 0.0))
    return RunFacts(
        game=run.config.env,
        method=run.config.method,
        seed=run.config.seed,
        label=run.name,
        path=run.path,
        status=run.status,
        steps=run.steps,
        planned_steps=run.config.steps,
        hours=seconds / 3600,
        steps_per_second=run.steps / seconds if seconds else 0.0,
        physics=run.physics,
        victim=run.dir.victim(),
        victim_sha256=run.config.victim_sha256 or "",
        host=str(session.get("host", "")),
        git=str(session.get("git", "")),
        versions={str(name): str(version) for name, version in session.get("versions", {}).items()},
    )


def _session(run: Run, sources: Sources) -> dict[str, Any]:
    """The last session's note; an empty one if none can be read."""
    sessions = sources.read(read_json, run.dir.environment_path, list) or [{}]
    session = sessions[-1] if isinstance(sessions[-1], dict) else {}
    versions = session.get("versions")
    return {**session, "versions": versions if isinstance(versions, dict) else {}}


def unfinished(sources: Sources, unscored: Sequence[tuple[Key, Run]]) -> list[Unfinished]:
    """Cells that were not started, failed, are still running, or have no score."""
    found = list(sources.missing)
    found += [
        Unfinished(
            game=job.subject.split("/")[0].split(" ")[0],
            method=job.kind,
            label=job.subject,
            status="failed",
            reason=reason,
            path=str(bench.path / job.kind / job.subject),
        )
        for bench, _ in sources.benches.values()
        for job in bench.jobs
        if job.kind != CELL  # a training's status shows it
        and (reason := bench.failure(job.name))
    ]
    without = {run.path for _, run in unscored}
    return found + [
        Unfinished(
            game=run.config.env,
            method=run.config.method,
            label=run.name,
            status=run.status,
            steps=run.steps,
            planned_steps=run.config.steps,
            reason=_reason(run, run.path in without),
            path=run.path,
        )
        for run in sources.runs
        if run.path in without or run.failure or run.status != "finished"
    ]


def _reason(run: Run, unscored: bool) -> str:
    if run.failure:
        return run.failure
    if run.steps < run.config.steps:
        return "training has not reached its budget" + (
            "" if unscored else "; its scores are of an earlier end"
        )
    return "has no score yet" if unscored else f"status: {run.status}"
