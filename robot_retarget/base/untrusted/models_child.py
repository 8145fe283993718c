"""Compile a model with MuJoCo in a separate process: `python models_child.py FILE SECONDS [READER]`.

MuJoCo allocates the sizes that a file states: a few bytes can state gigabytes, hours of work, or an endless recursion.
"""

import runpy
import sys
from pathlib import Path

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.untrusted.child import BROKEN, TOO_MUCH, limit

MEMORY = 3 << 29
"""Of the process [bytes]: the largest robots of MuJoCo Menagerie take a fifth."""
SECONDS = 60
"""Processor time [s]: robots with detailed meshes take 10."""
BODIES = 2000
"""Largest number of bodies; the models of MuJoCo Menagerie have up to 100."""
OUT_OF_MEMORY = ("allocate", "unknown exception")
"""Words of MuJoCo's errors where memory ends."""
ARENA = 1 << 30
"""Largest arena of the simulation [bytes]; MuJoCo's default is 100 times the model."""


def main(path: str, seconds: str, reader: str = "") -> int:
    """Compile a file by `parsed` of a reader, or as MuJoCo reads it."""
    limit(MEMORY, int(seconds))
    import mujoco

    parsed = runpy.run_path(reader)["parsed"] if reader else lambda file: mujoco.MjSpec.from_file(str(file))
    try:
        model = parsed(Path(path)).compile()
    except RobotRetargetError:
        return 0  # the caller raises it again
    except Exception as error:
        if isinstance(error, MemoryError) or any(words in str(error) for words in OUT_OF_MEMORY):
            return TOO_MUCH
        print(" ".join(str(error).split()), file=sys.stderr)
        return BROKEN
    arena = int(model.narena)  # pyright: ignore[reportAttributeAccessIssue]
    for what, count, most in (("bodies", model.nbody, BODIES), ("bytes of memory", arena, ARENA)):
        if count > most:
            print(f"{count:,} {what}, more than {most:,}", file=sys.stderr)
            return TOO_MUCH
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
