"""``apil bench``: attacks over methods, games and seeds."""

from __future__ import annotations

from apil_core.cli.app import sub_app

app = sub_app("bench", "Measure attacks over methods, games and seeds.")
app.command("apil_core.cli.bench_run:run", name="run", help="Run a matrix of attacks, or go on with one.")
app.command("apil_core.cli.bench_report:report", name="report", help="Results beside the published ones.")
app.command("apil_core.cli.bench_work:work", name="work", show=False)
