"""Decode a C3D file with ezc3d in a separate process: `python child.py FILE OUT.npz`.

ezc3d trusts the counts in a file: a changed byte can crash the interpreter, run without end or ask for all memory.
"""

import re
import sys
from typing import Any

import numpy as np

from robot_retarget.base.untrusted.child import BROKEN, limit

MEMORY = 4 << 30
"""Of the process [bytes]."""
SECONDS = 60
"""Processor time; the largest laboratory files take 10 [s]."""


def decoded(path: str) -> dict[str, Any]:
    """The points of a file.

    Returns:
        `points` (3, M, T) in the file's unit, `labels` (M,), `rate` and `units` as the parameters of POINT state them.
    """
    import ezc3d

    file = ezc3d.c3d(path)
    stated = file["parameters"]["POINT"]
    # Labels beyond 255 are in LABELS2, LABELS3, …
    keys = ["LABELS", *sorted(key for key in stated if re.fullmatch(r"LABELS\d+", key))]
    return {
        "points": np.asarray(file["data"]["points"], dtype=float)[:3],
        "labels": np.array([str(label) for key in keys if key in stated for label in stated[key]["value"]], np.str_),
        "rate": np.asarray(stated.get("RATE", {}).get("value", []), dtype=float),
        "units": np.array([str(unit) for unit in stated.get("UNITS", {}).get("value", ["mm"])], np.str_),
    }


def main(path: str, out: str) -> int:
    """Decode and save."""
    limit(MEMORY, SECONDS)
    try:
        np.savez(out, **decoded(path))
    except (RuntimeError, OSError, ValueError, LookupError, TypeError, MemoryError, OverflowError) as error:
        print(str(error).strip() or "it is cut short", file=sys.stderr)
        return BROKEN
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
