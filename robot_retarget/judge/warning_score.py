"""Score of the warnings: contacts on the servos that were predicted, and warnings that came true."""

from typing import Any

import numpy as np

from robot_retarget.collision.warn import Warnings
from robot_retarget.robot.contacts import Contacts
from robot_retarget.robot.model import Robot

APART = 0.1
"""Touches of a pair this long after one another are two contacts [s]."""
LATE = 0.25
"""Largest delay of a contact after the end of its warning, because servos lag [s]."""


def warning_score(warnings: Warnings, contacts: Contacts, times: np.ndarray, robot: Robot) -> dict[str, Any]:
    """Count contacts (self-contacts `contacts` at `times` of their frames) and warnings against each other."""
    happened = touches(contacts, times, robot)
    links = {robot.model.body(body).name for body in range(robot.model.nbody)}
    events = [
        event for event in warnings.events if links.issuperset(event.pair)
    ]  # bodies of a scene are no self-contact
    warned = [(frozenset(e.pair), e.first_warning / warnings.fps, e.last / warnings.fps) for e in events]
    leads, fulfilled = [], set()
    for pair, start in happened:
        before = [k for k, (p, since, last) in enumerate(warned) if p == pair and since <= start <= last + LATE]
        fulfilled |= set(before)
        if before:
            leads.append(start - warned[before[0]][1])
    return {
        "warnings": len(warned),
        "warnings_fulfilled": len(fulfilled),
        "tracked_contacts": len(happened),
        "tracked_contacts_foreseen": len(leads),
        "median_lead_s": round(float(np.median(leads)), 4) if leads else None,
    }


def touches(contacts: Contacts, times: np.ndarray, robot: Robot) -> list[tuple[frozenset[str], float]]:
    """Each contact of two links with the time of its beginning, in order; links as the warnings name them."""
    model, found = robot.model, []
    for first, second in sorted(contacts.pairs()):
        pair = frozenset(model.body(int(model.body_weldid[body])).name for body in (first, second))
        at = np.unique(times[contacts.of((contacts.bodies == (first, second)).all(1)).frame])
        at = at[at >= 0]
        starts = at[np.diff(at, prepend=-np.inf) > APART]
        found += [(pair, float(start)) for start in starts]
    return sorted(found, key=lambda touch: touch[1])
