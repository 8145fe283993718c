"""The one table of formats; a new format is a file in one of the folders beside this one and a line here."""

from robot_retarget.formats.format import Format
from robot_retarget.formats.npz import beyondmimic, locomujoco, mjlab, native, omniretarget, omniretarget_training
from robot_retarget.formats.pickles import gmr
from robot_retarget.formats.text import kimodo, named_csv, protomotions_csv, unitree

FORMATS: dict[str, Format] = {
    module.FORMAT.name: module.FORMAT
    for module in (
        native,
        named_csv,
        unitree,
        kimodo,
        protomotions_csv,
        gmr,
        beyondmimic,
        mjlab,
        omniretarget,
        omniretarget_training,
        locomujoco,
    )
}
