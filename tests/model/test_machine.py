"""Machines as schemas: the keys of their files, distinguished by kind, with bounds and words."""

import pytest
import yaml

from orthoglide_cal.errors import UsageError
from orthoglide_cal.files.machine_file import kind_of
from orthoglide_cal.model.kinds import MACHINES
from orthoglide_cal.model.linear_delta import LinearDelta
from orthoglide_cal.model.orthoglide import Orthoglide
from tests.machines import PROTOTYPE, ROOT
from tests.printers import PRINTER


def read(values):
    return MACHINES[values.get("kind", kind_of(values))].model_validate(values)


LEFT_OUT = ("schema_version", "identified")


def keys(name, **other):
    """Keys of a file of the package as texts, with other values."""
    text = (ROOT / "configs" / f"{name}.yaml").read_text(encoding="utf-8")
    given = yaml.load(text, yaml.BaseLoader)
    return {key: value for key, value in (given | other).items() if key not in LEFT_OUT}


@pytest.mark.parametrize(
    ("name", "made"),
    [("orthoglide_prototype", Orthoglide), ("orthoglide_large", Orthoglide),
     ("linear_delta", LinearDelta)],
)  # fmt: skip
def test_its_kind_is_told_by_its_keys_too(name, made):
    stated = keys(name)
    silent = {key: value for key, value in stated.items() if key != "kind"}
    machine = read(silent)
    assert type(machine) is made
    assert MACHINES[machine.kind] is made
    assert machine == read({**stated, "kind": machine.kind})
    assert hash(machine) == hash(read(silent))


def test_a_changed_machine_has_the_fields_of_its_kind():
    assert PROTOTYPE.changed(leg_length_mm=300.0).nominal_rails.lengths.tolist() == [300.0] * 3
    with pytest.raises(TypeError, match="arm_length_mm"):
        PROTOTYPE.changed(arm_length_mm=300.0)
    with pytest.raises(UsageError, match="linear_delta"):
        Orthoglide.require(PRINTER)
