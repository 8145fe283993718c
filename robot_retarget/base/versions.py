"""Refuse versions of MuJoCo that are too old or give wrong results, before MuJoCo is imported."""

from importlib.metadata import PackageNotFoundError, version

from robot_retarget.base.errors import RobotError

OLDEST = (3, 12)
WRONG = {
    "3.11.0": "it finds no distance between one pair of separate boxes in thirty",
    "4.0.0": "the Newton solver's factor of sparse Hessians is wrong (fixed in 4.0.1)",
}
"""Versions that give wrong results, and which. The package is installed below 4: verdicts are not yet checked with it."""


def require_mujoco() -> None:
    """Refuse a MuJoCo that is too old or known to be wrong.

    Raises:
        RobotError: The version is refused; the message has the command that installs another.
    """
    try:
        check(version("mujoco"))
    except PackageNotFoundError:
        return  # its import says so itself


def check(found: str) -> None:
    """As `require_mujoco`, of a version given by its number."""
    oldest = ".".join(map(str, OLDEST))
    reason = WRONG.get(found, f"it is older than {oldest}" if _numbers(found) < OLDEST else "")
    if reason:
        raise RobotError(f"MuJoCo {found} cannot be used: {reason}. Install another: pip install 'mujoco>={oldest},<4'")


def _numbers(found: str) -> tuple[int, ...]:
    """Return the first two numbers of a version; other text counts as new."""
    parts = found.split(".")[:2]
    return tuple(int(part) if part.isdigit() else 10**6 for part in parts)
