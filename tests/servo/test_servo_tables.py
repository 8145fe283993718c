"""The datasheet tables agree with the model files that dynamixel-sdk ships."""

import runpy
from pathlib import Path

import dynamixel_sdk
import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget.actuators
from robot_retarget.actuators.control_tables import MODELS, TABLE_END, model_named, model_numbered
from robot_retarget.actuators.motors import MOTORS
from robot_retarget.base.errors import ServoError

PACKAGE = Path(robot_retarget.actuators.__path__[0])
SHIPPED = Path(dynamixel_sdk.__file__).parents[1] / "dynamixel_easy_sdk" / "control_table"


def model_file(name: str) -> Path:
    """Of the registers under Protocol 2."""
    if model_named(name).protocol == 1:
        return SHIPPED / "none"
    return SHIPPED / (name.lower().replace("(2.0)", "").replace("xl-", "xl").replace("-", "_") + ".model")


@pytest.mark.parametrize("name", MODELS)
def test_every_register_lies_where_the_sdk_s_model_file_puts_it(name: str) -> None:
    if not model_file(name).is_file():
        pytest.skip("the SDK ships no such file")
    rows = model_file(name).read_text().split("[control table]")[1].split("\n")[2:]
    theirs = {tuple(map(int, row.split("\t")[:2])): row.split("\t")[2] for row in rows if row.strip()}
    ours = {(r.address, r.size) for r in MODELS[name].registers.values()}
    named = {place for place, title in theirs.items() if "Indirect" not in title and place[0] < 168}
    assert named <= ours | {(126, 2)}, "and the load of an XL or MX-28 at 126"
    assert {place for place in ours if place[0] not in (60, 147)} <= named


@pytest.mark.parametrize("name", MODELS)
def test_registers_do_not_overlap_and_hold_their_defaults(name: str) -> None:
    taken: set[int] = set()
    for register in MODELS[name].registers.values():
        span = set(range(register.address, register.address + register.size))
        assert not span & taken and max(span) < TABLE_END
        taken |= span
        assert register.decode(register.encode(register.default)) == register.default
        assert register.low <= register.default <= register.high


def test_the_page_has_every_model_with_its_protocol_its_second_source_and_its_figure() -> None:
    page = (ROOT / "docs" / "how-to" / "my-servo.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in page.splitlines() if row.startswith("| ")]
    table = {row[0]: row[1:] for row in rows if row[0] in MODELS}
    assert list(table) == list(MODELS)
    for name, (protocol, layout, source, off) in table.items():
        assert int(protocol) == MODELS[name].protocol and (PACKAGE / layout.strip("`")).is_file()
        assert ("dynamixel-sdk" in source) == model_file(name).is_file() and float(off) < 0.3


def test_models_are_known_by_name_with_any_connector_and_by_number() -> None:
    assert model_named("xm430-w350-R") is model_numbered(1020)
    assert model_numbered(9999) is None
    assert model_named("MX-28AT").protocol == 1 and model_named("mx-28ar(2.0)") is model_numbered(30)
    assert {model_named(name).number for name in ("AX-12", "AX-12A", "AX-12+")} == {12}
    with pytest.raises(ServoError, match=r"no servo model 'RX-28'; .*known: .*XM430-W350"):
        model_named("RX-28")


def test_every_control_table_has_its_motor_and_every_motor_its_table() -> None:
    assert list(MODELS) == list(MOTORS)
    assert all(model.motor.name == name for name, model in MODELS.items())


def test_the_figures_of_the_page_are_those_of_its_script(tmp_path: Path) -> None:
    """The model with the largest one."""
    script = runpy.run_path(str(ROOT / "scripts" / "bench" / "bench_servo_models.py"))
    assert np.degrees(script["difference"]("XL430-W250", tmp_path)) == pytest.approx(0.11, abs=0.05)
