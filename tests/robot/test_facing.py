"""Front and back of a robot follow from quantities that shifts along an axis do not change; outvoted features are named."""

from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.errors import MatchError
from robot_retarget.robot import Robot, load_robot, recognise, recognise_with

LEG = """<body name="{n}_thigh" pos="0 {y} 0"><joint axis="1 0 0"/><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
<body name="{n}_shin" pos="0 0 -.3"><joint name="{n}_bend" axis="0 1 0" range="{knee}"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
<body name="{n}_foot" pos="0 0 -.3"><joint axis="0 1 0"/><joint axis="1 0 0" pos="{slide} 0 0"/>
<geom type="box" size=".1 .04 .01" pos="{ahead} 0 -.05"/>{toes}</body></body></body>"""
TOES = '<body name="{n}_tip" pos=".1 0 -.04"><joint axis="0 1 0"/><geom type="box" size=".02 .04 .01" pos=".02 0 -.01"/></body>'


def legged(
    folder: Path,
    names: tuple[str, str] = ("a", "b"),
    knee: str = "-2 2",
    ahead: float = 0.0,
    slide: float = 0.0,
    toes: bool = False,
    turn: float = 0.0,
) -> Robot:
    """A trunk on two legs that looks along x where `ahead` or the middle of `knee` is positive."""
    legs = "".join(
        LEG.format(n=n, y=y, knee=knee, ahead=ahead, slide=slide, toes=TOES.format(n=n) if toes else "")
        for n, y in zip(names, (0.1, -0.1), strict=True)
    )
    path = folder / "made.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 .7" euler="0 0 {turn}"><freejoint/>'
        f'<geom type="box" size=".1 .1 .2" pos="0 0 .2"/>{legs}</body></worldbody></mujoco>'
    )
    return load_robot(path)


@pytest.mark.parametrize("slide", [-0.3, -0.005, 0.0, 0.3])
@pytest.mark.parametrize("ahead", [-0.04, 0.04])
def test_feet_are_seen_from_the_ankle_wherever_its_roll_axis_is_anchored(
    tmp_path: Path, ahead: float, slide: float
) -> None:
    anatomy = recognise(legged(tmp_path, ahead=ahead, slide=slide))
    assert anatomy.forward == pytest.approx([np.sign(ahead), 0, 0], abs=1e-9)


def test_feet_that_reach_as_far_behind_do_not_tell(tmp_path: Path) -> None:
    for turn in (0.0, np.pi):  # the model's x axis is followed, whichever way the robot is put
        anatomy = recognise(legged(tmp_path, ahead=0.002, turn=turn))
        assert anatomy.forward == pytest.approx([1, 0, 0], abs=1e-6)
        assert (
            "no criterion decides between front and back" in anatomy.notes[0]
            and "forward = [x, y, z]" in anatomy.notes[0]
        )


@pytest.mark.parametrize(
    ("criterion", "robot"),
    [
        ("knees", {"knee": "-2 0.1"}),
        ("names", {"names": ("right", "left")}),
        ("toes", {"toes": True, "turn": np.pi}),
    ],
)
def test_each_criterion_alone_decides(tmp_path: Path, criterion: str, robot: dict) -> None:
    anatomy = recognise(legged(tmp_path, **robot))
    assert anatomy.forward == pytest.approx([-1, 0, 0], abs=1e-6)
    assert not any(note.startswith("no criterion decides") for note in anatomy.notes), criterion


def test_who_is_outvoted_is_named(tmp_path: Path) -> None:
    anatomy = recognise(legged(tmp_path, ("left", "right"), knee="-0.1 2", ahead=-0.04))
    assert anatomy.forward == pytest.approx([1, 0, 0], abs=1e-9)
    assert anatomy.notes[0] == "feet point the other way, outvoted by names and knees"


def test_a_map_file_has_the_last_word(tmp_path: Path) -> None:
    robot = legged(tmp_path, ("left", "right"), knee="-0.1 2", ahead=0.04)
    anatomy = recognise_with(robot, {"forward": [-1, 0, 0]})
    assert anatomy.forward == pytest.approx([-1, 0, 0], abs=1e-9)
    assert robot.model.body(anatomy.sites["l_knee"].body).name == "right_shin"
    assert anatomy.notes[0].endswith("names, feet and knees point the other way")
    assert not recognise_with(robot, {"forward": [1, 0, 0]}).notes[0].startswith("it looks where")
    for line, message in (("back", "must be \\[x, y, z\\]"), ([0, 0, 1], "straight up"), ([0.1, 1, 0], "not across")):
        with pytest.raises(MatchError, match=message):
            recognise_with(robot, {"forward": line})


def test_soles_are_read_level_however_the_ankles_are_bent_at_rest(tmp_path: Path) -> None:
    robot = legged(tmp_path, ("left", "right"), knee="-0.1 2", ahead=0.04)
    text = robot.path.read_text().replace('_foot" pos="0 0 -.3"', '_foot" pos="0 0 -.3" euler="0.2 0.3 0"')
    straight, bent = recognise(robot), None
    path = tmp_path / "bent.xml"
    path.write_text(text)
    bent = recognise(load_robot(path))
    for side in "lr":
        assert bent.frames[f"{side}_foot"][1] == pytest.approx(straight.frames[f"{side}_foot"][1], abs=0.05)
        assert bent.sites[f"{side}_toe"].offset == pytest.approx(straight.sites[f"{side}_toe"].offset, abs=0.01)
