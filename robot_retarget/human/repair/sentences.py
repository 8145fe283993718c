"""Sentences about findings: kind, time and outcome, the worst first."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

LISTED = 3
"""Defects of a kind that are listed one by one; further ones are counted."""


@dataclass(frozen=True)
class Defect:
    """Something wrong with a stretch of a capture."""

    what: str
    """Its kind, the same words for the same kind: findings of a kind share a sentence."""
    first: int
    last: int
    """Frames of the file, both included."""
    size: float
    """How bad it is, in the unit of its kind."""
    measure: str
    """The size in words."""
    done: str
    """The repair, or the action that the user should take."""


def sentences(findings: Iterable[Defect], fps: float) -> tuple[str, ...]:
    """A sentence for every kind of finding and outcome, the kind with the worst one first.

    Args:
        findings: of any kinds.
        fps: frames per second [1/s].
    """
    kinds: dict[tuple[str, str], list[Defect]] = {}
    for finding in sorted(findings, key=lambda f: -f.size):
        kinds.setdefault((finding.what, finding.done), []).append(finding)
    return tuple(_sentence(what, done, found, fps) for (what, done), found in kinds.items())


def span(first: int, last: int, fps: float) -> str:
    """`frame 12 (0.40 s)` or `frames 12–15 (0.40–0.50 s)`.

    Args:
        last: last frame.
        fps: frames per second [1/s].
    """
    if first == last:
        return f"frame {first} ({first / fps:.2f} s)"
    return f"frames {first}–{last} ({first / fps:.2f}–{last / fps:.2f} s)"


def _sentence(what: str, done: str, found: Sequence[Defect], fps: float) -> str:
    places = ", ".join(f"{span(f.first, f.last, fps)}{f', {f.measure}' if f.measure else ''}" for f in found[:LISTED])
    more = f" and {len(found) - LISTED} more" if len(found) > LISTED else ""
    return f"{what} at {places}{more}: {done}."
