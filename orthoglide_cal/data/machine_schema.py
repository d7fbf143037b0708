"""The machine file's schema (the contract in the README), to and from `Machine`."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from orthoglide_cal.data.cause_ids import CAUSE_UNITS
from orthoglide_cal.data.schema import (
    CauseId,
    Day,
    Digest,
    NotNegative,
    Number,
    Positive,
    Strict,
    Text,
    Version,
    Word,
    fault,
)
from orthoglide_cal.machine import Estimate, Gauge, IdentifiedCause, Machine


class GaugeModel(Strict):
    """`gauge:`, all in mm."""

    resolution_mm: Positive
    range_mm: Positive
    revolution_mm: Positive | None = None
    repeatability_mm: Positive


class OffsetsModel(Strict):
    """`offsets_mm:`, already active in the controller."""

    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0


class EstimateModel(Strict):
    """One parameter of an accepted cause."""

    value: Number
    std: NotNegative
    unit: Text


class IdentifiedModel(Strict):
    """One entry of `identified:`."""

    cause: CauseId
    where: Text = ""
    parameters: dict[Word, EstimateModel]
    date: Day
    data_sha256: Digest
    correlation: tuple[tuple[Number, ...], ...] = ()

    @field_validator("where", mode="before")
    @classmethod
    def _null_is_everywhere(cls, value: object) -> object:
        return "" if value is None else value

    @model_validator(mode="after")
    def _correlated(self) -> Self:
        if not self.correlation:
            return self
        wanted = len(self.parameters)
        if {len(self.correlation), *map(len, self.correlation)} != {wanted}:
            raise fault(
                f"The correlations are not {wanted} rows of {wanted} numbers.",
                "Give one row for each parameter, in their order, or remove them.",
                ("correlation",),
            )
        matrix = np.array(self.correlation)
        if (
            np.abs(matrix - matrix.T).max() > 1e-5
            or np.abs(np.diag(matrix) - 1.0).max() > 1e-5
            or np.linalg.eigvalsh(matrix)[0] < -1e-5
        ):
            raise fault(
                "These numbers are not correlations.",
                "They are symmetric, with ones on the diagonal, and of no negative variance.",
                ("correlation",),
            )
        return self

    @model_validator(mode="after")
    def _units(self) -> Self:
        unit = CAUSE_UNITS[self.cause]
        for name, estimate in self.parameters.items():
            if estimate.unit != unit:
                raise fault(
                    f"{self.cause} is measured in {unit or 'no unit'}, not {estimate.unit!r}.",
                    f"Convert the value and its std, and write unit: {unit!r}.",
                    ("parameters", name, "unit"),
                )
        return self


class MachineModel(Strict):
    """A machine file."""

    schema_version: Version
    name: Word
    leg_length_mm: Positive
    parallelogram_width_mm: Positive
    tool_offset_mm: NotNegative
    joint_limits_mm: tuple[Number, Number]
    workspace_mm: Positive
    gauge: GaugeModel
    offsets_mm: OffsetsModel = OffsetsModel()
    tolerances: dict[CauseId, Positive] = Field(default_factory=dict)
    identified: tuple[IdentifiedModel, ...] = ()

    @field_validator("offsets_mm", "tolerances", mode="before")
    @classmethod
    def _null_is_none_given(cls, value: object) -> object:
        return {} if value is None else value

    @field_validator("identified", mode="before")
    @classmethod
    def _null_is_no_cause(cls, value: object) -> object:
        return () if value is None else value

    @field_validator("joint_limits_mm")
    @classmethod
    def _around_isotropic(cls, limits: tuple[float, float]) -> tuple[float, float]:
        if not limits[0] < 0.0 < limits[1]:
            raise fault(
                "The limits must be ordered, with the isotropic posture (0) between them.",
                "Give displacements from the isotropic posture, such as [-100, 60].",
            )
        return limits

    @model_validator(mode="after")
    def _within_reach(self) -> Self:
        for index, limit in enumerate(self.joint_limits_mm):
            if abs(limit) >= self.leg_length_mm:
                raise fault(
                    f"The limit is beyond the leg's length of {self.leg_length_mm} mm.",
                    "Give the displacement from the isotropic posture, not the joint value.",
                    ("joint_limits_mm", index),
                )
        return self

    @classmethod
    def from_machine(cls, machine: Machine) -> MachineModel:
        """The file's content for a machine; raises pydantic's error if it breaks the schema."""
        gauge = machine.gauge
        return cls.model_validate(
            {
                "schema_version": 1,
                "name": machine.name,
                "leg_length_mm": machine.leg_length_mm,
                "parallelogram_width_mm": machine.parallelogram_width_mm,
                "tool_offset_mm": machine.tool_offset_mm,
                "joint_limits_mm": machine.joint_limits_mm,
                "workspace_mm": machine.workspace_mm,
                "gauge": {
                    "resolution_mm": gauge.resolution_mm,
                    "range_mm": gauge.range_mm,
                    "revolution_mm": gauge.revolution_mm,
                    "repeatability_mm": gauge.repeatability_mm,
                },
                "offsets_mm": dict(zip("xyz", machine.offsets_mm, strict=True)),
                "tolerances": dict(machine.tolerances),
                "identified": [
                    {
                        "cause": cause.id,
                        "where": cause.where,
                        "parameters": {
                            name: {"value": e.value, "std": e.std, "unit": e.unit}
                            for name, e in cause.parameters.items()
                        },
                        "date": cause.date,
                        "data_sha256": cause.data_sha256,
                        "correlation": cause.correlation,
                    }
                    for cause in machine.identified
                ],
            }
        )

    def to_machine(self) -> Machine:
        """The machine that this file describes."""
        return Machine(
            name=self.name,
            leg_length_mm=self.leg_length_mm,
            parallelogram_width_mm=self.parallelogram_width_mm,
            tool_offset_mm=self.tool_offset_mm,
            joint_limits_mm=self.joint_limits_mm,
            workspace_mm=self.workspace_mm,
            gauge=Gauge(**self.gauge.model_dump()),
            offsets_mm=(self.offsets_mm.x, self.offsets_mm.y, self.offsets_mm.z),
            tolerances=self.tolerances,
            identified=tuple(
                IdentifiedCause(
                    id=cause.cause,
                    where=cause.where,
                    parameters={
                        name: Estimate(e.value, e.std, e.unit)
                        for name, e in cause.parameters.items()
                    },
                    date=cause.date,
                    data_sha256=cause.data_sha256,
                    correlation=cause.correlation,
                )
                for cause in self.identified
            ),
        )
