"""``apil bench``: the verbs that measure."""

from __future__ import annotations

from apil_core.cli.app import sub_app

app = sub_app("bench", "Measure: how fast everything is beside the physics alone.")
app.command("apil_core.cli.bench_speed:speed", name="speed")
