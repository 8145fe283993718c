"""A broken BVH file is refused in one line that names the file, the line and what was expected."""

import pytest
from bvh_texts import HEAD, ROWS, text
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.base.errors import MotionError
from robot_retarget.human.read import read_motion

GOOD = text()

BROKEN = {
    "empty": ("", "", "empty"),
    "blank": (" \n\n", "", "empty"),
    "no hierarchy": (GOOD.replace("HIERARCHY", "HELLO"), ":1:", "expected HIERARCHY, found 'HELLO'"),
    "no motion": (HEAD, ":15:", "expected MOTION"),
    "no frame time": (GOOD.replace("Frame Time", "Tempo"), ":16:", "expected 'Frame Time: seconds'"),
    "frame time zero": (text(time="0"), ":18:", "Frame Time must be positive, found 0"),
    "frame time negative": (text(time="-0.1"), ":18:", "Frame Time must be positive, found -0.1"),
    "frame time nan": (text(time="nan"), ":18:", "Frame Time must be positive"),
    "frame time a word": (text(time="fast"), ":18:", "Frame Time must be a number of seconds, found 'fast'"),
    "frame time left out": (text(time=""), ":18:", "Frame Time must be a number of seconds, found ''"),
    "no rows": (text(rows=()), "", "no frame follows Frame Time"),
    "cut in a row": (text(rows=(ROWS[0], "1 2 3"), frames=2), ":20:", "truncated: a row of 3 numbers, the hierarchy has 9"),
    "cut in a number": (text(rows=(ROWS[0], "1 2 3 4 5 6 7 8 1.5e")), ":20:", "expected a number, found '1.5e'"),
    "many rows missing": (text(frames=100), ":20:", "truncated: Frames says 100, 2 rows follow"),
    "short row between": (text(rows=(ROWS[0], "1 2", ROWS[1])), ":20:", "a row of 2 numbers, the hierarchy has 9"),
    "long row between": (text(rows=(ROWS[0], ROWS[1] + " 7", ROWS[1])), ":20:", "a row of 10 numbers"),
    "text among numbers": (text(rows=(ROWS[0], "iPi Soft", ROWS[1])), ":20:", "expected a number, found 'iPi'"),
    "nan": (text(rows=(ROWS[0], "1 2 3 4 5 6 7 nan 9")), ":20:", "frame 1, joint 'Spine': expected a finite number"),
    "nan of old windows": (text(rows=("1 2 -1.#IND 4 5 6 7 8 9",)), ":19:", "frame 0, joint 'Hips'"),
    "infinite": (text(rows=("inf 2 3 4 5 6 7 8 9",)), ":19:", "frame 0, joint 'Hips': expected a finite number, found inf"),
    "overflow": (text(rows=("1e999 2 3 4 5 6 7 8 9",)), ":19:", "frame 0, joint 'Hips'"),
    "brace not closed": (GOOD.replace("\t\t}\n\t}\n}", "\t\t}\n\t}\n"), ":14:", "ends inside joint 'Hips': expected '}'"),
    "brace too many": (GOOD.replace("MOTION", "}\nMOTION"), ":16:", "'}' without its '{'"),
    "brace not opened": (GOOD.replace("ROOT Hips\n{", "ROOT Hips"), ":3:", "OFFSET outside the braces of a joint"),
    "brace of nobody": (GOOD.replace("ROOT Hips", ""), ":3:", "'{' without a joint before it"),
    "joint in a joint's head": (GOOD.replace("ROOT Hips", "ROOT Hips\nROOT Two"), ":3:", "expected '{' after joint 'Hips'"),
    "unknown channel": (GOOD.replace("Yposition", "Wposition"), ":5:", "unknown channel 'Wposition' of joint 'Hips'; known: Xp"),
    "channels without a count": (GOOD.replace("CHANNELS 6 ", "CHANNELS "), ":5:", "expected their count, found 'Xposition'"),
    "fewer channels than said": (GOOD.replace("CHANNELS 3", "CHANNELS 4"), ":9:", "lists 3 channels"),
    "offset of two numbers": (GOOD.replace("OFFSET 0 10 0", "OFFSET 0 10"), ":8:", "expected 3 finite numbers"),
    "offset not finite": (GOOD.replace("OFFSET 0 10 0", "OFFSET 0 nan 0"), ":8:", "expected 3 finite numbers"),
    "no offset": (GOOD.replace("\t\tOFFSET 0 10 0\n", ""), ":6:", "joint 'Spine' has no OFFSET"),
    "unknown word": (GOOD.replace("\tJOINT", "\tBONE"), ":6:", "expected ROOT, JOINT, End Site"),
    "no joint": ("HIERARCHY\nMOTION\nFrames: 1\nFrame Time: 1\n1\n", ":1:", "no joint: expected ROOT"),
    "an end site alone": ("HIERARCHY\nEnd Site\n{\nOFFSET 0 0 0\n}\nMOTION\nFrames: 1\nFrame Time: 1\n1\n", ":2:", "outside every joint"),
    "no channels at all": (text("HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}\n"), "", "the hierarchy has 0 channels"),
    "not text": ("\x00\x01\x02", ":1:", "expected HIERARCHY"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "line", "message"), BROKEN.values(), ids=BROKEN)
def test_a_broken_file_is_refused_with_its_line(tmp_path, content, line, message):
    path = tmp_path / "broken.bvh"
    path.write_text(content)
    with pytest.raises(MotionError) as caught:
        read_motion(path)
    said = str(caught.value)
    assert said.startswith(f"{path}{line}")
    assert message in said
    assert "\n" not in said


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, len(GOOD)), st.integers(0, 12), st.sampled_from(["", "{", "}", "x", " 1e", "-", "\n", "nan", "\0"])
)
def test_damage_anywhere_ends_in_a_motion_or_in_one_message(tmp_path_factory, at, length, junk):
    path = tmp_path_factory.mktemp("damage") / "damaged.bvh"
    path.write_text(GOOD[:at] + junk + GOOD[at + length :])
    try:
        read_motion(path)
    except MotionError as error:
        assert str(error).startswith(str(path))


def test_a_missing_file_a_folder_and_an_unknown_suffix_are_refused(tmp_path):
    with pytest.raises(MotionError, match=r"nothing\.bvh: no such file"):
        read_motion(tmp_path / "nothing.bvh")
    with pytest.raises(MotionError, match="is a folder"):
        read_motion(tmp_path)
    other = tmp_path / "clip.mov"
    other.write_text("")
    with pytest.raises(MotionError, match=r"'\.mov'; known: BVH \(\.bvh\), .*joint positions \(\.npy, \.npz\)"):
        read_motion(other)
