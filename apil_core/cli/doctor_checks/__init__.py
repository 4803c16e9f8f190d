"""What works on this machine and what does not, with a remedy: ``apil doctor``."""

from __future__ import annotations

from apil_core.cli.doctor_checks.examination import examine
from apil_core.cli.doctor_checks.finding import Finding, Report, Status

__all__ = ["Finding", "Report", "Status", "examine"]
