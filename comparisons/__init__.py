"""Studies: many worlds, many solvers, one budget, and what can be said afterwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navopt.lazy import lazy_names

if TYPE_CHECKING:
    from comparisons.ablation import Ablation as Ablation
    from comparisons.audit import Audit as Audit
    from comparisons.audit import AuditResult as AuditResult
    from comparisons.audit import run_audit as run_audit
    from comparisons.calibrate import Calibration as Calibration
    from comparisons.calibrate import calibrate_recording as calibrate_recording
    from comparisons.effects import effect_table as effect_table
    from comparisons.effects_page import print_effects as print_effects
    from comparisons.entries import Bound as Bound
    from comparisons.entries import Printed as Printed
    from comparisons.match import Match as Match
    from comparisons.match import match_track as match_track
    from comparisons.overall import overall_ranks as overall_ranks
    from comparisons.printed import printed_table as printed_table
    from comparisons.report import write_report as write_report
    from comparisons.runner import Summary as Summary
    from comparisons.runner import run_study as run_study
    from comparisons.statistics import ranked_table as ranked_table
    from comparisons.store import ResultsStore as ResultsStore
    from comparisons.study import RunSpec as RunSpec
    from comparisons.study import SolverEntry as SolverEntry
    from comparisons.study import Study as Study
    from comparisons.study import Success as Success
    from comparisons.study import list_studies as list_studies
    from comparisons.tune import Tuning as Tuning
    from comparisons.tune import tune_files as tune_files
    from comparisons.tune import tune_filter as tune_filter
    from comparisons.tune_check import FilterCheck as FilterCheck
    from comparisons.tune_check import check_filter as check_filter

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "Ablation": "comparisons.ablation",
        "Audit": "comparisons.audit",
        "AuditResult": "comparisons.audit",
        "Bound": "comparisons.entries",
        "Calibration": "comparisons.calibrate",
        "FilterCheck": "comparisons.tune_check",
        "Match": "comparisons.match",
        "Printed": "comparisons.entries",
        "ResultsStore": "comparisons.store",
        "RunSpec": "comparisons.study",
        "SolverEntry": "comparisons.study",
        "Study": "comparisons.study",
        "Success": "comparisons.study",
        "Summary": "comparisons.runner",
        "Tuning": "comparisons.tune",
        "calibrate_recording": "comparisons.calibrate",
        "check_filter": "comparisons.tune_check",
        "effect_table": "comparisons.effects",
        "list_studies": "comparisons.study",
        "match_track": "comparisons.match",
        "overall_ranks": "comparisons.overall",
        "print_effects": "comparisons.effects_page",
        "printed_table": "comparisons.printed",
        "ranked_table": "comparisons.statistics",
        "run_audit": "comparisons.audit",
        "run_study": "comparisons.runner",
        "tune_files": "comparisons.tune",
        "tune_filter": "comparisons.tune",
        "write_report": "comparisons.report",
    },
)
