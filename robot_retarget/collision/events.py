"""Warnings as events: pair of links, time and outcome."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base import files
from robot_retarget.base.arrays import Floats

COLUMNS = ("link_a", "link_b", "first_warning", "predicted_contact", "contact", "lead_s", "depth_m", "last")


@dataclass(frozen=True)
class Event:
    """One interval of warning of one pair of links."""

    pair: tuple[str, str]
    first_warning: int
    """Frame in which the warning is raised."""
    predicted_contact: int
    """Frame of the predicted contact."""
    contact: int | None
    """First frame in which the geoms touch, or None."""
    lead_s: float
    """From the warning to the contact, or to the predicted one if no contact came [s]."""
    depth_m: float
    """Deepest predicted overlap [m]."""
    last: int
    """The last frame of the warning."""

    def contract(self) -> dict[str, Any]:
        """Return the event as JSON fields."""
        return {**asdict(self), "pair": list(self.pair)}


def events_of(
    pairs: Sequence[tuple[str, str]],
    flagged: np.ndarray,
    touching: np.ndarray,
    time_to_contact: Floats,
    depth: Floats,
    fps: float,
) -> list[Event]:
    """Return the intervals of flagged frames, in order of time; all arrays are (T, P).

    Args:
        pairs: P names of both links.
        flagged: (T, P) whether a warning is raised.
        touching: (T, P) whether links overlap.
        time_to_contact: (T, P) [s].
        depth: (T, P) predicted overlap [m].
        fps: frames per second [1/s].
    """
    edge = np.diff(flagged.astype(np.int8), axis=0, prepend=0, append=0)
    starts, stops = np.argwhere(edge.T == 1), np.argwhere(edge.T == -1)
    found = []
    for (pair, start), (_, stop) in zip(starts.tolist(), stops.tolist(), strict=True):
        hits = np.flatnonzero(touching[start:stop, pair])
        contact = start + int(hits[0]) if hits.size else None
        wait = float(time_to_contact[start, pair])
        predicted = start + round(wait * fps) if np.isfinite(wait) else start
        lead = ((predicted if contact is None else contact) - start) / fps
        deepest = float(depth[start:stop, pair].max())
        found.append(Event(pairs[pair], start, predicted, contact, round(lead, 4), round(deepest, 5), stop - 1))
    return sorted(found, key=lambda event: event.first_warning)


def figures_of(events: Sequence[Event], frames: int, fps: float) -> dict[str, Any]:
    """Return counts and the median lead of the events.

    Args:
        events: of a trajectory.
        frames: number of frames.
        fps: frames per second [1/s].
    """
    hits = [event for event in events if event.contact is not None]
    return {
        "frames": frames,
        "fps": fps,
        "events": len(events),
        "contacts": len(hits),
        "median_lead_s": round(float(np.median([event.lead_s for event in hits])), 4) if hits else None,
    }


def write_csv(events: Sequence[Event], path: str | Path) -> Path:
    """Write the events as a table, whole or not at all.

    Args:
        events: of a trajectory.
        path: of the file.

    Raises:
        OutputError: it cannot be written.
    """
    rows = ((*e.pair, e.first_warning, e.predicted_contact, e.contact, e.lead_s, e.depth_m, e.last) for e in events)
    return files.write_csv(path, COLUMNS, rows)
