"""Read a scene file of any format."""

from pathlib import Path

from robot_retarget.base.errors import SceneError, known
from robot_retarget.scene.formats import mjcf, toml_scene
from robot_retarget.scene.scene import Scene

READERS = {".toml": toml_scene.read, ".xml": mjcf.read, ".urdf": mjcf.read}
"""By the ending of the file name."""
POSES = (".npz", ".pt", ".pkl", ".p", ".csv")
"""Endings of files that hold poses without shapes."""


def read_scene(path: str | Path) -> Scene:
    """Read the bodies around a human, in metres, z up.

    Args:
        path: a TOML of bodies (`formats.toml_scene`), or an MJCF or URDF, whose geoms that no joint moves are the bodies.

    Raises:
        SceneError: the file cannot be read, or a body is not as it should be; names the file and the body.
    """
    file = Path(path)
    if not file.is_file():
        raise SceneError(f"{file}: no such file")
    ending = file.suffix.lower()
    if ending in POSES:
        raise SceneError(
            f'{file} may hold poses, but no shapes: name it in a TOML, [[body]] name = "box" shape = "box" '
            f'size = [0.4, 0.4, 0.4] poses = "{file.name}"'
        )
    if ending not in READERS:
        raise SceneError(f"{file}: no kind of scene file ends in {ending!r}; {known(READERS)}")
    return READERS[ending](file)
