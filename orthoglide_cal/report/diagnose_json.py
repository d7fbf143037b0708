"""A diagnosis as the object that `orthocal diagnose --json` prints."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.axes import AXES
from orthoglide_cal.diagnosis import Diagnosis, NamedCause

SCHEMA_VERSION = 1


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The contract's fields, then a few more; lengths in mm, None where nothing is known."""
    lack, following = diagnosis.lack_of_fit, diagnosis.next_measurement
    return {
        "schema_version": SCHEMA_VERSION,
        "input": {
            "path": diagnosis.source.path,
            "sha256": diagnosis.source.sha256,
            "kind": diagnosis.kind,
            "readings": diagnosis.count,
        },
        "machine": diagnosis.machine,
        "verdict": diagnosis.verdict,
        "lack_of_fit": {
            "statistic": lack.statistic,
            "p_value": lack.p_value,
            "noise_mm": lack.noise_mm,
            "residual_mm": lack.residual_mm,
            "dof": lack.dof,
            "repeats_mm": lack.repeats_mm,
            "repeats_p_value": lack.repeats_p_value,
        },
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "ambiguous_with": list(diagnosis.ambiguous_with),
        "next_measurement": None
        if following is None
        else {
            "what": following.what,
            "separates": list(following.separates),
            "separation_sigma": following.separation_sigma,
        },
        "offsets_mm": dict(zip(AXES, diagnosis.offsets_mm.tolist(), strict=True)),
        "std_mm": dict(zip(AXES, diagnosis.std_mm.tolist(), strict=True)),
        "notes": list(diagnosis.notes),
    }


def _cause(cause: NamedCause) -> dict[str, Any]:
    return {
        "id": cause.id,
        "probability": cause.probability,
        "where": cause.where,
        "parameters": {
            name: {"value": found.value, "std": found.std, "unit": found.unit}
            for name, found in cause.parameters.items()
        },
        "rms_before_mm": cause.rms_before_mm,
        "rms_after_mm": cause.rms_after_mm,
        "heldout_before_mm": cause.heldout_before_mm,
        "heldout_after_mm": cause.heldout_after_mm,
        "aliases": list(cause.aliases),
        "heldout_ratio": cause.heldout_ratio,
        "recommended": cause.recommended,
        "advice": cause.advice,
    }
