"""``apil bench``: the verbs that measure, from a matrix of attacks to the speed of a step."""

from __future__ import annotations

from apil_core.cli.app import sub_app

app = sub_app("bench", "Measure: attacks over methods, games and seeds; and how fast everything is.")
app.command("apil_core.cli.bench_run:run", name="run", help="Run a matrix of attacks, or go on with one.")
app.command("apil_core.cli.bench_report:report", name="report", help="Results beside the published ones.")
app.command("apil_core.cli.bench_speed:speed", name="speed", help="How fast all is beside the physics alone.")
app.command("apil_core.cli.bench_work:work", name="work", show=False)
