"""`view` and `mend` refuse a motion that the trajectory was not made of."""

from dataclasses import replace
from pathlib import Path

import pytest
from forked import run
from made_trajectories import wander
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.errors import TrajectoryError

SAMPLES = ROOT / "samples"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trajectory that says it was made of walk.bvh, and an edit of it."""
    folder, walk = tmp_path_factory.mktemp("source"), rr.read_motion(SAMPLES / "walk.bvh")
    own = replace(wander(rr.load_robot("op3")), source="walk.bvh", source_sha256=walk.source_sha256)
    (folder / "edits.toml").write_text('[[edge]]\na = "l_hand"\nb = "head"\nat = 0.2\nframes = [2, 4]\n')
    return own.save(folder / "walk.npz")


@pytest.mark.parametrize("command", ["view", "mend"])
def test_another_clip_is_refused_with_both_names_and_the_way_out(command: str, made: Path) -> None:
    written = made.with_name("out.html" if command == "view" else "out.npz")
    ways = ["--static", written] if command == "view" else ["--edges", made.with_name("edits.toml"), "-o", written]
    given = [
        *(["edit"] if command == "mend" else []),
        command,
        made,
        "-r",
        "op3",
        "--motion",
        SAMPLES / "wave.bvh",
        *ways,
    ]
    done = run(*given)
    assert done.returncode == 2 and not written.exists()
    assert "comes from walk.bvh, not from wave.bvh" in done.stderr and "--force" in done.stderr


def test_a_clip_is_known_by_its_content_and_without_a_hash_by_its_name(made: Path, tmp_path: Path) -> None:
    own, walk = rr.load_trajectory(made), rr.read_motion(SAMPLES / "walk.bvh")
    copy = tmp_path / "renamed.bvh"
    copy.write_bytes((SAMPLES / "walk.bvh").read_bytes())
    own.require_source(str(copy), rr.read_motion(copy).source_sha256)
    with pytest.raises(TrajectoryError, match="their contents differ"):
        own.require_source("walk.bvh", "0" * 64)
    nameless = replace(own, source_sha256="")
    nameless.require_source("elsewhere/walk.bvh", walk.source_sha256)
    with pytest.raises(TrajectoryError, match="their names differ"):
        nameless.require_source("wave.bvh", walk.source_sha256)
    replace(nameless, source="").require_source("wave.bvh", walk.source_sha256)
