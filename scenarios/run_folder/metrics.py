"""metrics.json."""

from __future__ import annotations

import json

from scenarios.run_folder.contents import Run

SCHEMA = 1


def metrics_json(run: Run) -> str:
    """The metrics of a run as JSON text."""
    content = {
        "schema": SCHEMA,
        "recording": run.recording.name,
        "seed": run.seed,
        "scans": len(run.recording),
        "distance_m": round(run.recording.distance, 3),
        "metrics": [metric.to_json() for metric in run.metrics],
    }
    return json.dumps(content, indent=1, allow_nan=False)
