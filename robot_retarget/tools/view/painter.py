"""Paint moments of a motion with MuJoCo and OpenGL, or draw figures where OpenGL is missing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from robot_retarget.tools.view.picture import Pixels, Unavailable
from robot_retarget.tools.view.render import STILL, Finish, open_stage
from robot_retarget.tools.view.staging import Staging


@contextmanager
def painter(
    staging: Staging, width: int, height: int, finish: Finish = STILL
) -> Iterator[tuple[Callable[[int], Pixels], str]]:
    """Return a function that paints the k-th moment of a staging, and a note if it is drawn without OpenGL."""
    stage = open_stage(staging, width, height, finish)
    if isinstance(stage, Unavailable):
        from robot_retarget.tools.view.draw import Sketch

        yield Sketch(staging, width, height).frame, f"{stage.reason}; figures are drawn instead"
        return
    try:
        yield stage.frame, ""
    finally:
        stage.close()
